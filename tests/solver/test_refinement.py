"""Meshes that are refined until schemes with given steps keep a tolerance."""

import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import given
from hypothesis import strategies as st

import hereditary as hd
from hereditary.exact import mittag_leffler

SCHEMES = [hd.L1(), hd.L2(), hd.L2Sigma()]


def relaxation(alpha, rate):
    start = [1.0, 0.0] if alpha > 1 else 1.0
    return hd.Equation(hd.Caputo(alpha), lambda t, y, p: -p[0] * y, start, params=rate)


def check(sol, truth, rtol):
    """Errors at all times are below the estimate, and that is within the tolerance."""
    assert sol.status == "completed"
    scales = 0.01 + np.maximum.accumulate(np.abs(sol.y), axis=0)
    error, estimate = np.max(np.abs(sol.y - truth) / scales), sol.stats["error_estimate"]
    assert error <= estimate <= rtol
    assert estimate > 1e-3 * rtol  # and no finer than is needed


@pytest.mark.hypothesis
@given(
    st.sampled_from(SCHEMES), st.floats(0.25, 1.8), st.floats(0.2, 5.0), st.sampled_from([-2, -3])
)
def test_relaxation_keeps_its_tolerance(scheme, alpha, rate, digits):
    alpha = min(alpha, 1.0) if scheme == hd.L2() else alpha
    rtol = 10.0**digits
    sol = hd.solve(relaxation(alpha, rate), 3.0, rtol=rtol, scheme=scheme)
    truth = np.array([mittag_leffler(-rate * t**alpha, alpha, 1.0) for t in sol.t])
    check(sol, truth[:, None], rtol)


@pytest.mark.parametrize("scheme", SCHEMES)
def test_steps_begin_anew_at_breaks(scheme):
    """The mesh is refined behind a jump, across which no parabola leans."""
    eq = hd.Equation(hd.Caputo(0.6), lambda t, y: -y + np.where(t > 1.0, 1.0, -1.0), 0.5)
    truth = hd.solve(eq, 3.0, rtol=1e-9, breaks=[1.0])
    sol = hd.solve(eq, 3.0, rtol=1e-3, scheme=scheme, breaks=[1.0])
    check(sol, truth(sol.t), 1e-3)
    assert 1.0 in sol.t
    assert sol.stats["n_steps"] < 1500


def test_a_corner_that_no_clock_resolves_is_not_called_within_the_tolerance():
    """Steps behind the break are as long as the clock tells apart, on all meshes."""
    eq = hd.Equation(hd.Caputo(0.2), lambda t, y: -y + np.where(t > 1e4, 5.0, -5.0), 0.5)
    with pytest.warns(hd.SolveWarning):
        sol = hd.solve(eq, 1e4 + 3, rtol=1e-3, scheme=hd.L1(), breaks=[1e4], max_steps=4000)
    truth = hd.solve(eq, 1e4 + 3, rtol=1e-8, breaks=[1e4])
    scales = 0.01 + np.maximum.accumulate(np.abs(sol.y), axis=0)
    assert np.max(np.abs(sol.y - truth(sol.t)) / scales) < sol.stats["error_estimate"]


@pytest.mark.parametrize("rate", [1e2, 1e5])
@pytest.mark.parametrize("scheme", SCHEMES)
def test_stiff_layers_are_resolved_between_the_steps_as_well(scheme, rate):
    """The first step counts, which no coarser mesh has; neighbours of other lengths have lines.

    Between the times of the mesh the solution errs up to three tolerances.
    """
    sol = hd.solve(relaxation(0.3, rate), 1.0, rtol=1e-2, scheme=scheme)
    times = np.geomspace(1e-24, 1.0, 400)
    truth = np.array([mittag_leffler(-rate * t**0.3, 0.3, 1.0) for t in times])
    assert np.abs(sol(times)[:, 0] - truth).max() < 3e-2
    check(sol, hd.solve(relaxation(0.3, rate), 1.0, rtol=1e-9)(sol.t), 1e-2)


def test_a_terminal_event_on_a_mesh_that_does_not_suffice_is_no_success():
    def below(t, y):
        return y[0] - 0.3

    below.terminal = True
    with pytest.warns(hd.SolveWarning, match="times it"):
        sol = hd.solve(
            relaxation(0.9, 1.0), 5.0, rtol=1e-6, scheme=hd.L1(), events=below, max_steps=60
        )
    assert not sol.success
    assert sol.t_events[0].size == 1


@pytest.mark.parametrize("changes", [{}, {"params": 3.0}])
@pytest.mark.parametrize("t_end", [1.0001, 2.0])
def test_steps_after_a_state_are_no_shorter_than_its_modes_allow(t_end, changes):
    eq = relaxation(0.7, 1.0)
    state = hd.solve(eq, 1.0, rtol=1e-3, scheme=hd.L2()).state
    sol = hd.solve(eq, t_end, rtol=1e-3, scheme=hd.L2(), resume=state, **changes)
    begun = hd.solve(eq, 1.0, rtol=1e-9).state
    truth = hd.solve(eq, t_end, resume=begun, **changes)
    assert abs(sol.y[-1, 0] - truth.y[-1, 0]) < 2e-3


def test_runs_go_on_from_states():
    eq = hd.Equation(hd.Caputo([0.9, 0.7]), lambda t, y: np.array([y[1], -y[0]]), [1.0, 0.0])
    truth = hd.solve(eq, 6.0, rtol=1e-9)
    half = hd.solve(eq, 3.0, rtol=1e-3, scheme=hd.L2())
    rest = hd.solve(eq, 6.0, rtol=1e-3, resume=half.state, scheme=hd.L2(), t_eval=[4.5, 6.0])
    assert np.abs(rest.y - truth([4.5, 6.0])).max() < 3e-3
    assert rest.stats["n_steps"] < 3000


def test_many_components():
    d = 200
    ones, places = np.ones(d - 1), np.arange(1, d + 1) / (d + 1)
    parts = [ones, -2 * np.ones(d), ones]
    a = sp.diags_array(parts, offsets=[-1, 0, 1]) * (d + 1.0) ** 2
    rate = 4 * (d + 1) ** 2 * np.sin(np.pi / (2 * d + 2)) ** 2
    wave = np.sin(np.pi * places)
    sol = hd.solve(
        hd.Equation(hd.Caputo(0.7), None, wave, linear=a), 1.0, rtol=1e-3, scheme=hd.L2Sigma()
    )
    decay = np.array([mittag_leffler(-rate * t**0.7, 0.7, 1.0) for t in sol.t])
    check(sol, decay[:, None] * wave, 1e-3)


def test_every_call_of_the_right_hand_side_counts():
    calls = []

    class Decay:
        def __call__(self, t, y):
            calls.append(t)
            return -y

    with pytest.warns(hd.PythonFunctionWarning):
        eq = hd.Equation(hd.Caputo(0.5), Decay(), 1.0)
    calls.clear()
    sol = hd.solve(eq, 1.0, rtol=1e-2, scheme=hd.L1())
    assert 0 <= len(calls) - sol.stats["n_rhs"] < 10  # the equation tries it before each run


def test_a_mesh_that_does_not_suffice_says_so():
    with pytest.warns(hd.SolveWarning, match="times it"):
        sol = hd.solve(relaxation(0.9, 1.0), 5.0, rtol=1e-5, scheme=hd.L1(), max_steps=400)
    assert sol.status == "step_too_small"
    assert sol.stats["n_steps"] <= 400
    assert sol.t[-1] == 5.0
    assert sol.stats["error_estimate"] > 1e-5


def test_a_solution_that_blows_up_ends_there():
    eq = hd.Equation(hd.Caputo(0.8), lambda t, y: y * y, 1.0)
    with pytest.warns(hd.SolveWarning):
        sol = hd.solve(eq, 5.0, rtol=1e-2, scheme=hd.L2Sigma(), max_steps=2000)
    assert sol.status in ("not_solved", "blown_up")
    assert 0.3 < sol.t[-1] < 0.7
    assert sol.stats["error_estimate"] == np.inf


def jumping(t, y):
    return t - 0.5


jumping.change = lambda t, y: y + 1.0  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("given", "named"),
    [
        ({"scheme": hd.BDF(2)}, "rtol"),
        ({"scheme": hd.ExplicitCaputo()}, "rtol"),
        ({"n_steps": 10}, "n_steps"),
        ({"mesh": hd.graded(10, 2.0)}, "mesh"),
        ({"max_step": 0.1}, "max_step"),
        ({"events": jumping}, "events"),
        ({"rtol": 1e-15}, "rtol"),
        ({"history": hd.FFT()}, "history"),
    ],
)
def test_what_no_mesh_is_refined_for(given, named):
    given = {"rtol": 1e-3, "scheme": hd.L1()} | given
    with pytest.raises(ValueError, match=named):
        hd.solve(relaxation(0.5, 1.0), 1.0, **given)
