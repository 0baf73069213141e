"""Schemes, one file each."""
