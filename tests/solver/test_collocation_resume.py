"""Adaptive collocation that goes on from a state."""

import pickle

import numpy as np
import pytest
from problems import half_order_relaxation
from random_problems import error

import hereditary as hd

SCENES = [hd.scenes.relaxation, hd.scenes.stick_slip, lambda: hd.scenes.brusselator(0.8)]


@pytest.mark.parametrize("scene", SCENES)
def test_a_state_is_small_and_does_not_grow(scene):
    sizes = [len(pickle.dumps(hd.solve(scene(), t, rtol=1e-8).state)) for t in (10.0, 100.0)]
    assert max(sizes) < 20_000
    assert sizes[1] < 1.3 * sizes[0]


def test_beyond_ten_times_its_length_a_run_is_not_resumed():
    equation = hd.scenes.relaxation(0.5)
    state = hd.solve(equation, 1.0, rtol=1e-8).state
    with pytest.raises(
        ValueError, match=r"resume must .*Collocation\(horizon=11.0\), or with the end"
    ):
        hd.solve(equation, 11.0, rtol=1e-8, resume=state)
    far = hd.Collocation(horizon=1e6)
    state = hd.solve(equation, 1.0, rtol=1e-8, scheme=far).state
    for t_end in (30.0, 1e3, 1e6):
        sol = hd.solve(equation, t_end, rtol=1e-8, scheme=far, resume=state)
        assert error(sol, half_order_relaxation, 1e-8) <= 1
        state = sol.state


@pytest.mark.parametrize("scene", SCENES)
def test_limits_of_steps_go_on(scene, tmp_path):
    first = hd.solve(scene(), 1.0, rtol=1e-4, max_step=0.03, max_steps=200)
    first.save(tmp_path / "first.npz")
    for state in (first.state, hd.Solution.load(tmp_path / "first.npz").state):
        rest = hd.solve(scene(), 2.0, resume=state)
        assert np.diff(rest.t).max() <= 0.03
        assert np.diff(hd.solve(scene(), 3.0, resume=rest.state, max_step=0.3).t).max() > 0.03
        before = rest.stats["n_steps"]
        with pytest.warns(hd.SolveWarning, match="max_steps"):
            last = hd.solve(scene(), 9.9, resume=rest.state)
        assert last.stats["n_steps"] == before + 200
        assert hd.solve(scene(), 9.9, resume=rest.state, max_steps=1000).success


def test_a_long_run_that_keeps_rows_alone():
    """To T = 1e6; the solution is there at the times asked for, and nothing else is kept."""
    times = np.concatenate([[0.0], np.geomspace(1e-6, 1e6, 200)])
    sol = hd.solve(hd.scenes.relaxation(0.5), 1e6, rtol=1e-10, t_eval=times)
    assert sol.t.tolist() == times.tolist()
    np.testing.assert_allclose(sol.y, half_order_relaxation(times), rtol=1e-9)
    assert sol.dense is None
    assert sol.stats["n_steps"] < 300
