"""Memory terms that the right-hand side reads, as further components of a larger system.

The equation is ``c D^alpha y + sum_l c_l D^(gamma_l) y = f(t, y, m)``, where alpha is the highest
order and m = D^gamma y is a memory term that f reads. Let F = D^alpha y. Then:

- For alpha up to 1, m solves ``D^(alpha-gamma) m = F``.
- For alpha above 1, v = y' solves ``D^(alpha-1) v = F``. For gamma < 1, m solves
  ``D^(1-gamma) m = v``. For gamma = 1, m is v. For gamma > 1, m solves ``D^(alpha-gamma) m = F``.

All components of the larger system have orders up to 1. Memory has m(0) = 0, because y solves the
equation. The lower terms on the left side become components m_l as well. So F is
``(f - sum_l c_l m_l) / c``.

The convolution m of a general kernel is found from the balance of m and the convolution. A
component without a derivative has the algebraic row 0 = f. If f reads derivatives of it, the
highest one is a component of the larger system, which the algebraic row determines.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from scipy.special import rgamma

from ..compiled.functions import mapped
from ..compiled.reach import SMALL
from ..equation.chain import left_of
from ..equation.frame import Frame
from ..equation.system import System
from ..equation.terms import ConstantOrder, KernelOperator, Operator
from ..kernels.memory_kernel import MemoryKernel
from ..kernels.named_kernels import GammaDensity, TemperedPowerLaw
from ..stepping.dense import Piece
from ..support.checks import refuse
from .algebraic import derivatives_at_start
from .exponential_basis import integral_if_rising

# Least size of the memory of a kernel that rises, as fraction of its size in the end if its source
# is constant. Without one a lognormal density of mean 5 and standard deviation 1.9 ends after one
# step; with 1 the errors are the same.
_OF_MEMORY = 0.1


class Plain:
    """Conversion between the equation and the system of a stepper, if both are the same."""

    _convolved: list[tuple[int, int, MemoryKernel]]

    def __init__(self, system: System) -> None:
        # above_one (d,): True for components of y whose first derivative is an unknown
        self.system, self.above_one, self._convolved = system, system.above_one, []

    def directions(self, directions: np.ndarray | None) -> np.ndarray | None:
        """Return k directions of initial data of the equation as those of the system, or None."""
        return directions

    def values(self, x: np.ndarray, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return y and y', (..., d) each, from values x and slopes p; NaN if y' is no unknown."""
        return x.copy(), np.where(self.above_one, p, np.nan)

    def piece(self, piece: Piece) -> Piece:
        """Return the dense output of y from that of the system."""
        return piece

    def least(
        self, t_end: float, error: float, by_size: float
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return sources, least sizes and divisors of components, fields of `Equations`."""
        # 0 but for memory of kernels, whose least size is a part of what its source makes of it in
        # a run to t_end. The part is larger if the kernel rises, or if its sum misses it by an
        # error above by_size: a step may err by by_size of the least size.
        d, share = self.system.d, max(_OF_MEMORY, error / by_size) if by_size else _OF_MEMORY
        sources, least, divisors = np.arange(d), np.zeros(d), np.zeros(d)
        for place, source, kernel in self._convolved:
            rising = integral_if_rising(kernel, t_end)
            whole = abs(float(kernel.integral(min(t_end, kernel.t_last))))
            floor = max(SMALL, error / by_size if by_size and error > by_size else 0.0)
            sources[place], least[place] = source, max(floor * whole, share * rising)
            divisors[source] = _OF_MEMORY * rising
        return sources, least, divisors

    def widened(self, change: np.ndarray) -> np.ndarray:
        """Return the change of all components for a change of y or of all arguments of f."""
        return change

    def seen(self, x: np.ndarray) -> np.ndarray:
        """Return the arguments of f, y here, from the components x of the system."""
        return x


class Reading(Plain):
    """Conversion between an equation whose f reads memory and the larger system without memory."""

    def __init__(self, system: System) -> None:
        # the n components of the larger system begin with the d components of y
        found = reduced(system)
        self.system, self.above_one, self._speeds, self._read, self._copies, self._convolved = found
        self._d, self._n_read = system.n_solved, system.d

    def directions(self, directions: np.ndarray | None) -> np.ndarray | None:
        """Return k directions of initial data of the equation as those of the system, or None."""
        if directions is None:
            return None
        wide = np.zeros((self.system.d, directions.shape[1]))
        wide[: self._d] = directions[: self._d]
        wide[self._speeds[self.above_one]] = directions[self._d :]
        return wide

    def values(self, x: np.ndarray, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return y and y', (..., d) each, from values x and slopes p; NaN if y' is no unknown."""
        speeds = np.where(self.above_one, x[..., self._speeds], np.nan)
        return x[..., : self._d].copy(), speeds

    def piece(self, piece: Piece) -> Piece:
        """Return the dense output of y from that of the system."""
        return ReadingPiece(piece, self._speeds, self.above_one, self.system.d)

    def widened(self, change: np.ndarray) -> np.ndarray:
        """Return the change of all components for a change of y or of all arguments of f."""
        found = np.pad(change[: self._d], (0, self.system.d - self._d))
        for copy, source in self._copies:
            found[copy] = found[source]
        for row, place, factor in self._read[self._d :]:
            if row < change.size and change[row] != 0:
                found[place] += change[row] / factor
        return found

    def seen(self, x: np.ndarray) -> np.ndarray:
        """Return the arguments of f, y and memory, from the components x (n,) of the system."""
        found = np.zeros(self._n_read)
        for row, place, factor in self._read:
            found[row] += factor * x[place]
        return found


@dataclass(frozen=True, eq=False)
class ReadingPiece(Piece):
    """Dense output of y, and perhaps of its tangents, among the components of a larger system."""

    inner: Piece
    speeds: np.ndarray  # (d,), number of the component that is y', for orders above 1
    above_one: np.ndarray  # (d,)
    n: int  # number of components of the larger system

    def edges(self) -> np.ndarray:
        """Return the start time of each step."""
        return self.inner.edges()

    def evaluate(self, t: np.ndarray, derivative: int) -> np.ndarray:
        """Return y, or y' for ``derivative=1``, at times t inside the steps, (k, d)."""
        found = self._columns(t, derivative)[..., : self.speeds.size]
        if derivative and self.above_one.any():
            found = np.where(self.above_one, self._columns(t, 0)[..., self.speeds], found)
        return found.reshape(len(t), found.shape[1] * self.speeds.size)

    def _columns(self, t: np.ndarray, derivative: int) -> np.ndarray:
        """Return all n components of orbit, column 0, and tangents at k times: (k, columns, n)."""
        found = self.inner.evaluate(t, derivative)
        return found.reshape(len(t), found.shape[1] // self.n, self.n)


class Reduced(NamedTuple):
    """A system in which further components replace the memory that f reads."""

    system: System  # the larger system
    above_one: np.ndarray  # (d,), True if y' of a component of y is an unknown
    speeds: np.ndarray  # (d,), number of the component that is y'
    # entries (row, component, factor) of the matrix from components to the arguments of f
    arguments: list[tuple[int, int, float]]
    copies: list[tuple[int, int]]  # pairs of component numbers; the first equals the second
    # a component, its source, and the kernel by whose convolution with the source it is made
    convolved: list[tuple[int, int, Any]]


def reduced(system: System) -> Reduced:
    """Return the `Reduced` system, in which components replace the memory that f reads."""
    for operator, _ in system.left:
        if operator.lower(0) is None:
            required = "hold Caputo operators of constant order and kernels with Collocation, where"
            refuse("terms", f"{required} memory is read", f"{operator}", "take L1")
    return _Reduction(system).result()


class _Reduction:
    """Construction of the system in which further components replace memory."""

    def __init__(self, system: System) -> None:
        # F_j: highest derivative of y_j, or its algebraic right-hand side. _terms: (operator,
        # component, coefficient) on the left side; a component without one has an algebraic row.
        # _forces: (row, j) of a row with F_j on its right side. _own: (row, component, factor) of
        # the linear right sides. _places: component that is an operator, or a derivative of some
        # order, of y_j. _rows: row of F_j for each y_j without a derivative.
        self._system, d = system, system.n_solved
        self._bare = system.algebraic
        self._leading = _leading_orders(system)
        self._before = np.where(self._bare, 1.0, system.leading[:d])
        self._starts: list[float] = []
        self._of_y: list[int] = []
        self._terms: list[tuple[Any, int, float]] = []
        self._own: list[tuple[int, int, float]] = []
        self._forces: list[tuple[int, int]] = []
        self._copies: list[tuple[int, int]] = []
        self._convolved: list[tuple[int, int, Any]] = []
        self._places: dict[tuple[int, Any], int] = {}
        for j, start in enumerate(system.y0[0, :d].tolist()):
            self._add(start, j)
        above_one = np.flatnonzero(self._leading > 1).tolist()
        self._speeds = np.zeros(d, dtype=np.int64)
        self._speeds[above_one] = d + np.arange(len(above_one))
        for j in above_one:
            self._places[j, 1.0] = self._add(float(system.y0[1, j]), j)
        # the row of F_j for each j with an algebraic row
        self._rows = dict.fromkeys(np.flatnonzero(self._bare).tolist(), -1)
        starts = derivatives_at_start(system) if self._rows else {}
        for j in self._rows:
            self._rows[j] = j
            if self._leading[j] > 0:
                place = self._add(starts.get(j, 0.0), j)
                self._rows[j] = self._places[j, self._leading[j]] = place
        for j, order in enumerate(self._leading.tolist()):
            if order > 1:
                self._derive(j, 1.0, int(self._speeds[j]), j)
                self._derive(int(self._speeds[j]), order - 1, None, j)
            elif order > 0:
                self._derive(j, order, None, j)

    def _add(self, start: float, j: int) -> int:
        """Add a component of y_j with the initial value `start`; return its number."""
        self._starts.append(start)
        self._of_y.append(j)
        return len(self._starts) - 1

    def _derive(self, place: int, order: float, origin: int | None, j: int) -> None:
        """Add the equation that the derivative of component `place`, of this order, is `origin`."""
        # origin None: the derivative is D^alpha y_j
        coefficient = 1.0
        if origin is None and self._bare[j]:
            origin = self._places[j, self._leading[j]]
        if origin is None:
            coefficient = float(self._before[j])
            self._forces.append((place, j))
        else:
            self._own.append((place, origin, 1.0))
        self._terms.append((ConstantOrder(float(order)), place, coefficient))

    def _place(self, j: int, operator: Any) -> int:
        """Return the number of the component that equals an operator applied to y_j."""
        if not operator.constant:
            return self._convolution(j, operator)
        gamma, leading = operator.order, self._leading[j]
        if (j, gamma) not in self._places:
            place = self._places[j, gamma] = self._add(0.0, j)
            if leading > 1 and gamma < 1:
                self._derive(place, 1 - gamma, int(self._speeds[j]), j)
            else:
                self._derive(place, leading - gamma, None, j)
        return self._places[j, gamma]

    def _convolution(self, j: int, operator: KernelOperator) -> int:
        """Return the number of the component m that is a kernel's convolution with y_j or y_j'."""
        # The row of w, equal to the convolved function, balances m and the convolution. The row of
        # m is algebraic: w equals that function. If y_j has an algebraic row itself, w is y_j, and
        # its row becomes that of m. The convolution with x' is m = z', z being that with x - x(0),
        # which has its own equation, so its relative error is small.
        if (j, operator) in self._places:
            return self._places[j, operator]
        if in_stages(operator):
            place = self._places[j, operator] = self._delayed(j, operator.kernel)
            return place
        place = total = self._places[j, operator] = self._add(0.0, j)
        derived = operator.derivative > 0
        source = int(self._speeds[j]) if derived and self._leading[j] > 1 else j
        if operator.derivative - (source != j) == 1:
            if self._leading[j] == 0:
                required = f"convolve y of component {j}, which has no derivative, and not y'"
                refuse("memory", required, f"{operator}", "state the term on the left-hand side")
            moved = self._add(0.0, j)
            self._derive(moved, self._leading[j] - (source != j), None, j)
            carrier, total = self._add(0.0, j), self._add(0.0, j)
            self._terms.append((ConstantOrder(1.0), total, 1.0))
            self._own += [(place, moved, 1.0), (place, carrier, -1.0)]
            self._own += [(total, place, 1.0), (carrier, total, 1.0)]
        elif self._rows.get(source) == source:
            self._rows[j] = place
            carrier = j
            self._own.append((carrier, place, 1.0))
        else:
            carrier = self._add(self._starts[source], j)
            self._own += [(place, source, 1.0), (place, carrier, -1.0), (carrier, place, 1.0)]
            self._copies.append((carrier, source))
        self._terms.append((KernelOperator(operator.kernel, 0), carrier, 1.0))
        self._convolved.append((total, carrier, operator.kernel))
        return place

    def _delayed(self, j: int, kernel: Any) -> int:
        """Return the number of the component that is a gamma density's convolution with y_j."""
        # A density of shape n + b is a convolution of that of shape b, a tempered power law, and n
        # exponential ones. Each of these is an equation x' = rate (before - x), before being the
        # previous result.
        n, rest = kernel.stages
        before, factor = j, 1.0
        if rest > 0:
            tempered = KernelOperator(TemperedPowerLaw(1 - rest, kernel.rate), 0)
            before, factor = self._place(j, tempered), kernel.rate**rest * rgamma(rest)
        for _ in range(n):
            place = self._add(0.0, j)
            self._terms.append((ConstantOrder(1.0), place, 1.0))
            self._own += [(place, before, kernel.rate * factor), (place, place, -kernel.rate)]
            before, factor = place, 1.0
        return before

    def result(self) -> Reduced:
        """Return the `Reduced` system."""
        system, d = self._system, self._system.n_solved
        arguments = [(j, j, 1.0) for j in range(d)]
        lower: list[list[tuple[int, float]]] = [[] for _ in range(d)]
        for operator, coefficients in system.left:
            for c in np.flatnonzero(coefficients).tolist():
                j, factor = int(system.sources[c]), float(coefficients[c])
                if c != j:
                    arguments.append((c, self._place(j, operator), factor))
                elif operator.order < self._leading[j] or not operator.constant:
                    lower[j].append((self._place(j, operator), factor))
        forces = [*self._forces, *((row, j) for j, row in self._rows.items())]
        own = [*self._own, *((i, k, -c) for i, j in forces for k, c in lower[j])]
        n = len(self._starts)
        triples = [(i, j, 1.0) for i, j in forces]
        found = System(
            left_of(self._terms, n),
            np.array([self._starts]),
            mapped(system.functions, n, system.d, own, triples, arguments),
            of_y=system.of_y[self._of_y],
            frame=Frame(system.frame.start),
            rhs_digest=system.rhs_digest,
            callbacks=system.callbacks,
            by_params=system.by_params,
        )
        return Reduced(
            found, self._leading > 1, self._speeds, arguments, self._copies, self._convolved
        )


def is_read(system: System) -> bool:
    """Return whether a system has memory that further components replace."""
    if system.constant:
        return system.reads
    return system.reads or any(in_stages(operator) for operator, _ in system.left)


def in_stages(operator: Operator) -> bool:
    """Return whether an operator convolves y with a gamma density of shape 1 or more."""
    kernel, derivative = operator.kernel, operator.derivative
    return isinstance(kernel, GammaDensity) and kernel.in_stages and derivative == 0


def _leading_orders(system: System) -> np.ndarray:
    """Return the highest order of each component, (d,)."""
    # for an algebraic row that of its derivatives that f reads, which the row determines
    d, bare = system.n_solved, system.algebraic
    found = system.highest_orders()[:d].copy()
    for operator, coefficients in system.left:
        for c in np.flatnonzero(coefficients[d:]) + d if operator.constant else ():
            j = system.sources[c]
            found[j] = max(found[j], operator.order) if bare[j] else found[j]
    return found
