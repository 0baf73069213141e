"""Histories, which sum over the past of a run, one file for each."""
