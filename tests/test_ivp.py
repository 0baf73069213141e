"""`hd.solve_ivp` is SciPy's at order 1, and has memory at others."""

import pickle

import numpy as np
import pytest
import scipy.sparse
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


MATRIX = np.array([[-1.0, 0.5], [0.2, -0.7]])


def linear(t, y):
    return MATRIX @ y


@pytest.mark.parametrize(
    "change",
    [
        {"jac": MATRIX},
        {"jac": MATRIX.tolist()},
        {"jac": scipy.sparse.csc_matrix(MATRIX)},
        {"jac": scipy.sparse.coo_array(MATRIX)},
        {"max_step": None},
        {"args": ()},
        {"args": []},
        {"vectorized": False, "first_step": None, "min_step": 0.0, "jac_sparsity": None},
        {"lband": None, "uband": None},
    ],
)
def test_other_ways_to_say_the_same_change_nothing(change):
    how = {"fun": linear, "t_span": (0.0, 3.0), "y0": [1.0, 2.0], "rtol": 1e-8}
    expected = hd.solve_ivp(**how)
    assert hd.solve_ivp(**how | change).y == pytest.approx(expected.y, abs=1e-7)


def test_a_constant_jacobian_that_is_wrong_is_noticed():
    with pytest.raises(ValueError, match="jac"):
        hd.solve_ivp(linear, (0.0, 3.0), [1.0, 2.0], jac=MATRIX.T)


def test_a_result_with_dense_output_is_pickled():
    found = hd.solve_ivp(linear, (0.0, 3.0), [1.0, 2.0], dense_output=True)
    kept = pickle.loads(pickle.dumps(found))
    assert np.array_equal(kept.sol(TIMES[:2]), found.sol(TIMES[:2]))
    assert kept.njev is kept.nlu is None


def test_events_that_never_come_have_the_shapes_of_scipys():
    events = [lambda t, y: y[0] + 100.0, lambda t, y: y[0] - 1.1]
    how = {"t_span": (0.0, 3.0), "y0": [1.0, 2.0], "events": events}
    found, expected = (solver(linear, **how) for solver in (hd.solve_ivp, solve_ivp))
    assert [rows.shape for rows in found.y_events] == [rows.shape for rows in expected.y_events]


@pytest.mark.parametrize("dense_output", [False, True])
def test_a_run_without_a_step_has_its_start_alone(dense_output):
    def nowhere(t, y):
        return np.where(t > 0, np.nan, -y)

    how = {"t_eval": [0.0, 1.0], "dense_output": dense_output}
    with pytest.warns(hd.SolveWarning):
        found = hd.solve_ivp(nowhere, (0.0, 3.0), [1.0, 2.0], **how)
    assert (found.status, found.t.tolist(), found.y.tolist()) == (-1, [0.0], [[1.0], [2.0]])


@pytest.mark.parametrize(
    ("change", "kind", "words"),
    [
        ({"jac": np.eye(3)[:2]}, ValueError, r"jac must .*matrix .*got shape \(2, 3\)"),
        ({"jac": "2-point"}, TypeError, "jac must be a function .*got '2-point'"),
        ({"args": 0.5}, TypeError, r"args must be a sequence .*args=\(value,\)"),
        ({"args": np.ma.array([1.0, 2.0], mask=[0, 1])}, ValueError, "args must .*masked"),
        ({"args": (np.ma.array([1.0], mask=[1]),)}, ValueError, "args must .*masked"),
        ({"max_step": -np.inf}, ValueError, "max_step must be a finite number above 0"),
        ({"max_step": "1"}, TypeError, "max_step must be a finite number above 0"),
        ({"first_step": 0.1}, TypeError, "first_step must .*tolerance"),
        ({"t_eval": [0.0, 0.9, 0.5], "dense_output": True}, ValueError, "t_eval must .*increas"),
        ({"t_eval": [0.0, 0.5, 0.5], "dense_output": True}, ValueError, "t_eval must .*increas"),
        ({"t_eval": [0.0, 1.5], "dense_output": True}, ValueError, "t_eval must .*increas"),
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
