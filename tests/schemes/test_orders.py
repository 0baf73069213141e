"""Every scheme's order, for smooth solutions and for those like t**alpha at 0; both sides of it."""

import numpy as np
import pytest
from problems import errors, singular_problem, smooth_problem

import hereditary as hd
from hereditary.analysis.order import observed_order
from hereditary.exact import oscillator
from hereditary.meshes import UniformSteps
from hereditary.solver.stepper import Stepper

ALPHAS = (0.1, 0.3, 0.5, 0.8, 0.95)
BETAS = (1.2, 1.5, 1.8, 1.95)
FIRST_ORDERS = [
    *(hd.L1(), hd.L12(), hd.L2(), hd.L2Sigma()),
    *(hd.Adams(), hd.Adams(3), hd.ProductTrapezoid()),
]
CASES = [
    *((hd.GrunwaldLetnikov(), alpha) for alpha in ALPHAS + BETAS),
    *((hd.BDF(1), alpha) for alpha in ALPHAS + BETAS),
    *((hd.BDF(2), alpha) for alpha in ALPHAS + BETAS),
    *((hd.BDF(3), alpha) for alpha in ALPHAS),
    *((scheme, alpha) for scheme in FIRST_ORDERS for alpha in ALPHAS),
    *((hd.L1(), beta) for beta in BETAS),
    *((hd.L2Sigma(), beta) for beta in BETAS),
    *((hd.ProductTrapezoid(), beta) for beta in BETAS),
    *((hd.Adams(), beta) for beta in BETAS),
]


# Where the proven order shows late: a term of nearly the same order goes with it.
LATE = {("L1()", 1.2), ("ProductTrapezoid()", 1.2), ("Adams(corrections=1)", 1.2)}


def steps_of(scheme, alpha, usual):
    """Step counts in the range where the order shows and rounding does not."""
    if (repr(scheme), alpha) in LATE:
        return [8 * n for n in usual]
    if scheme == hd.BDF(3):
        return [80, 160, 320]
    return usual


def smooth_table(scheme, alpha):
    """Errors over all times: a start of lower order would show in them."""
    steps = steps_of(scheme, alpha, [200, 400, 800])
    history = hd.SumOfExponentials(1e-13)
    found = [errors(smooth_problem(alpha), scheme, history, n)[1] for n in steps]
    return observed_order(steps, found)


def singular_table(scheme, alpha):
    """Errors at a fixed time."""
    steps = steps_of(scheme, alpha, [800, 1600, 3200])
    history = hd.SumOfExponentials(1e-13)
    found = [errors(singular_problem(alpha), scheme, history, n)[0] for n in steps]
    return observed_order(steps, found)


@pytest.mark.parametrize(("scheme", "alpha"), CASES, ids=str)
def test_smooth(scheme, alpha):
    """Solutions 1 + t**3, whose right-hand sides are smooth enough for every scheme here."""
    found = smooth_table(scheme, alpha)
    assert found.slope == pytest.approx(scheme.order(alpha), abs=0.15), found
    assert np.all(np.diff(found.errors) < 0)
    assert found.errors[-1] < SMOOTH_ERRORS[repr(scheme), alpha] * 4 / 3


@pytest.mark.parametrize(("scheme", "alpha"), CASES, ids=str)
def test_singular(scheme, alpha):
    """Relaxation and oscillation, y ~ t**alpha: the orders fall as theory says, and no further."""
    found = singular_table(scheme, alpha)
    expected = scheme.order(alpha, smoothness="singular")
    assert found.slope == pytest.approx(expected, abs=0.15), found
    assert found.errors[-1] < SINGULAR_ERRORS[repr(scheme), alpha] * 4 / 3


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
        assert observed_order(steps, found).slope == pytest.approx(4.0, abs=0.15)
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
    found = []
    for n in steps:
        sol = hd.solve(
            equation, 10.0, n, scheme=hd.BDF(p), history=hd.SumOfExponentials(1e-13), t_eval=t
        )
        found.append(np.abs(sol.y - true).max())
    if len(steps) > 1:
        assert np.log2(found[-2] / found[-1]) == pytest.approx(p, abs=0.15), found

    assert found[-1] < bound


def _coupled(t, x, p):
    return np.array([-p[0] * x[0] - p[1] * x[1], -p[2] * x[0] - p[3] * x[1]])


def test_tangents_along_a_speed_keep_the_order_of_bdf():
    steps, found = (160, 320, 640), []
    true = oscillator(1.8, 0.8, 0.25, 1.0, 0.0, 1.0)(10.0)[0]
    equation = hd.scenes.oscillator(1.8, 0.8, 0.25, 1.0, x0=0.2, v0=0.3)
    for n in steps:
        direction = np.array([[0.0], [1.0]])
        stepper = Stepper(
            equation, hd.BDF(3), hd.Direct(), UniformSteps(10.0 / n), n, directions=direction
        )
        while stepper.n < 20:
            stepper.advance(20, keep=False)
        stepper.transform_tangent(np.array([[2.0]]))
        while stepper.n < n:
            stepper.advance(n, keep=False)
        found.append(abs(stepper.tangent[0, 0] / 2 - true))
    assert observed_order(steps, found).slope == pytest.approx(3.0, abs=0.15), found
    assert found[-1] < 1e-6


# The last error of each case as measured; a third more is allowed.
SMOOTH_ERRORS = {
    ("GrunwaldLetnikov()", 0.1): 1.9e-03,
    ("GrunwaldLetnikov()", 0.3): 1.8e-03,
    ("GrunwaldLetnikov()", 0.5): 1.7e-03,
    ("GrunwaldLetnikov()", 0.8): 1.5e-03,
    ("GrunwaldLetnikov()", 0.95): 1.4e-03,
    ("GrunwaldLetnikov()", 1.2): 1.2e-03,
    ("GrunwaldLetnikov()", 1.5): 7.9e-04,
    ("GrunwaldLetnikov()", 1.8): 3.4e-04,
    ("GrunwaldLetnikov()", 1.95): 8.7e-05,
    ("L12()", 0.1): 4.0e-10,
    ("L12()", 0.3): 4.0e-09,
    ("L12()", 0.5): 2.6e-08,
    ("L12()", 0.8): 3.6e-07,
    ("L12()", 0.95): 1.3e-06,
    ("BDF(1)", 0.1): 9.9e-05,
    ("BDF(1)", 0.3): 3.2e-04,
    ("BDF(1)", 0.5): 5.8e-04,
    ("BDF(1)", 0.8): 1.0e-03,
    ("BDF(1)", 0.95): 1.3e-03,
    ("BDF(1)", 1.2): 1.8e-03,
    ("BDF(1)", 1.5): 2.4e-03,
    ("BDF(1)", 1.8): 3.0e-03,
    ("BDF(1)", 1.95): 3.4e-03,
    ("BDF(2)", 0.1): 1.6e-07,
    ("BDF(2)", 0.3): 5.0e-07,
    ("BDF(2)", 0.5): 8.8e-07,
    ("BDF(2)", 0.8): 1.5e-06,
    ("BDF(2)", 0.95): 1.9e-06,
    ("BDF(2)", 1.2): 2.5e-06,
    ("BDF(2)", 1.5): 3.5e-06,
    ("BDF(2)", 1.8): 4.5e-06,
    ("BDF(2)", 1.95): 4.7e-06,
    ("BDF(3)", 0.1): 3.6e-09,
    ("BDF(3)", 0.3): 1.1e-08,
    ("BDF(3)", 0.5): 2.0e-08,
    ("BDF(3)", 0.8): 3.6e-08,
    ("BDF(3)", 0.95): 4.4e-08,
    ("L1()", 0.1): 5.5e-07,
    ("L1()", 0.3): 4.9e-06,
    ("L1()", 0.5): 2.7e-05,
    ("L1()", 0.8): 3.0e-04,
    ("L1()", 0.95): 9.6e-04,
    ("L2()", 0.1): 9.6e-11,
    ("L2()", 0.3): 1.4e-09,
    ("L2()", 0.5): 1.7e-08,
    ("L2()", 0.8): 3.4e-07,
    ("L2()", 0.95): 1.3e-06,
    ("L2Sigma()", 0.1): 1.1e-07,
    ("L2Sigma()", 0.3): 2.8e-07,
    ("L2Sigma()", 0.5): 4.0e-07,
    ("L2Sigma()", 0.8): 5.2e-07,
    ("L2Sigma()", 0.95): 6.2e-07,
    ("Adams(corrections=1)", 0.1): 1.0e-03,
    ("Adams(corrections=1)", 0.3): 4.2e-05,
    ("Adams(corrections=1)", 0.5): 2.9e-06,
    ("Adams(corrections=1)", 0.8): 5.1e-07,
    ("Adams(corrections=1)", 0.95): 5.0e-07,
    ("Adams(corrections=3)", 0.1): 2.0e-04,
    ("Adams(corrections=3)", 0.3): 9.4e-07,
    ("Adams(corrections=3)", 0.5): 4.4e-07,
    ("Adams(corrections=3)", 0.8): 4.7e-07,
    ("Adams(corrections=3)", 0.95): 4.9e-07,
    ("ProductTrapezoid()", 0.1): 2.4e-07,
    ("ProductTrapezoid()", 0.3): 3.9e-07,
    ("ProductTrapezoid()", 0.5): 4.4e-07,
    ("ProductTrapezoid()", 0.8): 4.7e-07,
    ("ProductTrapezoid()", 0.95): 4.9e-07,
    ("L1()", 1.2): 5.3e-08,
    ("L1()", 1.5): 3.7e-05,
    ("L1()", 1.8): 4.0e-04,
    ("L1()", 1.95): 1.2e-03,
    ("L2Sigma()", 1.2): 3.4e-07,
    ("L2Sigma()", 1.5): 4.4e-07,
    ("L2Sigma()", 1.8): 4.6e-07,
    ("L2Sigma()", 1.95): 4.6e-07,
    ("ProductTrapezoid()", 1.2): 8.3e-09,
    ("ProductTrapezoid()", 1.5): 5.8e-07,
    ("ProductTrapezoid()", 1.8): 5.3e-07,
    ("ProductTrapezoid()", 1.95): 2.4e-07,
    ("Adams(corrections=1)", 1.2): 8.3e-09,
    ("Adams(corrections=1)", 1.5): 5.8e-07,
    ("Adams(corrections=1)", 1.8): 5.3e-07,
    ("Adams(corrections=1)", 1.95): 2.4e-07,
}
SINGULAR_ERRORS = {
    ("GrunwaldLetnikov()", 0.1): 4.4e-06,
    ("GrunwaldLetnikov()", 0.3): 1.6e-05,
    ("GrunwaldLetnikov()", 0.5): 3.0e-05,
    ("GrunwaldLetnikov()", 0.8): 5.9e-05,
    ("GrunwaldLetnikov()", 0.95): 7.8e-05,
    ("GrunwaldLetnikov()", 1.2): 7.7e-05,
    ("GrunwaldLetnikov()", 1.5): 1.3e-04,
    ("GrunwaldLetnikov()", 1.8): 1.9e-04,
    ("GrunwaldLetnikov()", 1.95): 2.6e-04,
    ("L12()", 0.1): 3.2e-06,
    ("L12()", 0.3): 8.4e-06,
    ("L12()", 0.5): 1.2e-05,
    ("L12()", 0.8): 9.7e-06,
    ("L12()", 0.95): 3.4e-06,
    ("BDF(1)", 0.1): 4.0e-06,
    ("BDF(1)", 0.3): 1.3e-05,
    ("BDF(1)", 0.5): 2.3e-05,
    ("BDF(1)", 0.8): 5.0e-05,
    ("BDF(1)", 0.95): 7.5e-05,
    ("BDF(1)", 1.2): 8.7e-05,
    ("BDF(1)", 1.5): 1.6e-04,
    ("BDF(1)", 1.8): 1.3e-04,
    ("BDF(1)", 1.95): 2.4e-05,
    ("BDF(2)", 0.1): 1.0e-09,
    ("BDF(2)", 0.3): 3.3e-09,
    ("BDF(2)", 0.5): 6.3e-09,
    ("BDF(2)", 0.8): 1.4e-08,
    ("BDF(2)", 0.95): 2.0e-08,
    ("BDF(2)", 1.2): 3.7e-09,
    ("BDF(2)", 1.5): 6.9e-08,
    ("BDF(2)", 1.8): 2.2e-07,
    ("BDF(2)", 1.95): 2.8e-07,
    ("BDF(3)", 0.1): 5.9e-10,
    ("BDF(3)", 0.3): 1.9e-09,
    ("BDF(3)", 0.5): 3.4e-09,
    ("BDF(3)", 0.8): 6.0e-09,
    ("BDF(3)", 0.95): 5.4e-09,
    ("L1()", 0.1): 3.9e-06,
    ("L1()", 0.3): 1.2e-05,
    ("L1()", 0.5): 2.0e-05,
    ("L1()", 0.8): 3.7e-05,
    ("L1()", 0.95): 6.5e-05,
    ("L2()", 0.1): 3.0e-06,
    ("L2()", 0.3): 7.0e-06,
    ("L2()", 0.5): 8.1e-06,
    ("L2()", 0.8): 5.2e-06,
    ("L2()", 0.95): 1.6e-06,
    ("L2Sigma()", 0.1): 2.9e-06,
    ("L2Sigma()", 0.3): 6.6e-06,
    ("L2Sigma()", 0.5): 7.7e-06,
    ("L2Sigma()", 0.8): 4.7e-06,
    ("L2Sigma()", 0.95): 1.4e-06,
    ("Adams(corrections=1)", 0.1): 1.8e-06,
    ("Adams(corrections=1)", 0.3): 8.9e-07,
    ("Adams(corrections=1)", 0.5): 2.4e-07,
    ("Adams(corrections=1)", 0.8): 2.6e-08,
    ("Adams(corrections=1)", 0.95): 1.1e-08,
    ("Adams(corrections=3)", 0.1): 1.7e-06,
    ("Adams(corrections=3)", 0.3): 8.5e-07,
    ("Adams(corrections=3)", 0.5): 2.3e-07,
    ("Adams(corrections=3)", 0.8): 2.6e-08,
    ("Adams(corrections=3)", 0.95): 1.1e-08,
    ("ProductTrapezoid()", 0.1): 1.7e-06,
    ("ProductTrapezoid()", 0.3): 8.5e-07,
    ("ProductTrapezoid()", 0.5): 2.3e-07,
    ("ProductTrapezoid()", 0.8): 2.6e-08,
    ("ProductTrapezoid()", 0.95): 1.1e-08,
    ("L1()", 1.2): 1.2e-09,
    ("L1()", 1.5): 2.1e-06,
    ("L1()", 1.8): 9.3e-06,
    ("L1()", 1.95): 6.4e-05,
    ("L2Sigma()", 1.2): 1.8e-05,
    ("L2Sigma()", 1.5): 2.0e-05,
    ("L2Sigma()", 1.8): 1.5e-05,
    ("L2Sigma()", 1.95): 4.7e-06,
    ("ProductTrapezoid()", 1.2): 2.2e-11,
    ("ProductTrapezoid()", 1.5): 1.4e-08,
    ("ProductTrapezoid()", 1.8): 3.4e-08,
    ("ProductTrapezoid()", 1.95): 4.2e-08,
    ("Adams(corrections=1)", 1.2): 2.2e-11,
    ("Adams(corrections=1)", 1.5): 1.4e-08,
    ("Adams(corrections=1)", 1.8): 3.4e-08,
    ("Adams(corrections=1)", 1.95): 4.2e-08,
}
