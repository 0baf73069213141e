"""The modes of a march: sums of exponentials of all kernels of its equations, over one bank.

They depend on the integral equations, on two time lags and on a tolerance alone. So equations with
the same terms share them, also if their right-hand sides, parameters or initial values differ.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from ..compiled.jit import checked
from ..compiled.linalg import product
from ..kernels.mode_bank import Bank, damping
from .equations import Form
from .exponential_basis import (
    NO_KERNELS,
    NO_POWER_LAWS,
    KernelBasis,
    PowerLawBasis,
    kernel_basis,
    power_law_basis,
)
from .first_rule import Variable, at_points, rule_of_modes
from .quadrature import shortened_legendre
from .structures import ExponentialBasis, Rule
from .varying import NOTHING_VARIES, VaryingBasis, varying_basis

# Modes are fitted for steps this many times shorter than the present one, and so is each
# refinement.
_REFINE_BY = 32.0
# Number of forms, and of fits of their kernels, whose modes remain in storage.
_MODES_MAX = 64
# Number of first steps whose modes remain in storage; each has 10 kB for 50 modes.
_STEPS_MAX = 512


class Modes(NamedTuple):
    """The sums of a march and what follows from them; M modes, n_a orders and n_k kernels.

    Varying orders are counted in n_k, and have weights and masses of 0.
    """

    power_laws: PowerLawBasis
    kernels: KernelBasis
    varying: VaryingBasis
    bank: Bank  # the three sums above, in this order
    weights: np.ndarray  # (n_a + n_k, M), of the modes for each fractional integral and kernel
    masses: np.ndarray  # (n_k,), point masses of the kernels at time lag 0
    of_varying: np.ndarray  # (M,), 1 for the modes of varying orders, 0 for others
    basis: ExponentialBasis  # the same for compiled code
    key: tuple  # what the factors of a step length depend on: nodes, rates and kernels


def joined(
    n_varying: int, s: int, power_laws: PowerLawBasis, kernels: KernelBasis, varying: VaryingBasis
) -> Modes:
    """Return the `Modes` of three sums of exponentials, the last one for `n_varying` orders."""
    # steps have s nodes
    size = varying.rates.size
    without = Bank(varying.rates, np.zeros((n_varying, size)))
    bank = Bank.of([power_laws, *kernels.sums, without])
    weights, n = bank.real_modes(bank.weights), bank.n_real
    masses = np.concatenate([kernels.masses, np.zeros(n_varying)])
    of_varying = np.zeros(bank.n_modes)
    of_varying[n - size : n] = 1.0
    rates = np.ascontiguousarray(bank.rates[:n].real), bank.rates[n:].astype(complex)
    basis = checked(ExponentialBasis(*rates, weights, masses, shortened_legendre(s)))
    n_kernels = masses.size - n_varying
    of_kernels = weights[weights.shape[0] - masses.size :][:n_kernels], masses[:n_kernels]
    key = s, n_varying, *(part.tobytes() for part in (*rates, *of_kernels))
    return Modes(power_laws, kernels, varying, bank, weights, masses, of_varying, basis, key)


def closest_lag(rule: Rule, h: float) -> float:
    """Return the shortest time lag of the modes for steps of length h and shorter ones."""
    return rule.nodes[0] * h / _REFINE_BY


@lru_cache(maxsize=_MODES_MAX)
def no_modes(n_varying: int, s: int) -> Modes:
    """Return the `Modes` before the first fit, which are none."""
    return joined(n_varying, s, NO_POWER_LAWS, NO_KERNELS, NOTHING_VARIES)


def opened(
    form: Form,
    s: int,
    closest: float,
    farthest: float,
    t_end: float,
    tol: float,
    kernels: KernelBasis | None = None,
) -> Modes:
    """Return the `Modes` for time lags from `closest` to `farthest`, to a relative error `tol`."""
    # t_end: largest time lag of kernels given by values; kernels: their sums, if fitted already
    power_laws = power_law_basis(form.orders.tolist(), closest, farthest, tol)
    if kernels is None:
        kernels = kernel_basis(form.kernels, closest, farthest, t_end, tol)
    varying = varying_basis(closest, farthest, tol) if form.varying else NOTHING_VARIES
    return joined(len(form.varying), s, power_laws, kernels, varying)


# The same modes for the same form, nodes, time lags and tolerance.
opened_once = lru_cache(maxsize=_MODES_MAX)(opened)


class OverStep(NamedTuple):
    """Values of the modes of one bank over the last step, before which they were 0."""

    # (n, M), integrals of the Lagrange polynomials of the n nodes times the modes
    gains: np.ndarray
    integrals: np.ndarray  # (M,), of the modes over the step
    at_end: np.ndarray  # (m,), decay of the m rates over the step


def over_step(bank: Bank, variable: Variable, length: float) -> OverStep:
    """Return what the rates of a bank have of a step with nodes in `variable`."""
    # it depends on rates, variable and length alone, and is made once for equal ones
    return _over_step(bank.rates.tobytes(), bank.rates.dtype, variable, length)


@lru_cache(maxsize=_STEPS_MAX)
def _over_step(rates: bytes, kind: np.dtype, variable: Variable, length: float) -> OverStep:
    bank = Bank(length * np.frombuffer(rates, kind), np.zeros((0, 0)))
    fastest = float(np.abs(bank.rates).max(initial=0.0))
    key, _, v, weights = rule_of_modes(variable.n, fastest)
    decays = bank.real_modes(damping(bank.rates, v), axis=0)
    weights = length * weights
    gains = np.empty((variable.n, decays.shape[0]))
    product(at_points(variable, key) * weights, np.ascontiguousarray(decays.T), gains)
    return OverStep(gains, decays @ weights, np.exp(-bank.rates))
