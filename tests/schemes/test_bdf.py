"""What is special about the BDF schemes: high orders, and initial speeds with lower terms."""

import numpy as np
import pytest
from problems import errors, observed_order, singular_problem
from solver.runs import errors_of

import hereditary as hd
from hereditary.exact import oscillator


@pytest.mark.parametrize("p", [4, 5, 6])
@pytest.mark.parametrize("alpha", [0.3, 0.5, 0.8, 1.05])
def test_high_orders_on_singular_solutions(alpha, p):
    """Full order without starting weights: some hundred steps reach rounding.

    The parasitic roots of formulas 5 and 6, up to 0.86, must die out first.
    """
    steps = [40, 80, 160] if p == 4 else [60, 120, 240]
    problem = singular_problem(alpha)
    found = [errors(problem, hd.BDF(p), hd.Direct(), n)[0] for n in steps]
    if p == 4:
        assert observed_order(steps, found) == pytest.approx(4.0, abs=0.15)
        assert found[-1] < 6e-9
    else:
        assert found[-1] < 1e-10


# Highest order, p and steps of 10 time units from which the order shows, the last error at most.
WITH_SPEED = [
    (1.8, 2, (160, 320, 640), 7.5e-5),
    (1.8, 3, (160, 320, 640), 1.25e-6),
    (1.6, 4, (160, 320, 640), 1.35e-9),
    (1.3, 5, (320,), 7e-12),
    (1.1, 6, (160,), 3e-10),
]


@pytest.mark.parametrize("gamma", [0.5, 0.8, 0.95])
@pytest.mark.parametrize(("beta", "p", "steps", "bound"), WITH_SPEED)
def test_lower_terms_keep_the_order_of_bdf_with_a_speed_at_0(beta, p, gamma, steps, bound):
    """Two coupled components; orders 5 and 6 settle late, next to rounding."""
    mixing = np.array([[1.0, 0.5], [-0.3, 1.0]])
    matrix = mixing @ np.diag([1.0, 2.25]) @ np.linalg.inv(mixing)
    starts = mixing @ np.array([[0.2, 0.3], [-0.1, 0.5]])  # of the components: x(0), x'(0)
    parts = (
        oscillator(beta, gamma, 0.25, 1.0, 0.2, 0.3),
        oscillator(beta, gamma, 0.25, 1.5, -0.1, 0.5),
    )
    t = np.linspace(8, 10, 5)
    true = np.array([part(t)[:, 0] for part in parts]).T @ mixing.T
    equation = hd.Equation(
        [hd.Caputo(beta), 0.25 * hd.Caputo(gamma)], _coupled, starts.T, matrix.ravel()
    )
    how = {"scheme": hd.BDF(p), "history": hd.SumOfExponentials(1e-13), "t_eval": t}
    found = errors_of(lambda sol: sol.y, true, steps, equation, 10.0, **how)
    if len(steps) > 1:
        assert np.log2(found[-2] / found[-1]) == pytest.approx(p, abs=0.15), found
    assert found[-1] < bound


def _coupled(t, x, p):
    return np.array([-p[0] * x[0] - p[1] * x[1], -p[2] * x[0] - p[3] * x[1]])


def test_tangents_along_a_speed_keep_the_order_of_bdf():
    steps, found = (160, 320, 640), []
    true = oscillator(1.8, 0.8, 0.25, 1.0, 0.0, 1.0)(10.0)[0]
    equation = hd.scenes.oscillator(1.8, 0.8, 0.25, 1.0, x0=0.2, v0=0.3)
    how = {"scheme": hd.BDF(3), "history": hd.Direct(), "wrt": "y0"}
    for n in steps:
        tangents = hd.sensitivities(equation, 10.0, n, **how).by_y0[-1]
        found.append(abs(tangents[0, 1] - true))
    assert observed_order(steps, found) == pytest.approx(3.0, abs=0.15), found
    assert found[-1] < 1e-6
