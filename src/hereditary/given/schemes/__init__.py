"""Schemes on given steps, one file for each."""
