"""Rows inside the first two steps, where solutions start like a power of t."""

import numpy as np
import pytest
from scipy.special import gamma

import hereditary as hd
from hereditary.exact import relaxation


def steady(t, y, p):
    return np.full(1, p[0])


def power(order):
    """D^alpha x = Gamma(alpha + 1): x(0) + t x'(0) + t**alpha."""
    equation = hd.Equation(
        hd.Caputo(order), steady, [1.0] + [0.5] * (order > 1), (gamma(order + 1),)
    )
    t = np.linspace(0, 4, 41)[1:]
    return t, hd.solve(equation, 4.0, 4, scheme=hd.Adams(), t_eval=t)


@pytest.mark.parametrize("order", [0.3, 0.5, 0.8, 1.0, 1.4])
def test_rows_follow_the_power_until_parabolas_take_over(order):
    t, sol = power(order)
    off = np.abs(sol.y[:, 0] - 1.0 - 0.5 * (order > 1) * t - t**order)
    assert off[:20].max() < 1e-13
    assert (off[20:30].max() > 1e-4) == (order != 1)


def test_slopes_follow_the_power():
    t, sol = power(1.4)
    inside = np.r_[:9, 10:19]  # at the steps themselves it is the scheme's
    np.testing.assert_allclose(sol.ydot[inside, 0], 0.5 + 1.4 * t[inside] ** 0.4, rtol=1e-12)


SCHEMES = [
    *(hd.ExplicitCaputo(), hd.GrunwaldLetnikov(), hd.L1(), hd.L12(), hd.L2()),
    *(hd.BDF(2), hd.Adams()),
]
BELOW_1 = hd.L12, hd.L2
RUNS = [
    (scheme, order)
    for scheme in SCHEMES
    for order in (0.3, 0.5, 0.8, 0.95, 1.4, 1.8)
    if order < 1 or not isinstance(scheme, BELOW_1)
]
UNIFORM, MESH = {"n_steps": 100}, {"mesh": np.linspace(0, 1, 101)}
WITH_MESHES = [
    *((*run, UNIFORM) for run in RUNS),
    *((*run, MESH) for run in RUNS if run[1] < 1 and isinstance(run[0], (hd.L1, hd.L2))),
]


def fall(order):
    return hd.Equation(hd.Caputo(order), lambda t, y: -y, [1.0] + [0.5] * (order > 1))


@pytest.mark.parametrize(("scheme", "order", "steps"), WITH_MESHES)
def test_rows_inside_the_first_steps_err_like_the_steps(scheme, order, steps):
    true = relaxation(order, 1.0, [1.0] + [0.5] * (order > 1))
    full = hd.solve(fall(order), 1.0, scheme=scheme, **steps)
    nearest = np.abs(full.y[1:4, 0] - true(full.t[1:4])[:, 0]).max()
    t = np.linspace(0, 0.02, 41)[1:]
    off = np.abs(full(t)[:, 0] - true(t)[:, 0])
    assert off.max() < 2 * nearest + 1e-4 / 4  # and something like a bend of h**2


@pytest.mark.parametrize(("scheme", "order", "steps"), WITH_MESHES)
def test_rows_at_the_first_steps_are_theirs(scheme, order, steps):
    full = hd.solve(fall(order), 1.0, scheme=scheme, **steps)
    rows = hd.solve(fall(order), 1.0, scheme=scheme, t_eval=[0.005, 0.01, 0.02], **steps)
    assert np.array_equal(rows.y[1:], full.y[1:3])


@pytest.mark.parametrize(("scheme", "order"), RUNS)
def test_a_run_resumed_inside_the_first_steps_has_the_same_rows(scheme, order):
    rows = hd.solve(fall(order), 1.0, 100, scheme=scheme, t_eval=[0.015, 0.5])
    begun = hd.solve(fall(order), 0.01, 1, scheme=scheme)
    again = {"resume": begun.state, "t_eval": [0.015, 0.5]}
    assert np.array_equal(hd.solve(fall(order), 1.0, scheme=scheme, **again).y, rows.y)
