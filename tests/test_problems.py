"""The table of problems itself."""

import numpy as np
import pytest
from problems import PROBLEMS, half_order_oscillator, half_order_relaxation, monomial
from scipy.special import gamma

TAGS = {"smooth", "singular", "system", "several-terms", "incommensurate", "classical"}


def test_names_are_unique():
    names = [problem.name for problem in PROBLEMS]
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
