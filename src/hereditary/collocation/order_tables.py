"""Tables of varying orders for one step: integrals and mode weights at its nodes."""

import numpy as np

from ..compiled.adaptive import set_times
from ..compiled.structures import TABULATED, VaryingOrders, record
from ..equation.orders import OrderFailed
from .quadrature import integrals_of_rows, radau_nodes


class OrderTables:
    """Integrals and mode weights of the varying orders at the nodes of one step.

    Parameters
    ----------
    varying : tuple of VaryingOrder
    s : int
        Nodes of a step.

    Attributes
    ----------
    tabulated : record of `TABULATED`
        Start, since the origin, and length of the step that the tables hold for, and of the step
        that is requested.
    integrals : ndarray, shape (n_v, s, s)
        Row i integrates values at the nodes over the step, with the order at node i.
    weights : ndarray, shape (n_v, M, s)
        Weights of the modes with the order at each node.
    """

    def __init__(self, varying, s):
        self._varying, self._nodes = varying, radau_nodes(s)
        self.tabulated = record(TABULATED, start=np.nan, length=np.nan)
        self.integrals = np.zeros((len(varying), s, s))
        self.weights = np.zeros((len(varying), 0, s))

    def clear(self):
        """Mark the tables as valid for no step."""
        self.tabulated["start"] = self.tabulated["length"] = np.nan

    def compiled(self, of_varying):
        """Return the tables for compiled code, with modes told by `of_varying` (M,)."""
        if self.weights.shape[1] != of_varying.size:
            self.clear()
            self.weights = np.zeros((len(self.weights), of_varying.size, self._nodes.size))
        return VaryingOrders(self.tabulated, self.integrals, self.weights, of_varying)

    def fill(self, orbit, origin, limits):
        """Fill the tables for the requested step; raise `OrderFailed` for a bad order."""
        t, h = float(self.tabulated["next_start"]), float(self.tabulated["next_length"])
        times = np.empty(self._nodes.size)
        set_times(origin, t, h, self._nodes, limits, times)
        n = orbit.rates.size
        if self.weights.shape[1] != n:
            self.weights = np.zeros((len(self._varying), n, self._nodes.size))
        a = np.empty((len(self._varying), times.size))  # orders of integration
        for row, order in zip(a, self._varying, strict=True):
            values, trouble = order.sampled(times)
            if trouble:
                raise OrderFailed(trouble)
            row[:] = order.derivative - values
        self.integrals[:] = h ** a[:, :, None] * integrals_of_rows(self._nodes.size, a)
        weights = orbit.varying.weights(a.ravel())
        first = n - len(weights)
        self.weights[:, first:] = weights.reshape(len(weights), *a.shape).swapaxes(0, 1)
        self.tabulated["start"], self.tabulated["length"] = t, h
