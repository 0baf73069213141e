"""Which system a Lyapunov run marches, and with which schemes."""

from __future__ import annotations

import numpy as np

from ..collocation.reading import reduced
from ..equation.system import System
from ..schemes.adams import Adams
from ..schemes.bdf import BDF
from ..schemes.explicit import ExplicitCaputo
from ..schemes.l1 import L1
from ..schemes.scheme import Scheme, distinct_components

# A scheme is of first order where it is of no more than this next to alpha = 1.
_NEAR_1, _FIRST_ORDER = 0.95, 1.25
# Orders for which `Adams` is of second order and its stability limit is watched.
_ADAMS_LOWEST, _ADAMS_HIGHEST = 0.5, 1.0


def marched(equation: System, scheme: Scheme) -> System:
    """The system to march: classical ones of second order as first-order ones.

    Increments kept apart from t x'(0), as most schemes keep them above order 1, lose a tangent that
    has decayed to their rounding. With memory none decays so far.
    """
    if scheme.whole or equation.m == 1 or memory(equation) != "none":
        return equation
    return reduced(equation.dense())[0]


def memory(equation: System) -> str:
    """Whether "all", "none" or "some" components have a term of fractional order."""
    found = np.zeros(equation.d, dtype=bool)
    system = equation.enlarged
    for operator, coefficients in system.left:
        found[system.sources[(coefficients != 0) & (not operator.classical)]] = True
    return "all" if found.all() else "some" if found.any() else "none"


def n_data(equation: System) -> int:
    """Number of initial data: d, and one more for each component of order above 1."""
    return equation.d + int(np.sum(equation.highest_orders() > 1))


def usual_scheme(equation: System) -> Scheme:
    """The scheme of a run that names none: of second order wherever one covers the equation."""
    return _second_order(equation) or ExplicitCaputo()


def checking_scheme(scheme: Scheme, equation: System) -> Scheme:
    """The scheme whose run, at another step, a verdict is compared with.

    Twice the step often repeats the verdict of a first-order scheme where that is wrong, so that
    one is compared with the usual scheme; where none is of second order, with the other one of
    first order: what the explicit one adds to a rate the implicit one takes away.
    """
    if scheme.adaptive or scheme.order(_NEAR_1) > _FIRST_ORDER:
        return scheme
    opposite = L1() if scheme.solve == "explicit" else ExplicitCaputo()
    return _second_order(equation) or opposite


def _second_order(equation):
    """`Adams` where it is of second order, else `BDF(2)`; None where there are other kernels."""
    if not equation.enlarged.constant:
        return None
    if equation.enlarged is not equation:
        return BDF(2)
    distinct, _ = distinct_components(marched(equation, Adams()))
    orders = [operator.order for key in distinct for _, operator in key]
    single = len(orders) == len(distinct)
    covered = min(orders) >= _ADAMS_LOWEST and max(orders) <= _ADAMS_HIGHEST
    return Adams() if single and covered else BDF(2)
