"""Initial values in Riemann-Liouville terms: ``y(0) t**-gamma / Gamma(1-gamma)`` on given steps.

This term is infinite at 0, so it is never sampled there. Samples at the times of the steps alone
would give an error of order 1 - gamma. So the first samples get corrections by the Euler-Maclaurin
formula. Sums of samples then converge to the integrals of ``t**-gamma``, ``t**(1-gamma)``, ... with
the order of the scheme.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from math import ceil
from typing import Any

import numpy as np

from ..equation.system import System
from ..equation.terms import derivative_of_one
from ..kernels.special import hurwitz_zeta
from .plan import Plan


def with_initial_values(plan: Plan, system: System, order: float) -> Plan:
    """Return a plan with what initial values add to derivatives of y itself as known terms."""
    # order: that of convergence of the plan's scheme
    terms = [(op, c) for op, c in system.left if op.constant and not op.definition.subtracts_start]
    if not (terms and plan.rows.shared):  # if each step has its own row, rows contain the terms
        return plan
    rows, d = plan.rows, system.d
    theta = float(rows.theta[-1])
    n_first = 1 if theta == 0 else ceil(order)
    # an increment that is given instead of solved for cannot be corrected: begin with step 1
    first = np.zeros(d, dtype=int) if plan.given is None else plan.given
    corrections = np.zeros((n_first + 1, d))
    amplitudes, powers = [], []
    for operator, c in terms:
        factor, exponent = derivative_of_one(operator.order)
        amplitudes.append(c * system.y0[0] * factor)
        powers.append(np.where(c != 0, exponent, 0.0))
        sizes = amplitudes[-1] * rows.unit[0] ** exponent
        samples = first_samples(-exponent, theta, n_first)
        for k, weight in enumerate(samples):
            corrections[k + first, np.arange(d)] -= weight * sizes
    known = np.zeros((0, d)) if plan.corrections is None else plan.corrections
    size = max(len(known), len(corrections))
    total: Any = sum(np.pad(part, ((0, size - len(part)), (0, 0))) for part in (known, corrections))
    before = [np.zeros((0, d)) if part is None else part for part in (plan.drift, plan.powers)]
    return replace(
        plan,
        drift=np.vstack([before[0], amplitudes]),
        powers=np.vstack([before[1], powers]),
        corrections=total,
    )


@lru_cache(maxsize=64)
def first_samples(gamma: float, theta: float, n: int) -> np.ndarray:
    """Return corrections (n,) of the first n samples of ``t**-gamma``; the step is 1."""
    # At t = k + theta, k >= 0, without t = 0. By the Euler-Maclaurin formula a sum of samples of
    # t**(j-gamma) misses the integral by zeta(gamma - j, theta): cancelled here for all j < n.
    places = np.arange(n) + theta
    lacking = [-hurwitz_zeta(gamma - j, theta or 1.0) for j in range(n)]
    return np.linalg.solve(np.vander(places, n, increasing=True).T, lacking)
