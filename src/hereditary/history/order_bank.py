"""The bank of modes behind adaptive collocation for orders that vary (floor 3).

One set of rates for the kernels ``t**(a-1) / Gamma(a)`` of all a in [0, 1). The modes are kept
without weights; those of the orders at each node are worked out for each step.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import rgamma

from .varying import SLOW_NODES, bank_of_all_orders, weights_of_orders


@dataclass(frozen=True, eq=False)
class OrderBank:
    """Rates with which every such kernel is a sum of exponentials between two distances.

    Attributes
    ----------
    closest, farthest : float
        Distances between which the sums hold [time].
    tol : float
        Their relative error [-].
    rates : ndarray, shape (M,)
        [1/time].
    """

    closest: float
    farthest: float
    tol: float
    rates: np.ndarray

    def weights(self, orders: np.ndarray) -> np.ndarray:
        """Weights for kernels of some orders a (k,), shape (M, k)."""
        ratio = self.farthest / self.closest
        found = _slow_first(weights_of_orders(1 - orders, ratio, self.tol))
        return found * self.closest ** (orders - 1) * rgamma(orders)

    def closer(self, closest: float) -> OrderBank:
        """A bank that reaches down to `closest`; its first rates are those of this one."""
        _, h, _ = bank_of_all_orders(self.farthest / self.closest, self.tol)
        factor = math.exp(h * math.ceil(math.log(self.closest / closest) / h))
        bank = open_order_bank(self.closest / factor, self.farthest, self.tol)
        n = self.rates.size
        if bank.rates.size < n or not np.allclose(bank.rates[:n], self.rates, rtol=1e-6, atol=0):
            raise ArithmeticError(f"no bank from {closest} on goes on from {self.closest}")
        return bank


def open_order_bank(closest: float, farthest: float, tol: float) -> OrderBank:
    """The bank between two distances."""
    rates, _, _ = bank_of_all_orders(farthest / closest, tol)
    return OrderBank(closest, farthest, tol, _slow_first(rates) / closest)


def _slow_first(rows):
    # a bank that reaches closer has more of those of the grid
    return np.concatenate([rows[-SLOW_NODES:], rows[:-SLOW_NODES]])
