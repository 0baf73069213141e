"""Plans of schemes on uniform steps, made from the weights of each term of the equation."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np

from ..equation.system import System
from ..support.checks import refuse
from .plan import Convolution, Plan, distinct_columns
from .signatures import StepRows
from .weights import by_rule, parabola_start, parabola_weights
from .weights import weighed as weighed_increments


def uniform_plan(
    system: System,
    h: float,
    theta: float,
    weighed: Callable[..., Any],
    *,
    starts: Sequence[Any] = ((None, 0.0),),
    whole: bool = False,
    integral: bool = False,
    first_modal: int = 2,
    drift: Sequence[np.ndarray] | None = None,
    **more: Any,
) -> Plan:
    """Make the plan of a scheme on uniform steps whose equation holds at t_n + theta h.

    Parameters
    ----------
    system : System
    h : float
        Step [time].
    theta : float
        In [0, 1]; 0 for an explicit scheme, which is solved for changes of increments [-].
    weighed : callable
        ``weighed(c, operator)``: the factor, the `WeightRule` and its p for the term c times an
        operator. They weigh increments or, if `integral`, values of f on the left side.
    starts : sequence of (callable or None, ndarray of shape (d,))
        For each start value a callable like `weighed`, or None for no weights, and the value. An
        implicit scheme replaces the first start value by its first increment, or by f at 0.
    whole : bool
        Whether the increments contain h x'(0).
    integral : bool
        Whether the pieces are values of f. Even then the pieces of memory that f reads are
        increments.
    first_modal : int
        First k from which the weights are sums of exponentials.
    drift : tuple of two ndarrays (r, d), optional
        Amplitudes and powers of r known terms ``amplitude t**power`` on the left side. The
        derivatives of t x'(0) are added to them.
    **more
        Other fields of the `Plan`.

    Returns
    -------
    Plan
    """
    increments = h * system.y0[1] if system.m == 2 else np.zeros(system.d)
    distinct, groups = distinct_columns(system)
    lead, near, scale = np.ones((3, len(distinct), 2))
    lists: list = []
    start_lists: list = [[] for _ in starts]
    for i, (key, is_memory) in enumerate(distinct):
        values = integral and not is_memory
        own = partial(weighed_increments, h=h, theta=theta) if integral and is_memory else weighed
        terms = [own(c, operator) for c, operator in key]
        sums: Any = sum(f * rule.exact(p, 2) for f, rule, p in terms)
        now, then = sums
        total = 1.0 if values else now
        if total == 0 or not np.isfinite(total):
            required, got = "give a finite, nonzero leading weight", f"{total} at h = {h}"
            refuse("terms", required, got, "take another step")
        lead[i], near[i] = -now if values else 1 / total, then / total + (theta == 0)
        lists.append(_over(total, terms))
        for found, (start_of, _) in zip(start_lists, starts, strict=True):
            weighs = start_of and values == integral
            found.append(_over(total, [start_of(*term) for term in key] if weighs else []))
        if starts[0][0] and theta > 0 and not integral:
            # the first interval has no parabola, so its own weight is a_0 = theta**p
            scale[i, 0] = sum(f * p.integrals(theta, 1)[0] for f, _, p in terms) / total
    amplitudes, powers = drift_of_speed(system, whole)
    if integral:
        amplitudes[:, ~system.is_memory] = 0.0
    if drift is not None:
        amplitudes, powers = np.vstack([amplitudes, drift[0]]), np.vstack([powers, drift[1]])
    start_groups = tuple(terms for found in start_lists for terms in found)
    both = np.ones(2)
    return Plan(
        past=Convolution(tuple(lists), start_groups, first_modal),
        rows=StepRows(
            first=0,
            last=1,
            times=np.zeros(0),
            theta=theta * both,
            unit=h * both,
            length=both,
            ratio=both,
            lead=lead,
            near=near,
            scale=scale,
            drift=np.zeros((len(distinct), 0)),
        ),
        groups=groups,
        initial=system.at_start,
        increments=increments,
        shift=0 * increments if whole else increments,
        integral=integral,
        powers=powers,
        drift=amplitudes,
        starts=np.array([np.broadcast_to(value, system.d) for _, value in starts]),
        **more,
    )


def _over(total: float, terms: list[Any]) -> tuple[Any, ...]:
    return tuple((f / total, rule, p) for f, rule, p in filter(None, terms))


def parabola_plan(
    system: System, h: float, theta: float, closing: bool = False, **more: Any
) -> Plan:
    """Make the plan of a scheme whose solution is a parabola on each step."""
    # the equation holds at t_n + theta h; for closing see `parabola_weights`
    rules = parabola_weights(theta, closing), parabola_start(theta)
    weighed, start = (partial(by_rule, h=h, rule=rule) for rule in rules)
    return uniform_plan(system, h, theta, weighed, starts=[(start, 0.0)], **more)


def drift_of_speed(system: System, whole: bool = False) -> Any:
    """Return amplitudes and powers, (r, d) each, of the r derivatives of t x'(0)."""
    # Increments leave t x'(0) out, so these terms are added; r is 0 if `whole`, when they contain h
    # x'(0). Amplitudes are 0 for orders up to 1, but after `reduce_order`, whose terms act on x - t
    # x'(0).
    if system.m == 1 or whole:
        return np.zeros((2, 0, system.d))
    above = system.above
    lower: list[Any] = [(op, c) for op, c in system.left if op.constant and op.order <= 1]
    rows = [(op.factor(1.0) * np.where(above, c, 0) * system.y0[1], op.power) for op, c in lower]
    amplitudes = np.array([row for row, _ in rows]).reshape(-1, system.d)
    powers = np.array([np.full(system.d, p) for _, p in rows]).reshape(-1, system.d)
    return amplitudes, powers
