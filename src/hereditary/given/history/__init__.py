"""Histories, one file each."""
