"""Functions to sweep, in a module that worker processes can import."""

import os
import time

import numpy as np

import hereditary as hd

GRID = {"b": np.linspace(0.5, 3.0, 4), "c": np.array([0.0, 10.0, 50.0])}
LONG_GRID = {"b": np.linspace(0.5, 3.0, 30), "c": np.array([10.0, 50.0])}


def march(b, c):
    """A short run with memory; drawn out where a test wants to meet it under way."""
    time.sleep(float(os.environ.get("SECONDS_A_POINT", "0")))
    sol = hd.solve(hd.scenes.stick_slip(spring_speed=b, adhesion=c), 5.0, 250, save_every=50)
    return {"x": sol.y[-1, 0], "orbit": sol.y[:, 0], "status": sol.status}


def exponents(b, c):
    """Both Lyapunov exponents of a short run."""
    res = hd.lyapunov(hd.scenes.stick_slip(spring_speed=b, adhesion=c), 5.0, 250, k=2)
    return {"exponents": res.exponents, "verdict": res.verdict, "status": res.status}


def odd(b, c):
    """Everything that a point may be: a failure, nan, inf, text."""
    if c == 10.0 and b > 1.0:
        raise ValueError(f"no solution\n  at b = {b}")
    with np.errstate(all="ignore"):
        extremes = np.float64(b - 0.5) / c, -np.log(c), np.nextafter(b, 9), -0.0, 5e-324
    return {"extremes": extremes, "place": f'"{c}", é, \\', "status": "odd" if c else "completed"}


def process(b, c):
    """Which process computes a point."""
    return os.getpid()


def same(table, other):
    """Whether two tables hold the same bits, but for the sign that a NaN may have."""
    return (
        table.names == other.names
        and list(table.axes) == list(other.axes)
        and np.array_equal(table.status, other.status)
        and all(_same(table.axes[name], other.axes[name]) for name in table.axes)
        and all(_same(table[name], other[name]) for name in table.names)
    )


def _same(a, b):
    if a.dtype.kind == "f":
        a, b = (np.where(np.isnan(array), np.nan, array) for array in (a, b))
    return (a.dtype, a.shape, a.tobytes()) == (b.dtype, b.shape, b.tobytes())
