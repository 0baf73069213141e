"""States: what they go on with, and what they refuse."""

import copy
import dataclasses
import pickle

import numpy as np
import pytest

import hereditary as hd

pytestmark = pytest.mark.core

GROWTH = lambda t, y, p: p[0] * y  # noqa: E731
WAYS = [({"n_steps": 100}, hd.L1()), ({"rtol": 1e-8}, hd.Collocation())]


def equation(rhs=(lambda t, y, p: -p[0] * y), y0=1.0, params=(1.0,)):
    return hd.Equation(hd.Caputo(0.5), rhs, y0, params=params)


def begun(steps, scheme):
    return hd.solve(equation(), 1.0, scheme=scheme, **steps)


def test_a_run_keeps_its_history_its_tolerances_and_modes():
    state = hd.solve(equation(), 1.0, 100, history=hd.Direct()).state
    assert hd.solve(equation(), 2.0, resume=state).stats["n_modes"] == 0
    kept = {"rtol": 1e-4, "atol": 1e-9, "history": hd.SumOfExponentials(1e-12)}
    first = hd.solve(equation(), 1.0, scheme=hd.Collocation(nodes=3), **kept)
    for given in ({}, {"rtol": 1e-4}, {"atol": 1e-9}, kept):
        sol = hd.solve(equation(), 2.0, resume=first.state, **given)
        assert sol.state.how[:3] == first.state.how[:3] == (1e-4, 1e-9, 1e-12)
        assert sol.stats["n_modes"] == first.stats["n_modes"]
    for other in ({"rtol": 1e-6}, {"atol": 1e-8}, {"history": hd.SumOfExponentials(1e-10)}):
        with pytest.raises(ValueError, match=r"(resume|history) must .*(tolerances|1e-12)"):
            hd.solve(equation(), 2.0, resume=first.state, **other)


@pytest.mark.parametrize(("steps", "scheme"), WAYS)
@pytest.mark.parametrize(
    ("other", "name"),
    [({"params": [5.0]}, "params"), ({"rhs": GROWTH}, "right-hand side"), ({"y0": 7.0}, "y0")],
)
def test_another_equation_is_refused_unless_that_is_meant(steps, scheme, other, name):
    state = begun(steps, scheme).state
    with pytest.raises(ValueError, match=f"resume must come from a run with the same {name}, here"):
        hd.solve(equation(**other), 2.0, resume=state)
    if name == "y0":  # where it began does not change
        with pytest.raises(ValueError, match="same y0"):
            hd.solve(equation(**other), 2.0, resume=state, allow_change=True)
    else:
        sol = hd.solve(equation(**other), 2.0, resume=state, allow_change=True)
        assert sol.y[0] == pytest.approx(0.427584, abs=1e-3)


@pytest.mark.parametrize(("steps", "scheme"), WAYS)
def test_states_cannot_be_changed_and_those_of_another_version_are_refused(steps, scheme):
    """Arrays of a state are read-only; versions before this one left no name in it."""
    state = begun(steps, scheme).state
    with pytest.raises(ValueError, match="read-only"):
        state.y[0] = 0.0
    state.__dict__["version"] = "0.0.1"
    with pytest.raises(ValueError, match=r"same version of hereditary, here .*, got 0\.0\.1"):
        hd.solve(equation(), 2.0, resume=state)
    del state.__dict__["version"]
    with pytest.raises(ValueError, match=r"same version of hereditary"):
        hd.solve(equation(), 2.0, resume=state)


def arrays_of(state):
    """Places of arrays in the checkpoint of a state: the march, then the memory or the orbit."""
    march, memory, *_ = state.checkpoint
    yield from ((0, i) for i, array in enumerate(march) if array.size)
    if isinstance(memory, tuple):
        yield from ((1, i) for i, array in enumerate(memory) if array.size)
    else:
        yield from ((1, name) for name in ("x", "p", "modes", "before", "last", "offsets"))


def with_other(state, place, change):
    """The state with one array changed."""
    state, (number, name) = copy.deepcopy(state), place
    parts = list(state.checkpoint)
    if isinstance(name, str):
        setattr(parts[number], name, change(getattr(parts[number], name)))
    else:
        arrays = list(parts[number])
        arrays[name] = change(arrays[name])
        parts[number] = tuple(arrays)
    return dataclasses.replace(state, checkpoint=tuple(parts))


@pytest.mark.parametrize(("steps", "scheme"), WAYS)
@pytest.mark.parametrize(
    "change",
    [lambda a: a[..., :-1].copy(), lambda a: a.astype(np.float32), lambda a: a[..., None]],
    ids=["cut", "single precision", "an axis more"],
)
def test_a_damaged_state_is_refused(steps, scheme, change):
    state = begun(steps, scheme).state
    for place in arrays_of(state):
        damaged = with_other(state, place, change)
        with pytest.raises(ValueError, match="resume must be a state as a run left it, got arrays"):
            hd.solve(equation(), 2.0, resume=damaged)


def test_kernels_that_are_functions_are_known_by_their_values():
    def damped(rate):
        kernel = hd.Kernel(lambda t: np.exp(-rate * t))
        terms = [hd.Caputo(1.0), 0.5 * hd.Memory(kernel, 1)]
        return hd.Equation(terms, lambda t, y: -y, 1.0)

    first = hd.solve(damped(1.0), 1.0, rtol=1e-5, scheme=hd.Collocation(horizon=2.0))
    state = pickle.loads(pickle.dumps(first.state))
    assert hd.solve(damped(1.0), 2.0, resume=state).success
    with pytest.raises(ValueError, match="resume must come from a run with the same kernels"):
        hd.solve(damped(1.1), 2.0, resume=state)


def test_long_messages_are_cut():
    many = np.linspace(0.5, 1.0, 1000)
    state = hd.solve(equation(params=many), 1.0, 10).state
    with pytest.raises(ValueError, match="same params") as caught:
        hd.solve(equation(params=2 * many), 2.0, resume=state)
    assert len(str(caught.value)) < 600


@pytest.mark.parametrize("how", [{"n_steps": 100}, {"rtol": 1e-8}])
def test_going_on_with_other_params(how):
    """A rate that is switched half-way, the memory kept."""

    eq = hd.Equation(hd.Caputo(0.7), lambda t, y, p: -p[0] * y, 1.0, [1.0])
    half = hd.solve(eq, 1.0, **how)
    rest = hd.solve(eq, 2.0, resume=half.state, params=[3.0])
    other = hd.solve(eq.replace(params=[3.0]), 2.0, resume=half.state, allow_change=True)
    np.testing.assert_array_equal(rest.y, other.y)
    whole = {"n_steps": 200} if "n_steps" in how else how
    switched = hd.Equation(hd.Caputo(0.7), lambda t, y: -(1.0 if t < 1.0 else 3.0) * y, 1.0)
    told = hd.solve(switched, 2.0, breaks=[1.0], **whole)
    assert abs(rest.y[-1, 0] - told.y[-1, 0]) < (1e-7 if "rtol" in how else 5e-3)
    third = hd.solve(eq, 3.0, resume=rest.state, params=3.0)
    assert third.success
    with pytest.raises(ValueError, match="same params"):
        hd.solve(eq, 3.0, resume=rest.state)
