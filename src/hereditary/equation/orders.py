"""Checks of the orders of derivatives, and the rounding of orders that are nearly equal."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from ..support.checks import real_array, refuse

# Distance up to which two orders count as equal, or an order as an integer, because sums and
# quotients are rounded.
ROUNDING = 1e-14
# Highest order that a term of an equation may have.
HIGHEST = 20


def rounded_order(orders: ArrayLike) -> np.ndarray:
    """Return orders, each rounded to an integer above 0 if it differs by at most `ROUNDING`."""
    orders = np.asarray(orders, dtype=float)
    nearest = orders.round()
    return np.where((np.abs(orders - nearest) <= ROUNDING) & (nearest > 0), nearest, orders)


def orders_up_to_2(orders: ArrayLike) -> np.ndarray:
    """Return orders after `rounded_order`; refuse any outside of (0, 2]."""
    found = rounded_order(real_array("order", orders, "lie in (0, 2]", "give numbers"))
    if found.ndim > 1 or found.size == 0:
        refuse("order", "be numbers in a row", f"shape {found.shape}")
    if np.any(found <= 0) or np.any(found > 2):
        refuse("order", "lie in (0, 2]", found.tolist())
    return found


def merged_orders(orders: np.ndarray) -> np.ndarray:
    """Return the orders of an equation, with one value for orders that differ by rounding."""
    values = np.array(sorted(set(orders.ravel().tolist())))
    differ = values[1:] - values[:-1] > ROUNDING
    if differ.all():
        return orders.copy()
    apart = np.append(True, differ)
    first = values[apart][np.cumsum(apart) - 1]
    return first[np.searchsorted(values, orders)]


@lru_cache(maxsize=1024)
def derivative_order(alpha: float) -> int:
    """Return m = ceil(alpha), the derivative inside Caputo's operator."""
    return math.ceil(rounded_order(alpha))


class OrderFailed(ValueError):
    """An order that varies left its range, or its function raised."""
