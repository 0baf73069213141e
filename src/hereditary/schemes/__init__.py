"""Schemes: one file each, its weights and declarations; no knowledge of histories."""
