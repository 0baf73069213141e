"""Hypothesis strategies shared by the tests; each says what it leaves out and why."""

import numpy as np
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp


def orders(low=0.05, high=1.95):
    """Orders in [low, high]; integers come from explicit examples."""
    return st.floats(low, high, exclude_max=False).filter(lambda a: abs(a - round(a)) > 1e-6)


def amplitudes():
    """Numbers of moderate size: laws of linear operations are exact there to rounding."""
    return st.floats(-10.0, 10.0)


def sequences(n, width=1):
    """Arrays (width, n) of moderate numbers."""
    return hnp.arrays(np.float64, (width, n), elements=amplitudes())
