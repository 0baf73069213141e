"""Histories: one file each; how the past is summed, whatever the scheme."""
