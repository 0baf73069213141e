"""The paper's figures and what lies beyond them: `python -m hereditary paper`."""
