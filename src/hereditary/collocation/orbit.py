"""Orbit and tangents of an adaptive march, with their history.

Index 0 of an array is the orbit; indices 1 to k are tangents, its derivatives along given
directions. Each has present values, initial values, and a history. The history is the exponential
modes and the values on the last step, whose time lag is too short for the modes.

Letters of shapes: d components, s nodes, R rows of the equations, M modes, n convolution terms.
There are n_q integrands: f, p and y, and p' if needed. The primary unknown p is y, or y' for orders
above 1. Row c < d is p of component c, row d + c the terms subtracted from its right-hand side.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from scipy.special import rgamma

from ..compiled.jit import checked
from ..compiled.linalg import product
from ..equation.system import System
from ..kernels.memory_kernel import NO_ERRORS, KernelErrors, MemoryKernel
from ..kernels.mode_bank import damping
from .equations import Form
from .exponential_basis import KernelBasis, kernel_basis
from .first_rule import LEFT_OUT, NEXT_TO_0, Variable, at_rule, graded_rule
from .modes import Modes, joined, no_modes, opened, opened_once, over_step
from .operators import ITSELF, SLOPE
from .structures import Equations, OrbitArrays


class OrbitAndTangents:
    """Arrays whose first axis runs over the orbit and k tangents."""

    _singular: tuple[Variable, np.ndarray] | None
    _prefitted: tuple[float, KernelBasis] | None
    _equations: tuple[System, Equations, bool] | None

    def __init__(self, form: Form, y0: np.ndarray, n_nodes: int) -> None:
        # y0 (1 + k, m, d); x, p (1 + k, d): present y and primary unknown. initial (1 + k, d): p(0)
        # plus modes of rate 0, or 0 if the row of p is implicit. offsets (1 + k, n): subtracted
        # from the integrands of n terms in later steps. modes, before (1 + k, R, M): now and at the
        # start of the last step, ordered as in bank; varying orders have some without weights in d
        # further rows, the last ones, for each integrand. last (1 + k, 3 or 4, d, s): f, p, y, and
        # p' where it is an integrand, at the nodes of the last ordinary step. Fields of sums,
        # `Modes`, are attributes as well.
        self._form = form
        n_columns, _, d = y0.shape
        self.x = y0[:, 0].copy()
        self.initial = np.where(form.above_one == 1, y0[:, -1], y0[:, 0])
        self.p = self.initial.copy()
        constants = np.array([0 * self.initial, self.initial, y0[:, 0]])
        self.offsets = self._last_offsets = self._of_terms(constants)
        self.initial[:, form.implicit != 0] = 0.0
        self._n_rows = form.n_rows + d * form.unweighted.size
        self.modes = self.before = np.zeros((n_columns, self._n_rows, 0))
        self.last = np.zeros((n_columns, form.n_integrands, d, n_nodes))
        self.last_length, self.since, self._singular, self._prefitted = 0.0, 0.0, None, None
        self._equations = None
        self._take(no_modes(len(form.varying), n_nodes))

    def _of_terms(self, constants: np.ndarray) -> np.ndarray:
        """Return the constant subtracted from the integrand of each term, (1 + k, n)."""
        # constants (3, 1 + k, d): 0, p(0) and y(0) of each component
        components = self._form.terms["row"] % constants.shape[2]
        return np.ascontiguousarray(constants[self._form.offset_of, :, components].T)

    @property
    def farthest(self) -> float:
        """Largest time lag at which all modes are accurate; 0 before the first fit."""
        return min(self.power_laws.farthest, self.kernels.farthest)

    @property
    def closest(self) -> float:
        """Smallest time lag at which all modes are accurate."""
        return max(self.power_laws.closest, self.varying.closest)

    def __getstate__(self) -> dict[str, Any]:
        """Return the attributes for pickling."""
        # without the form, whose functions may not pickle, and what `adopt` makes again
        left_out = ("sums", "bank", "weights", "masses", "of_varying", "_form", "_equations")
        return {name: value for name, value in vars(self).items() if name not in left_out}

    def adopt(self, form: Form) -> None:
        """Attach the form, which a pickled orbit does not contain."""
        self._form, self._equations = form, None
        self._join(self.power_laws, self.kernels, self.varying)

    def _join(self, *sums: Any) -> None:
        """Take sums of power laws, general kernels and varying orders as the modes."""
        self._take(joined(len(self._form.varying), self.last.shape[3], *sums))

    def _take(self, sums: Modes) -> None:
        """Take these `Modes`."""
        self.sums = sums
        self.power_laws, self.kernels, self.varying = sums.power_laws, sums.kernels, sums.varying
        self.bank, self.weights, self.masses = sums.bank, sums.weights, sums.masses
        self.of_varying = sums.of_varying

    def equations(
        self,
        system: System,
        t_end: float,
        least: tuple[np.ndarray, np.ndarray, np.ndarray],
    ) -> tuple[Equations, bool]:
        """Return `Equations` of a system, and if any offset is not 0, for a run to t_end."""
        # least: fields sources, least and divisors. Made once for a system, and again after a jump,
        # which changes the offsets.
        known = self._equations
        if known is None or known[0] is not system or known[1].offsets is not self.offsets:
            form = self._form
            found = Equations(
                form.terms, form.orders, form.above_one, self.offsets, form.implicit,
                form.unweighted, form.kinds, system.units(t_end), system.rates(t_end),
                *least,
            )  # fmt: skip
            self._equations = known = system, checked(found), bool(self.offsets.any())
        return known[1:]

    def march_arrays(self) -> OrbitArrays:
        """Return the arrays as `OrbitArrays`; compiled code changes them in place."""
        return OrbitArrays(self.initial, self.x, self.p, self.modes, self.before, self.last)

    def linear_arrays(self) -> list[np.ndarray]:
        """Return all arrays whose entries are linear in the solution, for orbit and tangents."""
        present = [self.x, self.p, self.initial, self.offsets]
        found = [*present, self.modes, self.before, self.last]
        return found if self._singular is None else [*found, self._singular[1]]

    def transform(self, matrix: np.ndarray) -> None:
        """Replace the tangents by linear combinations, ``tangent <- tangent @ matrix``."""
        for array in self.linear_arrays():
            array[1:] = np.tensordot(matrix.T, array[1:], axes=1)

    def record_step(self, length: float, since: float) -> None:
        """Record the length of the last step, an ordinary one, and the time since the last stop."""
        self.last_length, self.since = length, since
        self._singular, self._last_offsets = None, self.offsets

    def prefit_kernels(
        self, closest: float, farthest: float, t_end: float, tol: float
    ) -> KernelErrors:
        """Fit all general kernels before the run if any is given by values; return the errors."""
        # arguments as of `open_modes`
        if not any(kernel.by_values for kernel in self._form.kernels):
            return NO_ERRORS
        closest = round_to_decades(closest, farthest)
        found = kernel_basis(self._form.kernels, closest, farthest, t_end, tol)
        self._prefitted = closest, found
        return found.errors

    def open_modes(self, closest: float, farthest: float, t_end: float, tol: float) -> None:
        """Fit kernels for time lags `closest` to `farthest`; set the modes to those at t = 0."""
        # t_end: largest time lag of kernels given by values; tol: relative error
        closest = round_to_decades(closest, farthest)
        how = self._form, self.last.shape[3], closest, farthest, t_end, tol
        if not self._prefitted:
            self._take(opened_once(*how))
        else:
            kernels = self._prefitted[1] if self._prefitted[0] <= closest else None
            self._take(opened(*how, kernels))
        self._clear_modes()

    def _clear_modes(self) -> None:
        """Set all modes to their values at t = 0."""
        self.modes = np.zeros((self.x.shape[0], self._n_rows, self.of_varying.size))
        self._take_start(slice(None))
        self.before = self.modes.copy()

    def _take_start(self, modes: slice | np.ndarray) -> None:
        """Add y(0) to the modes with these indices where y jumps from 0 at the start."""
        d, unweighted = self.x.shape[1], self._form.unweighted.tolist()
        for q, c in self._form.jumping:
            row = (2 + unweighted.index(q)) * d + c
            self.modes[:, row, modes] += np.multiply.outer(self.x[:, c], self.of_varying[modes])

    def finish_singular_start(self, variable: Variable, length: float, values: np.ndarray) -> None:
        """Advance the modes to the end of the first step after a singular start."""
        # values (1 + k, 3, d, n): f, p and y at the n nodes of this step
        self.last_length, self.since, self._singular = length, length, (variable, values)
        self._last_offsets = self.offsets
        rates = self.power_laws.rates
        if rates.size and rates[0] == 0.0:  # see absorb_constant_mode
            d = self.x.shape[1]
            self.initial += self.modes[:, :d, 0]
            self.modes[:, :d, 0] = 0.0
        self.before = self.modes
        self.modes = self._advanced(self.before)

    def shift(self, change: np.ndarray) -> None:
        """Add `change` (d,) to y of the orbit, and to p(0) and y(0), to which the memory refers."""
        # p(0) and y(0) change as well to keep the jump out of the memory
        of_p = np.where(self._form.above_one == 1, 0.0, change)
        constants = np.array([0 * change, of_p, change])[:, None]
        self.x[0] += change
        self.p[0] += of_p
        self.initial[0] += np.where(self._form.implicit == 0, of_p, 0.0)
        self.offsets = self.offsets.copy()
        self.offsets[0] += self._of_terms(constants)[0]

    def jump_to(self, p: np.ndarray, x: np.ndarray) -> None:
        """Set p and x (= y), (1 + k, d), after a jump; the modes of terms with p' get the jump."""
        d = x.shape[1]
        for c, q, k, coefficient in self._form.listed:
            if q == SLOPE and k != ITSELF:
                self.modes[:, c] += coefficient * self.weights[k] * (p - self.p)[:, c % d, None]
        self.p, self.x = p, x

    def refine(self, closest: float) -> None:
        """Refine the modes down to the time lag `closest`; new ones contain only the last step."""
        n, end = self.power_laws.rates.size, self.bank.n_real
        power_laws, varying = self.power_laws.refine(closest), self.varying
        if self._form.varying:
            varying = varying.refine(closest)
        self._join(power_laws, self.kernels, varying)
        more, in_all = self.power_laws.rates.size - n, self.bank.n_real - end
        places = np.repeat([n, end], [more, in_all - more])
        self.modes, self.before = (
            np.insert(old, places, 0.0, axis=2) for old in (self.modes, self.before)
        )
        added = np.r_[n : n + more, end + more : end + in_all]
        if self.last_length == 0.0:  # no step yet: the history is the start alone
            self._take_start(added)
            self.before = self.modes.copy()
        else:
            self.modes[..., added] = self._advanced(np.zeros_like(self.modes))[..., added]

    def history(self, log_distances: np.ndarray) -> np.ndarray:
        """Return the history of every row at n later times, (1 + k, R, n), without p(0)."""
        # log_distances (n,): logarithms of times from now, which may be smaller than any float
        distances = np.exp(log_distances)
        base = np.zeros((len(self.x), self._form.n_rows, distances.size))
        if self.last_length == 0.0:
            return base
        # the last step by quadrature, because its time lag is too short for the modes; all earlier
        # steps by the modes
        damped = damping(self.bank.rates, self.last_length + distances).conj()
        base += self.before @ self.bank.real_modes(damped, axis=0)
        _, v, weights = graded_rule()
        variable, values = self._nodal()
        log_u, integrands = log_distances - np.log(self.last_length), values @ at_rule(variable).T
        for row, (c, q, k, coefficient) in enumerate(self._form.listed):
            if k == ITSELF:
                continue
            kernel, of_rest = self._over_last_step(k, log_u, v)
            offset, j = self._last_offsets[:, row, None], c % self.x.shape[1]
            part = (integrands[:, q, j] - offset) @ (weights * kernel).T
            part += (self._ends(q)[:, j, None] - offset) * of_rest
            base[:, c] += coefficient * part
        return base

    def _over_last_step(
        self, k: int, log_u: np.ndarray, v: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the kernel of order or kernel number k at lags u + v, (n, K), in last steps."""
        # Also its integrals from u to u + LEFT_OUT, (n,); both times the length of the last step.
        # Lags u (n,) and v (K,) are over this length.
        u, h = np.exp(log_u), self.last_length
        lags, ends = np.add.outer(u, v), np.add.outer([LEFT_OUT, 0.0], u)
        if k < self._form.orders.size:
            a = self._form.orders[k]
            # u may be below all numbers where u**a is not small
            of_rest = (ends[0] ** a - np.exp(a * log_u)) / a
            return h**a * rgamma(a) * lags ** (a - 1), h**a * rgamma(a) * of_rest
        kernel = self.kernel(k - self._form.orders.size)
        integrals = kernel.integral(np.maximum(h * ends, NEXT_TO_0))
        return h * kernel(np.maximum(h * lags, NEXT_TO_0)), integrals[0] - integrals[1]

    def kernel(self, k: int) -> MemoryKernel:
        """Return general kernel number k, or the sum that replaces it if it is measured."""
        kernel, sums = self._form.kernels[k], self.kernels.sums
        if not sums and self._prefitted:
            sums = self._prefitted[1].sums
        return sums[k] if kernel.measured and sums else kernel

    def _ends(self, q: int) -> np.ndarray:
        """Return integrand number q at the end of the last step, (1 + k, d)."""
        values = self.last if self._singular is None else self._singular[1]
        return values[:, q, :, -1]

    def _nodal(self) -> tuple[Variable, np.ndarray]:
        """Return the last step's variable, maybe time, and its integrands (1 + k, n_q, d, s)."""
        return self._singular or (Variable(n=self.last.shape[-1]), self.last)

    def _advanced(self, modes: np.ndarray) -> np.ndarray:
        """Return the modes at the end of the last step, from those at its start, (1 + k, R, M)."""
        bank, d = self.bank, self.x.shape[1]
        variable, values = self._nodal()
        step = over_step(bank, variable, self.last_length)
        nodal = np.ascontiguousarray(values.reshape(-1, variable.n))
        found = np.empty((len(nodal), step.gains.shape[1]))
        product(nodal, step.gains, found)
        integrals = found.reshape(*values.shape[:-1], -1)
        advanced = bank.complex_modes(modes) * step.at_end
        for b, q in enumerate(self._form.unweighted):
            part = bank.complex_modes(self.of_varying * integrals[:, q])
            advanced[:, (2 + b) * d : (3 + b) * d] += part
        for q, k, coefficient, rows, numbers in self._form.groups:
            if k == ITSELF:
                continue
            offsets = np.multiply.outer(self._last_offsets[:, numbers], step.integrals)
            part = bank.complex_modes(integrals[:, q, rows % d] - offsets)
            advanced[:, rows] += coefficient * bank.weights[k] * part
        return bank.real_modes(advanced)


def round_to_decades(closest: float, farthest: float) -> float:
    """Return the largest ``farthest / 10**k`` up to `closest`, so that similar runs share fits."""
    return farthest / 10.0 ** math.ceil(math.log10(max(farthest / closest, 10.0)))


def initial_unknowns(
    system: System, above_one: np.ndarray, directions: np.ndarray | None
) -> np.ndarray:
    """Return y(0), and y'(0) if m = 2, of the orbit and of k tangents, shape (1 + k, m, d)."""
    # directions (n_data, k): changes of y(0), then of y'(0) where above_one (d,) is true
    if directions is None:
        return system.y0[None]
    values = np.zeros((1 + directions.shape[1], *system.y0.shape))
    values[0] = system.y0
    values[1:, 0] = directions[: system.d].T
    if system.m == 2:
        values[1:, 1, above_one] = directions[system.d :].T
    return values
