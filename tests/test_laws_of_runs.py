"""Laws that every run obeys: each is stated once and holds for all cases (tests/cases.py)."""

import pickle
import warnings

import numpy as np
import pytest
from cases import (
    CASES,
    DIRECT,
    EVERY,
    HISTORIES,
    LONG,
    N_STEPS,
    ROUNDING,
    SCHEMES,
    T_END,
    TANGENTS,
    TOL,
    assert_close,
    backward,
    beside_another,
    chosen,
    over,
    spiral,
)

import hereditary as hd

UNIFORM = chosen(steps="uniform")
# One history is enough where it does not enter.
ALSO_MESHES = [c for c in CASES if c.history in (None, HISTORIES[2])]
ONCE = [c for c in ALSO_MESHES if c.steps != "mesh"]


@pytest.mark.parametrize("scheme", SCHEMES, ids=repr)
def test_a_run_is_made_if_the_declared_abilities_allow_it_and_refused_otherwise(scheme):
    for case in (case for case in EVERY if case.scheme is scheme):
        if case.allowed():
            assert case.solve(0.25, n=8).success, case
        else:
            with pytest.raises(ValueError, match=r"must .*, got "):
                pytest.fail(f"{case}: {case.solve(0.25, n=8)}")


def stored(sol, path, by_file):
    """Return the state of a solution from a file, or from a pickle."""
    if not by_file:
        return pickle.loads(pickle.dumps(sol.state))
    sol.save(path / "run.npz")
    return hd.Solution.load(path / "run.npz").state


# One cut a case: each scheme meets each cut with each of its histories, in a third of its families.
CUTS = [(case, (n + n // 3) % 3) for n, case in enumerate(UNIFORM)]


@pytest.mark.parametrize(("case", "which"), CUTS, ids=str)
def test_a_run_that_was_stopped_goes_on_bit_for_bit(case, which, tmp_path):
    """Also from a state that was stored, and where a block or a stretch of FFT ends."""
    cut = ((1, 1024, 1025) if case.history == HISTORIES[1] else (1, 32, 65))[which]
    n = LONG if case.history == HISTORIES[1] else N_STEPS
    h, start = T_END / n, (0.0, -2.0, 0.0)[which]
    first, through = case.solve(cut * h, n=cut, start=start), case.solve(n=n, start=start)
    state = stored(first, tmp_path, by_file=which > 0)
    rest = hd.solve(case.equation(start=start), start + n * h, resume=state, **case.again())
    assert np.array_equal(first.y, through.y[: cut + 1])
    assert np.array_equal(rest.y, through.y[cut:])
    t = np.linspace(rest.t[0], rest.t[-1], 33)
    assert_close(rest(t), through(t), case, 1e-11)


@over([case for case in CASES if case.steps != "uniform"])
@pytest.mark.parametrize("cut", [1, 40])
def test_a_run_that_was_stopped_goes_on_as_one(case, cut, tmp_path):
    """On a mesh bit for bit, or as its modes allow; within the tolerance if steps are chosen."""
    through, how = case.solution(), case.how()
    if case.given:
        mesh, modes = how["mesh"], isinstance(case.history, hd.SumOfExponentials)
        cut = max(cut, 33 if modes else 1)  # modes reach ten times as far as a run
        first = hd.solve(case.equation(), mesh[cut], **how | {"mesh": mesh[: cut + 1]})
        state = stored(first, tmp_path, by_file=True)
        rest = hd.solve(case.equation(), T_END, resume=state, mesh=mesh[cut:])
        # sums of exponentials are fitted for the mesh that a run is begun with
        assert_close(rest.y, through.y[cut:], case, 10 * TOL if modes else 0.0)
    else:
        first = case.solve(0.5 + 0.02 * cut)
        states = [stored(first, tmp_path, by_file) for by_file in (True, False)]
        rest, same = (hd.solve(case.equation(), T_END, resume=state) for state in states)
        assert np.array_equal(rest.y, same.y)
        assert_close(rest.y[-1], through.y[-1], case)


@pytest.mark.parametrize("steps", ["uniform", "mesh"])
@pytest.mark.parametrize(
    "scheme", [s for s in SCHEMES if not isinstance(s, hd.Collocation)], ids=str
)
def test_histories_agree_within_their_tolerance_and_not_much_better(scheme, steps):
    """Over more than two stretches of FFT."""
    apart = {history: [0.0] for history in HISTORIES}
    n = LONG if steps == "uniform" else N_STEPS
    direct = {c.family: c.solve(n=n).y for c in chosen(scheme=scheme, steps=steps, history=DIRECT)}
    for case in chosen(scheme=scheme, steps=steps):
        expected = direct[case.family]
        off = np.abs(case.solve(n=n).y - expected).max() / np.abs(expected).max()
        apart[case.history].append(off)
    assert max(apart[HISTORIES[1]]) <= 1e-12
    assert max(apart[HISTORIES[2]]) <= 10 * TOL
    if len(apart[HISTORIES[2]]) > 1:
        assert max(apart[HISTORIES[2]]) >= 1e-5 * TOL


@over(CASES)
def test_rows_are_what_the_dense_output_gives(case):
    sol = case.solution()
    assert_close(sol(sol.t), sol.y, case, 1e-13)
    between = 0.5 * (sol.t[1:] + sol.t[:-1])
    rows = hd.solve(case.equation(), T_END, **case.how(), t_eval=between)
    assert_close(rows.y, sol(between), case, 1e-13)
    assert rows.stats["n_rhs"] == sol.stats["n_rhs"]
    if sol.ydot is not None:
        size = np.nanmax(np.abs(sol.ydot))
        np.testing.assert_allclose(rows.ydot, sol(between, 1), rtol=0, atol=1e-11 * size)
    some = hd.solve(case.equation(), T_END, **case.how(), save_every=7)
    kept = sorted({*range(0, sol.t.size - 1, 7), sol.t.size - 1})
    assert np.array_equal(some.t, sol.t[kept])
    assert_close(some.y, sol.y[kept], case, 1e-13)


# Estimates of these errors, in sizes, are beside the point: an accurate run knows none below 1e-4.
TOLD = 2e-4


@pytest.mark.estimates
@over(ONCE + chosen(steps="mesh", history=HISTORIES[2]))
def test_error_estimates_are_true(case):
    """Of given steps within 10 per cent where errors exceed twice the tolerance of the estimate."""
    equation, how = case.equation(), case.how(n=60) | {"estimate": True}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", hd.SolveWarning)  # of large errors
        sol = hd.solve(equation, T_END, **(how if case.given else case.how()))
    truth = hd.solve(equation, T_END, scheme=hd.Collocation(), rtol=1e-11)(sol.t)
    off, told = np.abs(sol.y - truth), sol.stats["error_estimate"]
    if not case.given:
        assert off.max() / np.abs(sol.y).max() <= 2 * told + 1e-14
        return
    off = (off / np.abs(truth).max(axis=0)).max()
    assert 0.9 * off <= told <= 1.1 * max(off, TOLD)


@over(ONCE)
def test_units_of_y_do_not_matter(case):
    """A power of two, which is exact; so are the steps where they are chosen."""
    assert_close(case.solve(y=2.0**40).y[-1] / 2.0**40, case.solution().y[-1], case)


@over([case for case in ONCE if "varying" not in case.family.tags])
def test_units_of_time_do_not_matter(case):
    assert_close(case.solve(time=5.0).y[-1], case.solution().y[-1], case, 1e-9)


@over([case for case in ALSO_MESHES if "varying" not in case.family.tags])
def test_the_start_does_not_matter(case):
    sol = case.solve(start=3.0, events=lambda t, y: t - 4.7)
    assert_close(sol.y[-1], case.solution().y[-1], case, 1e-9)
    assert sol.t_events[0] == pytest.approx([4.7], abs=1e-12)


@over([case for case in ONCE if case.family.d == 2])
def test_the_order_of_components_does_not_matter(case):
    found = case.solve(places=[1, 0], f=backward).y[-1, ::-1]
    assert_close(found, case.solution().y[-1], case, 1e-9)


@over([case for case in ONCE if case.family.f is spiral and case.family.name == "system"])
def test_a_component_beside_them_changes_nothing(case):
    found = case.solve(f=beside_another, more=[0.3]).y[-1, :2]
    assert_close(found, case.solution().y[-1], case, 1e-9)


# Initial values of Riemann-Liouville terms are corrected in the first step alone on a mesh.
@over([c for c in chosen(steps="mesh") if "Riemann-Liouville" not in c.family.name])
def test_a_uniform_mesh_gives_the_uniform_march(case):
    times = np.linspace(0, T_END, N_STEPS + 1)
    mesh = hd.solve(case.equation(), T_END, **case.how() | {"mesh": times})
    how = {"scheme": case.scheme, "history": DIRECT}
    modes = isinstance(case.history, hd.SumOfExponentials)
    uniform = hd.solve(case.equation(), T_END, N_STEPS, **how)
    assert_close(mesh.y, uniform.y, case, 10 * TOL if modes else ROUNDING)


@over([case for case in ONCE if "banded" in case.family.tags])
def test_bands_give_the_numbers_of_dense_jacobians(case):
    dense = hd.solve(case.equation().replace(bandwidth=None), T_END, **case.how())
    assert_close(case.solution().y[-1], dense.y[-1], case)
    if getattr(case.scheme, "solve", "") == "newton":
        assert case.solution().stats["n_rhs"] < dense.stats["n_rhs"]


@over([c for c in TANGENTS if not c.given and "memory" not in c.family.tags])
def test_tangents_by_a_tolerance_are_difference_quotients(case):
    tangents = hd.sensitivities(case.equation(), T_END, **case.how(), wrt="y0").by_y0[-1]
    for c in range(case.family.d):
        ends = [hd.solve(case.moved(c, by), T_END, **case.how()).y[-1] for by in (1e-4, -1e-4)]
        quotient = (ends[0] - ends[1]) / 2e-4
        assert np.abs(tangents[:, c] - quotient).max() <= 1e-3 * np.abs(quotient).max()


@over(ALSO_MESHES)
def test_events_are_roots_of_the_dense_output(case):
    def level(t, y):
        return y[0].real - 0.5

    sol = hd.solve(case.equation(), T_END, **case.how(), events=level)
    t = np.linspace(0, T_END, 20_001)
    value = sol(t)[:, 0].real - 0.5
    crossed = np.flatnonzero(value[1:] * value[:-1] < 0)
    found = sol.t_events[0]
    # two within one step that is given may be passed over
    _, counts = np.unique(np.searchsorted(sol.t, t[crossed]), return_counts=True)
    assert np.sum(counts % 2 if case.given else counts) <= len(found) <= len(crossed)
    apart = np.abs(found[:, None] - t[crossed]).min(axis=1, initial=np.inf)
    assert np.all(apart <= 2 * (t[1] - t[0]))
    assert np.abs(sol(found)[:, 0].real - 0.5).max(initial=0.0) <= 1e-9


@over([case for case in CASES if case.steps != "mesh"])
def test_members_of_an_ensemble_are_single_runs(case):
    how = case.how()
    how.pop("estimate", None)
    equation, y0 = case.equation(), np.array(case.family.y0)
    y0 = y0[0] if len(y0) == 1 else y0
    members = {"params": [equation.params, [1.0, 1.0, 0.5]], "y0": [y0, 0.9 * y0]}
    runs = hd.ensemble(equation, T_END, **how, **members)
    for m, y in enumerate(runs.y):
        own = {name: table[m] for name, table in members.items()}
        one = hd.solve(equation.replace(**own), T_END, **case.how())
        same = one.y if case.given else one(runs.t)
        # first steps of all members are found at once, by sums in another order
        begun = getattr(case.scheme, "formula", 0) > 2
        assert_close(y, same, case, 1e-13 if begun else 0.0)
