"""What runs share, modes and workspaces, changes no result: neither order nor threads matter."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import hereditary as hd
from hereditary.collocation import modes, workspace
from hereditary.collocation.equations import integral_form
from hereditary.support.spares import Spares


def decay(t, y, p):
    return -p[0] * y


EQUATIONS = [
    hd.Equation(operator, decay, np.ones(d), params=[rate])
    for operator in (hd.Caputo(0.5), hd.Caputo(0.8), hd.Caputo(0.8) + 0.5 * hd.Caputo(0.3))
    for d, rate in ((1, 1.0), (1, 3.0), (3, 1.0))
]


def rows(equation, rtol=1e-6):
    solution = hd.solve(equation, 2.0, rtol=rtol)
    return solution.t.tobytes() + solution.y.tobytes()


def forget():
    modes.opened_once.cache_clear()
    modes._over_step.cache_clear()
    workspace.spare_workspaces._kept.clear()


@pytest.fixture(scope="module")
def alone():
    found = []
    for equation in EQUATIONS:
        forget()
        found.append(rows(equation))
    return found


def test_a_run_after_others_equals_one_with_everything_new(alone):
    assert [rows(equation) for equation in EQUATIONS * 2] == alone * 2


def test_runs_in_threads_equal_those_alone(alone):
    with ThreadPoolExecutor(8) as pool:
        assert list(pool.map(rows, EQUATIONS * 8)) == alone * 8


def test_workspaces_of_a_run_that_raised_serve_the_next_one(alone):
    def fails(t, y, p):
        if t > 1.0:
            raise ValueError("late")
        return -p[0] * y

    forget()
    with pytest.warns(hd.SolveWarning, match="late"):
        hd.solve(hd.Equation(hd.Caputo(0.5), fails, 1.0, params=[1.0]), 2.0, rtol=1e-6)
    assert rows(EQUATIONS[0]) == alone[0]


@pytest.mark.parametrize("changed", ["form", "s", "closest", "farthest", "tol"])
def test_changed_modes_are_made_anew(changed):
    forms = [integral_form(equation.system) for equation in EQUATIONS]
    first = {"form": forms[0], "s": 8, "closest": 1e-3, "farthest": 10.0, "t_end": 1.0, "tol": 1e-9}
    other = {"form": forms[3], "s": 6, "closest": 1e-4, "farthest": 20.0, "tol": 1e-8}
    known = modes.opened_once(**first)
    assert modes.opened_once(**first) is known
    new = modes.opened_once(**first | {changed: other[changed]})
    assert new.key != known.key or not np.array_equal(new.weights, known.weights)


def test_equations_with_the_same_terms_share_their_form():
    forms = [integral_form(equation.system) for equation in EQUATIONS]
    assert forms[0] is forms[1]
    assert forms[0] is integral_form(EQUATIONS[0].replace(params=[7.0]).system)
    assert len({id(form) for form in forms}) == 6


@pytest.mark.parametrize("changed", ["rates", "length", "variable"])
def test_a_changed_first_step_is_made_anew(changed):
    bank = modes.Bank(np.array([0.1, 1.0, 10.0]), np.zeros((0, 3)))
    given = {"bank": bank, "variable": modes.Variable(2.0), "length": 0.5}
    other = {"bank": bank._replace(rates=2 * bank.rates), "variable": modes.Variable(3.0)}
    known = modes.over_step(**given)
    assert modes.over_step(**given) is known
    name = "bank" if changed == "rates" else changed
    new = modes.over_step(**given | {name: (other | {"length": 0.25})[name]})
    assert not np.array_equal(new.sampled, known.sampled) or changed == "rates"
    assert not np.array_equal(new.decays, known.decays) or changed == "variable"


def test_spares_give_each_object_to_one_user_and_keep_the_newest():
    spares, made = Spares(2), []

    def make():
        made.append(object())
        return made[-1]

    taken = [spares.take("a", make) for _ in range(3)]
    assert len({id(one) for _, one in taken}) == 3
    for one in taken:
        spares.give_back(one)
    assert [spares.take("a", make)[1] for _ in range(2)] == [made[2], made[1]]
    assert spares.take("a", make)[1] is made[3]
    assert spares.take("b", make)[1] is made[4]
