"""Coefficients that are matrices: solved for the highest derivatives, the rest read as memory."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from problems import assert_converges, run
from scipy.integrate import solve_ivp

import hereditary as hd

C = hd.Caputo
SCHEMES = (hd.ExplicitCaputo(), hd.L1(), hd.BDF(2), hd.Collocation())


def rotated(angle, values):
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    return turn, turn @ np.diag(values) @ turn.T


@given(
    alpha=st.floats(0.6, 1.9),
    share=st.floats(0.1, 0.9),
    angle=st.floats(0.1, 1.5),
    values=st.lists(st.floats(0.5, 2.0), min_size=4, max_size=4),
    scheme=st.sampled_from(SCHEMES),
)
def test_it_is_the_rotated_system(alpha, share, angle, values, scheme):
    """With matrices of common axes the components along these stand alone."""
    lead, low = np.array(values[:2]), np.array(values[2:])
    turn, matrix = rotated(angle, lead)
    _, lower = rotated(angle, low)

    def force(t, y, p):
        return -y + np.cos(t) * p[:2]

    y0 = np.array([1.0, -0.5])
    both = [matrix * C(alpha), lower * C(share * alpha)]
    alone = [lead * C(alpha), low * C(share * alpha)]
    start, turned = (y0, turn.T @ y0) if alpha <= 1 else ([y0, -y0], [turn.T @ y0, -turn.T @ y0])
    push = np.array([0.3, 0.7])
    ours = run(hd.Equation(both, force, start, push), scheme)
    theirs = run(hd.Equation(alone, force, turned, turn.T @ push), scheme)
    expected = theirs.y @ turn.T
    if isinstance(scheme, hd.Collocation):
        np.testing.assert_allclose(ours.y[-1], expected[-1], atol=1e-7)
    elif isinstance(scheme, hd.ExplicitCaputo):  # memory is read a step late: to first order
        assert np.abs(ours.y - expected).max() < 0.15
    else:
        np.testing.assert_allclose(ours.y, expected, atol=1e-9)


@pytest.mark.parametrize("scheme", [*SCHEMES, hd.Adams(), hd.GrunwaldLetnikov()], ids=repr)
def test_one_term_is_multiplied_by_the_inverse(scheme):
    matrix = np.array([[1.0, 0.2], [0.3, 1.5]])
    inverse = np.linalg.inv(matrix)

    def force(t, y):
        return np.array([-y[0] + np.sin(t), y[0] * y[1]])

    def slopes(t, y):
        return np.array([[-1.0, 0.0], [y[1], y[0]]])

    ours = run(hd.Equation(matrix * C(0.8), force, [1.0, 0.3]), scheme)
    theirs = run(hd.Equation(C(0.8), lambda t, y: inverse @ force(t, y), [1.0, 0.3]), scheme)
    np.testing.assert_allclose(ours.y[-1], theirs.y[-1], rtol=1e-8)
    exact = run(hd.Equation(matrix * C(0.8), force, [1.0, 0.3], jac=slopes), scheme)
    np.testing.assert_allclose(exact.y[-1], ours.y[-1], rtol=1e-7)


def test_classical_matrices_are_scipys():
    mass = np.array([[2.0, 0.3], [0.3, 1.0]])
    damping = np.array([[0.2, -0.1], [-0.1, 0.4]])
    spring = np.array([[3.0, -1.0], [-1.0, 2.0]])

    def force(t, y):
        return np.array([np.cos(t), 0.0]) - spring @ y

    eq = hd.Equation(mass * C(2) + damping * C(1), force, [[1.0, 0.0], [0.0, 0.5]])

    def first_order(t, u):
        y, v = u[:2], u[2:]
        return np.append(v, np.linalg.solve(mass, force(t, y) - damping @ v))

    told = solve_ivp(first_order, (0, 10), [1.0, 0.0, 0.0, 0.5], "DOP853", rtol=1e-12, atol=1e-12)
    sol = hd.solve(eq, 10.0, rtol=1e-9)
    assert np.abs(sol.y[-1] - told.y[:2, -1]).max() < 1e-7
    assert np.abs(sol.ydot[-1] - told.y[2:, -1]).max() < 1e-7

    def end(n):
        return hd.solve(eq, 10.0, n, scheme=hd.BDF(2)).y[-1]

    assert_converges(end, told.y[:2, -1], (1000, 2000), 2, 1e-3)


def test_a_zener_body_as_it_is_written():
    """Stress s + b D^a s = E (e + c D^a e) under a strain e(t) = t, by an equation of its own."""
    a, b, c, modulus, t_end = 0.6, 0.5, 1.4, 2.0, 3.0
    # rows: the material; the strain. D^a of both stand in the first.
    terms = [np.array([[b, -modulus * c], [0.0, 0.0]]) * C(a), np.diag([0.0, 1.0]) * C(1)]

    body = hd.Equation(terms, lambda t, y: np.array([modulus * y[1] - y[0], 1.0]), [0.0, 0.0])
    sol = hd.solve(body, t_end, rtol=1e-9)
    of_ramp = c / 0.8872638175030753  # Gamma(2 - a)

    def stress(t, y):
        return (modulus * (t + of_ramp * t ** (1 - a)) - y) / b

    alone = hd.solve(hd.Equation(C(a), stress, 0.0), t_end, rtol=1e-9)
    assert abs(sol.y[-1, 0] - alone.y[-1, 0]) < 1e-8
    assert abs(sol.y[-1, 1] - t_end) < 1e-10


def test_products_of_coefficients():
    a, b, v = np.array([[1.0, 2.0], [3.0, 4.0]]), np.array([[0.0, 1.0], [1.0, 0.0]]), [5.0, 6.0]
    for term, expected in (
        (2 * (a * C(0.5)), 2 * a),
        (a * (2 * C(0.5)), 2 * a),
        (b * (a * C(0.5)), b @ a),
        (np.array(v) * (a * C(0.5)), np.diag(v) @ a),
        (a * (np.array(v) * C(0.5)), a @ np.diag(v)),
        ((a * C(0.5)) / 2, a / 2),
    ):
        np.testing.assert_array_equal(term.coefficient, expected)


def test_changes_may_come_before_the_first_step_of_a_stretch_ends():
    """No row besides the start is then left of it. A change to the present value is none."""
    terms = np.array([[1.0, 0.2], [0.0, 1.0]]) * C(0.8) + 0.3 * C(0.3)
    eq = hd.Equation(terms, lambda t, y: -y, [1.0, 0.5])
    alone = hd.solve(eq, 4.0, rtol=1e-9)
    for when in np.linspace(0.5, 3.5, 40):

        def event(t, y, when=when):
            return t - when

        event.change = lambda t, y: y
        sol = hd.solve(eq, 4.0, rtol=1e-8, events=event)
        assert sol.success
        assert sol.t_events[0] == pytest.approx([when], rel=1e-9)
        assert np.abs(sol.y - alone(sol.t)).max() < 1e-7
