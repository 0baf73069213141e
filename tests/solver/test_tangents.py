"""Restarts of steppers with tangents, and their states; tangents themselves are laws of runs."""

import numpy as np
import pytest
from cases import GIVEN
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

import hereditary as hd
from hereditary.equation.system import displaced
from hereditary.schemes.steps import UniformSteps
from hereditary.solver.fixed_stepper import FixedStepper

HISTORIES = [hd.Direct(), hd.FFT(), hd.SumOfExponentials(1e-12)]
H = 0.01


def swing(t, y):
    return np.array([np.sin(y[1]) - y[0] ** 3 + np.cos(t), y[0] * y[1] - 2.0 * y[1]])


EQUATIONS = {
    "fractional": lambda: hd.scenes.lorenz(alpha=0.95),
    "classical": lambda: hd.scenes.lorenz(),
    "second order": lambda: hd.scenes.duffing(x0=1.0, v0=0.5),
    "one term above one": lambda: hd.scenes.duffing(
        beta=1.6, friction=0.0, force=1.0, x0=1.0, v0=0.5
    ),
    "several terms": lambda: hd.scenes.stick_slip(beta=1.6, gamma=0.7),
    "incommensurate": lambda: hd.scenes.brusselator(alpha=(0.9, 0.7)),
    "one component above one": lambda: hd.Equation(
        hd.Caputo([1.4, 0.6]), swing, [[1.0, 0.5], [0.5, 0.0]]
    ),
}


def takes(scheme, name):
    """Whether the scheme is made for the equation."""
    try:
        FixedStepper(EQUATIONS[name](), scheme, hd.Direct(), UniformSteps(H), 10)
    except ValueError:
        return False
    return True


PAIRS = [(scheme, name) for scheme in GIVEN for name in EQUATIONS if takes(scheme, name)]


def open_stepper(equation, scheme, history, n_tangents=None, seed=0, n_steps=2500):
    """A stepper, with tangents along random directions where their number is given."""
    directions = None
    if n_tangents is not None:
        n_data = equation.d + int(np.sum(equation.highest_orders() > 1))
        directions = np.random.default_rng(seed).normal(size=(n_data, n_tangents))
    return FixedStepper(equation, scheme, history, UniformSteps(H), n_steps, directions=directions)


def march(stepper, n_end):
    while stepper.n < n_end:
        stepper.advance(n_end, keep=False)
    return stepper


@settings(max_examples=10)
@given(
    matrix=hnp.arrays(np.float64, (2, 2), elements=st.floats(-3, 3)),
    n=st.integers(1, 90),
    n_more=st.integers(1, 90),
)
def test_state_with_tangents_goes_on_bit_for_bit(matrix, n, n_more):
    equation = EQUATIONS["several terms"]()
    first = march(open_stepper(equation, hd.L1(), hd.SumOfExponentials(), 2), n)
    first.transform_tangent(matrix)
    second = open_stepper(equation, hd.L1(), hd.SumOfExponentials(), 2)
    second.restore(first.state())
    assert np.array_equal(march(first, n + n_more).tangent, march(second, n + n_more).tangent)


def test_state_belongs_to_its_number_of_tangents():
    equation = EQUATIONS["several terms"]()
    state = open_stepper(equation, hd.L1(), hd.Direct(), 1).state()
    with pytest.raises(ValueError, match="same tangents, here 2, got 1"):
        open_stepper(equation, hd.L1(), hd.Direct(), 2).restore(state)


@pytest.mark.parametrize("history", HISTORIES, ids=str)
@pytest.mark.parametrize(("scheme", "name"), PAIRS, ids=str)
def test_restart_is_a_new_problem_from_the_present_values(scheme, name, history):
    equation = EQUATIONS[name]()
    stepper = march(open_stepper(equation, scheme, history, 1), 40)
    y, ydot, tangent = stepper.y, stepper.ydot, stepper.tangent
    stepper.restart()
    assert np.array_equal(stepper.y, y)
    assert np.allclose(stepper.tangent, tangent, rtol=1e-14)
    assert stepper.t == pytest.approx(40 * H)
    initial = np.zeros_like(equation.y0)
    initial[0] = y
    above = equation.highest_orders() > 1
    initial[1:, above] = ydot[above]
    if name in ("second order", "one term above one", "several terms", "one component above one"):
        return  # these depend on time itself: a new problem would begin at time 0
    new = FixedStepper(
        displaced(equation, initial), scheme, history, UniformSteps(H), 2500, directions=tangent
    )
    march(stepper, 50)
    march(new, 50)
    assert np.allclose(stepper.y, new.y, rtol=1e-13)
    assert np.allclose(stepper.tangent, new.tangent, rtol=1e-12)


def test_restart_keeps_the_time_of_orders():
    """The order goes on from where it was: a restarted run is one of the function alpha(t + 1)."""

    def alpha(t):
        return 0.5 + 0.3 * np.sin(t)

    equation = hd.Equation(hd.Caputo(alpha), lambda t, y: np.cos(t) - y, 1.0)
    stepper = march(open_stepper(equation, hd.L1(), hd.SumOfExponentials(), 1), 100)
    y = stepper.y
    stepper.restart()
    later = hd.Equation(hd.Caputo(lambda t: alpha(t + 1.0)), lambda t, y: np.cos(t + 1) - y, y)
    expected = hd.solve(later, 1.0, 100, scheme=hd.L1()).y[-1]
    assert march(stepper, 100).y == pytest.approx(expected, rel=1e-12)


def test_restart_keeps_time():
    """Where the right-hand side is a function of time alone, a restarted integral goes on."""
    equation = hd.Equation(hd.Caputo(1.0), lambda t, y: np.array([np.cos(t)]), 0.0)
    stepper = march(open_stepper(equation, hd.L2Sigma(), hd.Direct(), 1), 100)
    stepper.restart()
    assert march(stepper, 100).y[0] == pytest.approx(np.sin(2.0), abs=1e-5)
