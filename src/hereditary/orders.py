"""Orders of derivatives near integers and near each other."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

# Orders this close to an integer, or to each other, are it: they come from sums and quotients.
ROUNDING = 1e-14
# Highest order of an equation.
HIGHEST = 20


def rounded_order(orders: ArrayLike) -> np.ndarray:
    """Orders with those within rounding of an integer set to it."""
    orders = np.asarray(orders, dtype=float)
    nearest = np.round(orders)
    return np.where((np.abs(orders - nearest) <= ROUNDING) & (nearest > 0), nearest, orders)


def merged_orders(orders: np.ndarray) -> np.ndarray:
    """Orders of one equation with those within rounding of a smaller one set to it."""
    values = np.unique(orders)
    apart = np.diff(values, prepend=-1.0) > ROUNDING
    first = values[apart][np.cumsum(apart) - 1]
    return first[np.searchsorted(values, orders)]


def derivative_order(alpha: float) -> int:
    """m = ceil(alpha), the derivative inside Caputo's operator."""
    return math.ceil(rounded_order(alpha))


class OrderFailed(ValueError):
    """An order that varies left its range, or its function raised."""
