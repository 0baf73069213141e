"""Decorators of compiled functions, by which tests find them in the sources."""

DECORATORS = {
    "entry",
    "compiled",
    "plug_in",
    "inner",
}
