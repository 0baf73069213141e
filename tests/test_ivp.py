"""`hd.solve_ivp` is SciPy's at order 1, and has memory at others."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import hereditary as hd
from hereditary import exact

TIMES = np.linspace(0.5, 9.5, 7)


def pendulum(t, y, friction, frequency):
    return [y[1], -friction * y[1] - frequency**2 * np.sin(y[0]) + 0.3 * np.cos(t)]


def slopes(t, y, friction, frequency):
    return np.array([[0.0, 1.0], [-(frequency**2) * np.cos(y[0]), -friction]])


def falling(t, y, *args):
    return y[0] - 0.2


falling.direction = -1


def third(t, y, *args):
    return y[1] + 0.1


third.terminal = 3

CASES = {
    "steps": {},
    "times": {"t_eval": TIMES},
    "jacobian": {"jac": slopes, "method": "Radau"},
    "one event": {"events": falling},
    "the third zero ends the run": {"events": [falling, third]},
    "the same at times": {"events": [falling, third], "t_eval": TIMES},
    "from another start": {"t_span": (2.0, 7.0)},
}


@pytest.mark.parametrize("case", CASES.values(), ids=CASES)
def test_it_is_scipys_at_order_1(case):
    how = {"t_span": (0.0, 10.0), "y0": [1.0, 0.0], "dense_output": True} | case
    how |= {"args": (0.1, 1.3), "rtol": 1e-10, "atol": 1e-10}
    expected = solve_ivp(pendulum, **{"method": "DOP853"} | how)
    found = hd.solve_ivp(pendulum, **how)
    assert (found.status, found.success) == (expected.status, expected.success)
    assert found.y.shape == (2, found.t.size)
    times = np.linspace(how["t_span"][0], min(expected.t[-1], found.t[-1]), 50)
    assert np.abs(found.sol(times) - expected.sol(times)).max() < 1e-8
    assert found.sol(times[3]).shape == (2,)
    if "t_eval" in how:
        assert np.array_equal(found.t, expected.t)
        assert np.abs(found.y - expected.y).max() < 1e-8
    assert (found.t_events is None) == (expected.t_events is None)
    for own, known in zip(found.t_events or (), expected.t_events or (), strict=True):
        np.testing.assert_allclose(own, known, atol=1e-8)
    for own, known in zip(found.y_events or (), expected.y_events or (), strict=True):
        np.testing.assert_allclose(own, known, atol=1e-8)


def test_an_order_gives_memory():
    found = hd.solve_ivp(lambda t, y: -2.0 * y, (0, 5), [1.0], order=0.5, rtol=1e-9, atol=1e-12)
    known = exact.relaxation(0.5, 2.0)(found.t)
    assert np.abs(found.y.T - known).max() < 1e-9
    assert found.sol is None
    assert found.t_events is None


def test_a_run_that_ends_early_fails_as_scipys():
    with pytest.warns(hd.SolveWarning):
        found = hd.solve_ivp(lambda t, y: y**2, (0, 2), [1.0], rtol=1e-6)
    assert (found.status, found.success) == (-1, False)
    assert found.t[-1] == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize(
    ("change", "kind", "words"),
    [
        ({"t_span": (1.0, 0.0)}, ValueError, "t_span must be .* start before the end"),
        ({"method": "Euler"}, ValueError, "method must be one of RK45"),
        ({"vectorized": True}, TypeError, "vectorized must be left out"),
        ({"lband": 1}, TypeError, "lband .*bandwidth"),
        ({"rtol": 0.0}, ValueError, "rtol must"),
    ],
)
def test_refusals_name_the_way(change, kind, words):
    with pytest.raises(kind, match=words):
        hd.solve_ivp(**{"fun": lambda t, y: -y, "t_span": (0.0, 1.0), "y0": [1.0]} | change)
