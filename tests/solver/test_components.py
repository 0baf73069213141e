"""Rows of some components alone."""

import numpy as np
import pytest

import hereditary as hd


def ring(t, y):
    return np.roll(y, 1) - 2 * y + np.sin(t)


def equation(d=5):
    return hd.Equation(hd.Caputo(0.8), ring, np.arange(1.0, d + 1))


HOW = [
    {"n_steps": 50},
    {"n_steps": 50, "save_every": 7, "scheme": hd.BDF(2)},
    {"n_steps": 50, "t_eval": [0.1, 0.33, 1.0]},
    {"rtol": 1e-6},
    {"rtol": 1e-6, "t_eval": [0.1, 0.33, 1.0]},
]


@pytest.mark.parametrize("how", HOW, ids=str)
def test_rows_are_columns_of_the_whole_run(how):
    crossing = [lambda t, y: y[0] - 2.0]
    whole = hd.solve(equation(), 1.0, events=crossing, **how)
    some = hd.solve(equation(), 1.0, events=crossing, components=[3, 0], **how)
    assert np.array_equal(some.t, whole.t)
    assert np.array_equal(some.y, whole.y[:, [3, 0]])
    assert np.array_equal(some.y_events[0], whole.y_events[0])
    assert some.dense is None
    with pytest.raises(ValueError, match="kept no dense output"):
        some(0.5)
    on = {key: value for key, value in how.items() if key == "scheme"}
    ends = [hd.solve(equation(), 2.0, resume=each.state, **on).y[-1] for each in (whole, some)]
    assert np.array_equal(*ends)


def test_slopes_go_with_them():
    above = hd.Equation(hd.Caputo(1.5), ring, np.array([np.arange(4.0), np.ones(4)]))
    whole, some = (hd.solve(above, 1.0, 20, components=c) for c in (None, [2]))
    assert np.array_equal(some.ydot, whole.ydot[:, [2]])
