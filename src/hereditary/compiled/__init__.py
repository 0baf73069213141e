"""Compiled functions on plain arrays, and what compiles them, stores them and calls them."""
