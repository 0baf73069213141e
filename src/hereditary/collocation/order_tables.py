"""Tables of orders that vary, for one step (floor 4): integrals and weights at its nodes."""

import numpy as np

from ..kernels.adaptive import times_inside
from ..kernels.structures import KNOWN, record
from ..orders import OrderFailed
from .quadrature import radau_integrals, radau_nodes

# Integrals are interpolated in their order, of which they are entire functions, to rounding.
_N_ORDERS = 24


class OrderTables:
    """The orders at the nodes of one step.

    Parameters
    ----------
    varying : tuple of VaryingOrder
    s : int
        Nodes of a step.

    Attributes
    ----------
    known : record of `KNOWN`
        Start, since the origin, and length of the step that the tables hold for, and of the one
        that is wanted.
    integrals : ndarray, shape (n_v, s, s)
        From values at the nodes to the integrals, of the order at each node, over the step.
    weights : ndarray, shape (n_v, M, s)
        Of the modes, at each node.
    """

    def __init__(self, varying, s):
        self._varying, self._nodes = varying, radau_nodes(s)
        self.known = record(KNOWN, start=np.nan, length=np.nan)
        self.integrals = np.zeros((len(varying), s, s))
        self.weights = np.zeros((len(varying), 0, s))
        k = np.arange(_N_ORDERS)
        self._orders = (1 - np.cos(np.pi * (k + 0.5) / _N_ORDERS)) / 2
        self._shares = (-1.0) ** k * np.sin(np.pi * (k + 0.5) / _N_ORDERS)
        if varying:
            self._table = np.array([radau_integrals(s, a) for a in self._orders])

    def forget(self):
        """Hold for no step."""
        self.known.start = self.known.length = np.nan

    def tell(self, strands, origin, t_stop):
        """Work out the tables of the step that is wanted; raise `OrderFailed` for a bad order."""
        t, h = float(self.known.next_start), float(self.known.next_length)
        times = times_inside(origin, t, h, self._nodes, t_stop)
        n = strands.rates.size
        if self.weights.shape[1] != n:
            self.weights = np.zeros((len(self._varying), n, self._nodes.size))
        a = np.empty((len(self._varying), times.size))  # orders of integration
        for row, order in zip(a, self._varying, strict=True):
            values, trouble = order.sampled(times)
            if trouble:
                raise OrderFailed(trouble)
            row[:] = order.derivative - values
        self.integrals[:] = h ** a[:, :, None] * self._interpolated(a)
        own = strands.varying.weights(a.ravel())
        self.weights[:, n - len(own) :] = own.reshape(len(own), *a.shape).swapaxes(0, 1)
        self.known.start, self.known.length = t, h

    def _interpolated(self, a):
        """Row i of the integrals of order a_i, (n_v, s, s), by the barycentric formula."""
        off = a[:, :, None] - self._orders
        met = off == 0.0
        if met.any():
            shares = np.where(met.any(axis=2, keepdims=True), met, self._shares / (off + met))
        else:
            shares = self._shares / off
        shares /= shares.sum(axis=2, keepdims=True)
        return np.einsum("vik,kij->vij", shares, self._table)
