"""Bad input: refused before any run, in one wording."""

import math

import numpy as np
import pytest
from refusals import decay, run
from refused_analyses import ROWS as ANALYSES
from refused_equations import ROWS as EQUATIONS
from refused_runs import ROWS as RUNS

import hereditary as hd


@pytest.mark.parametrize(("call", "error", "words"), [*EQUATIONS, *RUNS, *ANALYSES])
def test_refusals(call, error, words):
    with pytest.raises(error, match=words):
        call()


def test_coefficients_of_all_kinds():
    for coefficient in (2, 2.0, np.float64(2.0), np.array(2.0)):
        assert (coefficient * hd.Caputo(0.5)).coefficient == 2.0
        assert (hd.Caputo(0.5) * coefficient).coefficient == 2.0
    assert (-hd.Caputo(0.5)).coefficient == -1.0
    assert (-(2 * hd.Caputo(0.5))).coefficient == -2.0
    assert (3 * (2 * hd.Caputo(0.5))).coefficient == 6.0
    assert (np.array([1.0, 2.0]) * hd.Caputo(0.5)).coefficient.tolist() == [1.0, 2.0]


def test_shorthands_of_initial_values():
    for order, y0, shape in (
        (0.5, 1, (1, 1)),
        (0.5, [1], (1, 1)),
        (0.5, [1, 2, 3], (1, 3)),
        (0.5, [[1, 2, 3]], (1, 3)),
        (1.5, (1, 2), (2, 1)),
        (1.5, [[1], [2]], (2, 1)),
        (1.5, [[1, 2], [3, 4]], (2, 2)),
    ):
        assert hd.Equation(hd.Caputo(order), decay, y0).y0.shape == shape


def test_one_parameter_may_be_a_number():
    for params in (2, 2.0, np.float64(2.0), [2.0], (2,), np.array([2.0])):
        eq = hd.Equation(hd.Caputo(0.5), lambda t, y, p: -p[0] * y, 1.0, params=params)
        assert eq.params.tolist() == [2.0]


def test_what_is_accepted_besides():
    """Whole floats, one time, and rows so rare that the ends alone are kept."""
    assert np.array_equal(run(n_steps=1e1).y, run().y)
    assert np.array_equal(run(t_eval=1.0).y, run().y[-1:])
    assert run(save_every=10**20).t.tolist() == [0.0, 1.0]
    assert hd.BDF(order=3) == hd.BDF(3)


def test_messages_stay_short():
    with pytest.raises(ValueError, match="t_eval must") as caught:
        run(t_eval=np.linspace(0, 2, 100_000))
    assert len(str(caught.value)) < 300


def test_an_order_may_cross_1_where_d_is_stated():
    for order in (0.8, 0.99, 1.0, 1.01, 1.6, 2.4):
        eq = hd.Equation(hd.Caputo(order), decay, [1.0, 0.5, 0.0], d=1)
        rows = math.ceil(order)
        plain = hd.Equation(hd.Caputo(order), decay, [1.0, 0.5, 0.0][:rows])
        ours, theirs = (hd.solve(e, 1.0, rtol=1e-8).y[-1] for e in (eq, plain))
        assert np.array_equal(ours, theirs)
        assert np.array_equal(hd.solve(eq.replace(d=1), 1.0, rtol=1e-8).y[-1], ours)
    two = [[1.0, 2.0], [0.5, 0.6]]
    eq = hd.Equation(hd.Caputo([1.5, 0.6]), decay, two, d=2)
    assert eq.y0.tolist() == [[1.0, 2.0], [0.5, 0.0]]
    crossed = eq.replace(terms=hd.Caputo([0.5, 1.6]))
    assert crossed.y0.tolist() == [[1.0, 2.0], [0.0, 0.6]]


def test_the_hint_on_a_velocity_is_right():
    def hinted(t, x, memory):
        return -x[0] - 0.3 * memory[0, 0]

    start, classical = [1.0, 0.0], hd.Caputo(1.8) + 0.3 * hd.Caputo(1)
    ours = hd.solve(hd.Equation(hd.Caputo(1.8), hinted, start, memory=hd.Caputo(1)), 5.0, rtol=1e-8)
    theirs = hd.solve(hd.Equation(classical, decay, start), 5.0, rtol=1e-8)
    assert ours.y[-1] == pytest.approx(theirs.y[-1], abs=1e-7)


def test_masked_arrays_without_masked_entries_are_arrays():
    equation = hd.Equation(hd.Caputo(0.7), decay, np.ma.array([1.0, 2.0], mask=False))
    assert equation.y0.tolist() == [[1.0, 2.0]]
