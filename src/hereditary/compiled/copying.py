"""Copies between arrays by loops: numba takes long to compile ``out[:] = values``."""

from .jit import inlined, inner


@inlined
def put(values, out):
    """Copy a vector."""
    for c in range(out.shape[0]):
        out[c] = values[c]


@inlined
def clear(out):
    """Set a vector to 0."""
    for c in range(out.shape[0]):
        out[c] = 0.0


@inner
def clear_matrix(out):
    """Set a matrix to 0."""
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            out[i, j] = 0.0


@inner
def put_matrix(values, out):
    """Copy a matrix."""
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            out[i, j] = values[i, j]


@inner
def put_cube(values, out):
    """Copy an array of three axes."""
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            for k in range(out.shape[2]):
                out[i, j, k] = values[i, j, k]
