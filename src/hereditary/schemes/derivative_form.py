"""Plans of implicit schemes in derivative form, from their weight rules."""

import numpy as np

from .scheme import Convolution, Plan, check_lead, distinct_components, uniform_rows


def derivative_plan(
    equation,
    h,
    theta,
    weighed,
    start_rule=None,
    first_modal=2,
    corrections=None,
    more_starts=(),
    whole=False,
    more_drift=None,
):
    """Plan of a scheme that weighs increments and sees the right-hand side at t_n + theta h.

    Parameters
    ----------
    equation : Equation
    h : float
        Step [time].
    theta : float
        In (0, 1] [-].
    weighed : callable
        ``weighed(c, operator)``: factor, `WeightRule` and its p of c times an operator.
    start_rule : WeightRule, optional
        What the weights of the first increment lack, with the same p.
    first_modal : int, optional
        First k from which the weights are sums of exponentials.
    corrections : ndarray, shape (k, d), optional
        Added to the right-hand side in the first k steps.
    more_starts : sequence of (callable, ndarray of shape (d,))
        Further start values, with ``lists(key, total)``, the weights of each group.
    whole : bool
        Whether the increments keep h x'(0), which then is one of `more_starts`.
    more_drift : tuple of three ndarrays (k, d), (r, d), (r, d), optional
        Beside the derivatives of t x'(0), which the increments leave out: what is added to the left
        side in the first k steps, and amplitudes and powers of t of what is added in all.

    Returns
    -------
    Plan
        Of implicit steps.
    """
    distinct, groups = distinct_components(equation)
    lead, near, scale = np.empty((3, len(distinct)))
    lists, start_lists = [], []
    more: list[list] = [[] for _ in more_starts]
    for i, key in enumerate(distinct):
        terms = [weighed(c, operator) for c, operator in key]
        weights = sum(f * rule.exact(p, 2) for f, rule, p in terms)
        total = weights[0]
        check_lead(total, h)
        lead[i], near[i] = 1 / total, weights[1] / total
        lists.append(tuple((f / total, rule, p) for f, rule, p in terms))
        alone = total
        if start_rule is not None:
            start_lists.append(tuple((f / total, start_rule, p) for f, _, p in terms))
            # the first interval leans on none before it: its own weight is a_0 = theta**p
            alone = sum(f * p.seen(theta, 1)[0] for f, _, p in terms)
        else:
            start_lists.append(())
        scale[i] = alone / total
        for found, (weights_of, _) in zip(more, more_starts, strict=True):
            found.append(weights_of(key, total))
    increments = h * equation.y0[1] if equation.m == 2 else np.zeros(equation.d)
    shift = 0 * increments if whole else increments
    extra = np.zeros((0, equation.d)) if corrections is None else corrections
    amplitudes, powers = drift_of_speed(equation, whole)
    if more_drift is not None:
        begun, late, exponents = more_drift
        amplitudes, powers = np.vstack([amplitudes, late]), np.vstack([powers, exponents])
        begun[: extra.shape[0]] -= extra
        extra = -begun
    return Plan(
        past=Convolution(tuple(lists), tuple(start_lists), first_modal, tuple(map(tuple, more))),
        rows=uniform_rows(h, theta, lead, near, scale),
        groups=groups,
        initial=equation.at_start,
        increments=increments,
        shift=shift,
        # the first start value is the first increment
        starts=np.array([0 * shift, *(value for _, value in more_starts)]),
        powers=powers,
        drift=amplitudes,
        corrections=extra,
        lasting=more_drift is not None,  # with a drift of its own the first steps are many
    )


def drift_of_speed(equation, whole=False):
    """Derivatives of t x'(0), which the increments leave out: amplitudes and powers, (r, d) each.

    None where they keep it, nor for components of order up to 1: only the halves of a reduced order
    have an x'(0) there, and their terms act on x - t x'(0) alone.
    """
    if equation.m == 1 or whole:
        return np.zeros((2, 0, equation.d))
    above = equation.above
    lower = [(op, c) for op, c in equation.left if op.constant and op.order <= 1]
    rows = [(op.factor(1.0) * np.where(above, c, 0) * equation.y0[1], op.power) for op, c in lower]
    amplitudes = np.array([row for row, _ in rows]).reshape(-1, equation.d)
    powers = np.array([np.full(equation.d, p) for _, p in rows]).reshape(-1, equation.d)
    return amplitudes, powers
