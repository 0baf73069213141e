"""Varying orders: their exponential modes, and the tables of one step.

The weights of the modes depend on the order at the time to which a step integrates. So the modes
are stored without weights, and Python fills tables of the weights before each step. Letters of
shapes: M modes, s nodes of a step, n_v varying orders.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.special import rgamma

from ..compiled.records import record
from ..equation.terms import VaryingOrder
from ..kernels.exponential_sum import SLOW_NODES, bank_of_all_orders, weights_of_orders
from .exponential_basis import GridBasis
from .march import set_times
from .quadrature import integrals_of_rows, radau_nodes
from .structures import TABULATED, Limits, VaryingOrders


class VaryingBasis(GridBasis):
    """Rates of exponentials for ``t**(a-1) / Gamma(a)``, all a in [0, 1], between two time lags."""

    # the SLOW_NODES slowest rates come first

    def weights(self, orders: np.ndarray) -> np.ndarray:
        """Return the weights of the exponentials for kernels of the k orders a; shape (M, k)."""
        ratio = self.farthest / self.closest
        found = _slow_first(weights_of_orders(1 - orders, ratio, self.tol))
        return found * self.closest ** (orders - 1) * rgamma(orders)

    def _down_to(self, closest: float) -> VaryingBasis:
        return varying_basis(closest, self.farthest, self.tol)


NOTHING_VARIES = VaryingBasis(0.0, np.inf, 0.0, np.zeros(0), np.inf)


def varying_basis(closest: float, farthest: float, tol: float) -> VaryingBasis:
    """Return the rates for the kernels of all orders in [0, 1] between two time lags."""
    rates, spacing, _ = bank_of_all_orders(farthest / closest, tol)
    return VaryingBasis(closest, farthest, tol, _slow_first(rates) / closest, spacing)


def _slow_first(rows: np.ndarray) -> np.ndarray:
    """Return rows with those of the `SLOW_NODES` slowest rates moved from the end to the front."""
    # the grid comes last, because a refinement adds faster rates after it
    return np.concatenate([rows[-SLOW_NODES:], rows[:-SLOW_NODES]])


class OrderTables:
    """Integrals and mode weights of the varying orders at the nodes of one step."""

    def __init__(self, varying: tuple[VaryingOrder, ...], s: int) -> None:
        # tabulated: start and length of the valid step, and of the one that the march requests;
        # starts count from the origin. integrals (n_v, s, s): row i from the start of the step to
        # node i, with the order there. weights (n_v, M, s): of modes, with the order at each node.
        self._varying, self._nodes = varying, radau_nodes(s)
        self.tabulated = record(TABULATED, start=np.nan, length=np.nan)
        self.integrals = np.zeros((len(varying), s, s))
        self.weights = np.zeros((len(varying), 0, s))

    def clear(self) -> None:
        """Mark the tables as valid for no step."""
        self.tabulated["start"] = self.tabulated["length"] = np.nan

    def compiled(self, of_varying: np.ndarray) -> VaryingOrders:
        """Return the tables as `VaryingOrders` for compiled code."""
        # of_varying (M,): 1 for the modes of varying orders, 0 for others
        if self.weights.shape[1] != of_varying.size:
            self.clear()
            self.weights = np.zeros((len(self.weights), of_varying.size, self._nodes.size))
        return VaryingOrders(self.tabulated, self.integrals, self.weights, of_varying)

    def fill(self, orbit: Any, origin: float, limits: Limits) -> None:
        """Fill the tables for the requested step; raise `OrderFailed` for an order out of range."""
        t, h = float(self.tabulated["next_start"]), float(self.tabulated["next_length"])
        times = np.empty(self._nodes.size)
        set_times(origin, t, h, self._nodes, limits, times)
        n = orbit.bank.n_modes
        if self.weights.shape[1] != n:
            self.weights = np.zeros((len(self._varying), n, self._nodes.size))
        a = np.empty((len(self._varying), times.size))  # orders of integration at the nodes
        for row, order in zip(a, self._varying, strict=True):
            row[:] = order.derivative - order.at(times)
        self.integrals[:] = h ** a[:, :, None] * integrals_of_rows(self._nodes.size, a)
        weights, last = orbit.varying.weights(a.ravel()).reshape(-1, *a.shape), orbit.bank.n_real
        self.weights[:, last - len(weights) : last] = weights.swapaxes(0, 1)
        self.tabulated["start"], self.tabulated["length"] = t, h
