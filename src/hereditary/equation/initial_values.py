"""Initial values as users write them, and as arrays of shape (m, d)."""

import numpy as np

from ..support.checks import complaint, real_array, refuse_masked, shown

_SPEED = (
    "; y' is no entry of y: with memory=hd.Caputo(1), rhs(t, y, memory) or rhs(t, y, memory, "
    "params) reads it as memory[0, 0]"
)


def finite(y0):
    """Return initial values as an array of finite numbers, real or complex."""
    remedy = "give shape (m, d): y(0), y'(0), ..."
    refuse_masked("y0", y0)
    try:
        is_complex = np.array(y0).dtype.kind == "c"
    except (TypeError, ValueError):  # rows of unequal length
        is_complex = False
    if not is_complex:
        return real_array("y0", y0, remedy=remedy)
    values = np.array(y0, dtype=complex)
    for part in (values.real, values.imag):
        real_array("y0", part, "be finite numbers", remedy)
    return values


def initial_values(values, m):
    """The (m, d) array behind any of the shorthands."""
    given = values.shape
    if values.ndim == 0:
        values = values.reshape(1, 1)
    elif values.ndim == 1:
        values = values.reshape(1, -1) if m == 1 else values.reshape(-1, 1)
    if values.ndim == 2 and values.shape[0] == m and values.shape[1] >= 1:
        return np.ascontiguousarray(values)
    given_names = [f"y{chr(39) * k}(0)" for k in range(m)]
    names = " and ".join(filter(None, [", ".join(given_names[:-1]), given_names[-1]]))
    required = f"hold {names}, shape ({m}, d)"
    remedy = "the highest order sets how many rows are needed, ceil(order)"
    if m == 2 and values.size == 1:
        remedy = f"an order above 1 needs y'(0) too, e.g. [{values[0, 0]}, 0.0]"
    elif m == 1 and len(given) == 2 and given[1] == 1:
        remedy = "orders up to 1 need y(0) alone, its components in a row"
    elif m == 2 and values.ndim == 2 and values.shape[1] == 1:
        remedy = f"for {values.size} components give two rows, [[y(0), ...], [y'(0), ...]]"
    got = f"shape {given}" if given else shown(values[0, 0])
    raise ValueError(complaint("y0", required, got, remedy))


def rows_of(values, m, d):
    """The (k, d) array of initial values of d components, k >= m."""
    rows = values.reshape(-1, d) if values.ndim < 2 and values.size % d == 0 else values
    if rows.ndim != 2 or rows.shape[1] != d or len(rows) < m:
        required = f"hold at least {m} rows of {d}, where d = {d} is stated"
        got = f"shape {values.shape}" if values.ndim else shown(values)
        raise ValueError(complaint("y0", required, got))
    return np.ascontiguousarray(rows)


def of_shorthand(values, initial, reads_memory):
    """Return what a flat y0 was taken for, and how rhs reads y', where these may be meant."""
    speed = _SPEED if initial.shape == (2, 1) and not reads_memory else ""
    if values.ndim != 1 or initial.shape[0] == 1:
        return speed
    return (
        f"; y0 = {shown(values)} is taken for y(0) and y'(0) of one component: for two write "
        f"[[y(0), ...], [y'(0), ...]]{speed}"
    )
