"""The table of problems itself."""

import numpy as np
import pytest
from problems import HARD, PROBLEMS, half_order_oscillator, half_order_relaxation, monomial
from scipy.special import gamma

import hereditary as hd

TAGS = {"smooth", "singular", "system", "several-terms", "incommensurate", "classical"}
HARDNESS = {"stiff", "near-integer", "small-order", "long-time", "nonlinear", "incommensurate"}


def test_names_are_unique():
    names = [problem.name for problem in PROBLEMS + HARD]
    assert len(set(names)) == len(names)


@pytest.mark.parametrize("problem", PROBLEMS, ids=lambda p: p.name)
def test_tags_and_initial_values(problem):
    assert problem.tags <= TAGS
    assert len(problem.tags & {"smooth", "singular"}) == 1
    equation = problem.equation()
    np.testing.assert_allclose(problem.exact(np.zeros(1))[0], equation.y0[0], atol=1e-15)
    assert ("system" in problem.tags) == (equation.d > 1)
    if equation.m == 2:
        step = 1e-9 if "smooth" in problem.tags else 1e-12
        slope = (problem.exact(np.array([step])) - problem.exact(np.zeros(1)))[0] / step
        np.testing.assert_allclose(slope, equation.y0[1], atol=1e-3)


def test_exact_solutions_known_from_elsewhere():
    assert half_order_relaxation(np.array([5.0]))[0, 0] == pytest.approx(0.2323105, rel=1e-4)
    # the derivative of order 1/2 of t**1.5 is Gamma(2.5) t
    assert monomial(2.0, 0.5, 1.5) == pytest.approx(gamma(2.5) * 2.0)
    assert half_order_oscillator(np.zeros(1))[0, 0] == pytest.approx(1.0, abs=1e-14)


# Problem, scheme, steps, grading (1 for uniform steps), bound on the error at the end: measured, a
# third more allowed.
SOUND = {
    "stiff 0.8": (hd.BDF(3), 2000, 1.0, 1e-13),
    "stiff 0.3": (hd.L2(), 2000, 1.0, 4e-09),
    "small order 0.02": (hd.BDF(2), 4000, 1.0, 2e-10),
    "small order 0.05": (hd.L2Sigma(), 4000, 40.0, 2e-08),
    "long time 0.5": (hd.L2Sigma(), 2000, 4.0, 3e-09),
    "order 0.999": (hd.BDF(3), 1000, 1.0, 1e-09),
    "oscillation 1.001": (hd.BDF(4), 1000, 1.0, 2e-12),
    "oscillation 1.999": (hd.ProductTrapezoid(), 4000, 1.0, 6e-07),
    "powers 0.5": (hd.L2(), 2000, 5.0, 3e-06),
    "two orders": (hd.L2(), 2000, 3.0, 3e-07),
}


@pytest.mark.parametrize("problem", HARD, ids=lambda p: p.name)
def test_hard_problems_have_a_sound_scheme(problem):
    assert len(problem.tags & HARDNESS) == 1
    scheme, n, exponent, bound = SOUND[problem.name]
    how = {"n_steps": n} if exponent == 1 else {"mesh": hd.graded(n, exponent)}
    history = hd.SumOfExponentials(1e-13)
    sol = hd.solve(problem.equation(), problem.t_end, scheme=scheme, history=history, **how)
    assert sol.success
    exact = problem.exact(np.array([problem.t_end]))[0]
    error = np.abs(sol.y[-1] - exact).max()
    assert error < bound, error
