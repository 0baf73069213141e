"""Runs of first order estimate their own error."""

import numpy as np
import pytest

import hereditary as hd


def oscillator():
    terms = hd.Caputo(1.8) + 0.25 * hd.Caputo(0.8)
    return hd.Equation(terms, lambda t, x: np.sin(t) - x, [0.2, 0.3])


PROBLEMS = {
    "oscillator": (oscillator(), 50.0),
    "relaxation 0.4": (hd.scenes.relaxation(0.4), 5.0),
    "relaxation 0.5": (hd.scenes.relaxation(0.5), 5.0),
    "relaxation 0.8": (hd.scenes.relaxation(0.8), 20.0),
}


@pytest.mark.parametrize("scheme", [hd.ExplicitCaputo(), hd.GrunwaldLetnikov()], ids=str)
@pytest.mark.parametrize("problem", PROBLEMS)
@pytest.mark.parametrize("n", [2_000, 20_000])
def test_the_estimate_is_within_a_factor_of_3_beyond_40_steps(scheme, problem, n):
    equation, t_end = PROBLEMS[problem]
    sol = hd.solve(equation, t_end, n, scheme=scheme)
    true = hd.solve(equation, t_end, rtol=1e-9, t_eval=sol.t)
    error = np.abs(sol.y - true.y)[40:].max() / np.abs(sol.y).max()
    assert error / 3 < sol.stats["error_estimate"] < 3 * error


def test_a_large_error_is_a_warning_and_none_is_estimated_where_nothing_can_be():
    with pytest.warns(hd.SolveWarning, match=r"errors are about .* rtol=1e-6, scheme=BDF\(2\)"):
        sol = hd.solve(oscillator(), 50.0, 500)
    assert sol.success
    assert hd.solve(oscillator(), 50.0, 399).stats["error_estimate"] is None
    assert "error_estimate" not in hd.solve(oscillator(), 50.0, 400, estimate=False).stats


def test_time_alone_is_solved_to_a_tolerance():
    by_default, asked = hd.solve(oscillator(), 50.0), hd.solve(oscillator(), 50.0, rtol=1e-6)
    np.testing.assert_array_equal(by_default.y, asked.y)
