"""Schemes (floor 2): one file each, its weights and declarations; no knowledge of histories."""
