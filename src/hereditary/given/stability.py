"""The longest stable step of explicit schemes."""

from collections.abc import Callable
from typing import Any

import numpy as np


def largest_step(limits: Callable[..., Any], stiffness: float) -> float:
    """Return the step h at which the smallest of ``limits(h)``, (d,), equals `stiffness`."""
    low, high = -700.0, 700.0  # bounds of log h for the bisection
    for _ in range(200):
        middle = (low + high) / 2
        if limits(np.exp(middle)).min() > stiffness:
            low = middle
        else:
            high = middle
    return float(np.exp(low))
