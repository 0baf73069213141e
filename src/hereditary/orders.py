"""Orders of derivatives: near integers, and as functions of the time (floor 2)."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from ._checks import complaint, real

# Orders this close to an integer, or to each other, are it: they come from sums and quotients.
ROUNDING = 1e-14


def rounded_order(orders: ArrayLike) -> np.ndarray:
    """Orders with those within rounding of 1 or 2 set to it."""
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
    """m = ceil(alpha), the derivative inside Caputo's operator: 1 or 2."""
    return math.ceil(rounded_order(alpha))


class OrderFailed(ValueError):
    """An order that varies left its range, or its function raised."""


@dataclass(frozen=True)
class VaryingOrder:
    """An order that is a function of the time, and the Caputo operator with it.

    Attributes
    ----------
    function : callable
        ``function(t)``, the order at time t.
    derivative : int
        m, 1 or 2: orders lie in (m - 1, m].
    origin : float
        The time that is called 0 [time].
    """

    function: Callable
    derivative: int
    origin: float = 0.0

    @classmethod
    def begun(cls, function: Callable) -> VaryingOrder:
        """The operator of a user's function, whose value at 0 tells m."""
        required = "be a function order(t) with values in (0, 1], or in (1, 2]"
        try:
            start = function(0.0)
        except Exception as error:
            got = f"{type(error).__name__} at t = 0: {error}"
            raise ValueError(complaint("order", required, got)) from error
        value = float(rounded_order(real("order", np.asarray(start)[()], required)))
        if not 0 < value <= 2:
            raise ValueError(complaint("order", required, f"{value} at t = 0"))
        return cls(function, derivative_order(value))

    @property
    def name(self) -> str:
        """Name of the function."""
        return getattr(self.function, "__name__", type(self.function).__name__)

    def later(self, origin: float) -> VaryingOrder:
        """Return the order with time counted from `origin`, in the user's time."""
        return replace(self, origin=origin)

    def sampled(self, times: np.ndarray) -> tuple[np.ndarray, str]:
        """Orders at increasing times (n,), up to the first bad one, and what is wrong with that.

        Returns
        -------
        values : ndarray, shape (k,)
            All inside the range; k = n where all is well.
        trouble : str
            A sentence; empty where all is well.
        """
        times = times + self.origin
        values = self._at_once(times)
        reason = ""
        if values is None:
            values, reason = self._one_by_one(times)
        values = rounded_order(values)
        low, high = self.derivative - 1, self.derivative
        if not reason and values.size and values.min() > low and values.max() <= high:
            return values, ""
        good = (values > low) & (values <= high)
        k = values.size if good.all() else int(np.argmin(good))
        if k < values.size:
            reason = f"{values[k]}"
        if not reason:
            return values, ""
        required = f"stay in ({low}, {high}], where it is at t = 0"
        return values[:k], complaint("order", required, f"{reason} at t = {times[k]:.6g}")

    def _at_once(self, times):
        """Call the function once for all times; None where it does not take arrays of them."""
        try:
            # a function may write into what it is given
            values = np.broadcast_to(np.asarray(self.function(times.copy())), times.shape)
            if values.dtype.kind not in "iuf":
                return None
            some = sorted({0, times.size // 2, times.size - 1})
            alone = np.array([float(self.function(float(times[i]))) for i in some])
        except Exception:  # whatever it is: one by one will tell
            return None
        close = np.abs(values[some] - alone) <= 1e-12 * np.abs(alone)
        return np.asarray(values, dtype=float) if close.all() else None

    def _one_by_one(self, times):
        """Return values up to the first call that fails, and how that failed."""
        values = np.empty(times.size)
        for i, t in enumerate(times.tolist()):
            try:
                values[i] = float(self.function(t))
            except Exception as error:
                return values[:i], f"{type(error).__name__}: {error}"
        return values, ""
