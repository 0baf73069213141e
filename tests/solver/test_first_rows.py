"""Rows inside the first two steps, where solutions start like a power of t."""

import numpy as np
import pytest
from scipy.special import gamma

import hereditary as hd
from hereditary.exact import relaxation


def steady(t, y, p):
    return np.full(1, p[0])


def falling(t, y):
    return -y


@pytest.mark.parametrize("order", [0.3, 0.5, 0.8, 1.0, 1.4])
def test_rows_inside_the_first_two_steps_follow_the_power(order):
    """x(0) + t x'(0) + a t**alpha, exactly so until parabolas take over."""
    equation = hd.Equation(
        hd.Caputo(order), steady, [1.0] + [0.5] * (order > 1), (gamma(order + 1),)
    )
    t = np.linspace(0, 4, 41)[1:]
    sol = hd.solve(equation, 4.0, 4, scheme=hd.Adams(), t_eval=t)
    off = np.abs(sol.y[:, 0] - 1.0 - 0.5 * (order > 1) * t - t**order)
    assert off[:20].max() < 1e-13
    assert (off[20:30].max() > 1e-4) == (order != 1)
    if order > 1:
        slope = 0.5 + order * t ** (order - 1)
        inside = np.r_[:9, 10:19]  # at the steps themselves it is the scheme's
        np.testing.assert_allclose(sol.ydot[inside, 0], slope[inside], rtol=1e-12)


@pytest.mark.parametrize("order", [0.3, 0.5, 0.8, 0.95, 1.4, 1.8])
@pytest.mark.parametrize(
    "scheme",
    [
        *(hd.ExplicitCaputo(), hd.GrunwaldLetnikov(), hd.L1(), hd.L12(), hd.L2()),
        *(hd.BDF(2), hd.Adams()),
    ],
    ids=repr,
)
def test_rows_inside_the_first_steps_err_like_the_steps(scheme, order):
    if order > 1 and isinstance(scheme, (hd.L12, hd.L2)):
        return
    equation = hd.Equation(hd.Caputo(order), falling, [1.0] + [0.5] * (order > 1))
    true = relaxation(order, 1.0, [1.0] + [0.5] * (order > 1))
    runs = [{"n_steps": 100}]
    if isinstance(scheme, (hd.L1, hd.L2)) and order < 1:
        runs.append({"mesh": np.linspace(0, 1, 101)})
    for run in runs:
        full = hd.solve(equation, 1.0, scheme=scheme, **run)
        nearest = np.abs(full.y[1:4, 0] - true(full.t[1:4])[:, 0]).max()
        t = np.linspace(0, 0.02, 41)[1:]
        sol = hd.solve(equation, 1.0, scheme=scheme, t_eval=t, **run)
        off = np.abs(sol.y[:, 0] - true(t)[:, 0])
        assert off.max() < 2 * nearest + 1e-4 / 4  # and something like a bend of h**2
        assert np.array_equal(sol.y[[19, 39]], full.y[1:3])
    halves = hd.solve(equation, 1.0, 100, scheme=scheme, t_eval=[0.005, 0.015, 0.5])
    assert halves.state is not None
    begun = hd.solve(equation, 0.01, 1, scheme=scheme)
    resumed = hd.solve(equation, 1.0, scheme=scheme, resume=begun.state, t_eval=[0.015, 0.5])
    assert np.array_equal(resumed.y, halves.y[1:])
