"""The source's figures and what lies beyond them (floor 6): `python -m hereditary paper`."""
