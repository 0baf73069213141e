"""What adaptive collocation takes and what it refuses."""

import numpy as np
import pytest
from problems import half_order_relaxation
from random_problems import error

import hereditary as hd


def squared(t, y):
    return y**2


@pytest.mark.parametrize(
    ("change", "kind", "match"),
    [
        ({"n_steps": 100}, ValueError, "n_steps must be left out with Collocation.*, got 100"),
        ({"mesh": hd.graded(10, 2.0)}, ValueError, "mesh must be left out with Collocation.*, got"),
        ({"history": hd.Direct()}, ValueError, r"history must be left out .*, got Direct\(\)"),
        ({"history": hd.FFT()}, ValueError, "history must be left out .*, got FFT"),
        ({"rtol": 1e-13}, ValueError, r"rtol must lie in \[1e-12, 0.1\], got 1e-13"),
        ({"rtol": 0.0}, ValueError, "rtol must lie in"),
        ({"rtol": 0.2}, ValueError, "rtol must lie in"),
        ({"rtol": np.nan}, ValueError, "rtol must lie in"),
        ({"rtol": "fine"}, TypeError, "rtol must lie in .*, got 'fine'"),
        ({"atol": 0.0}, ValueError, "atol must be a finite number above 0, got 0.0"),
        ({"atol": -1e-8}, ValueError, "atol must be a finite number above 0, got -1e-08"),
        ({"breaks": [0.5, 0.2]}, ValueError, r"breaks must be increasing times above 0, got \[0.5"),
        ({"breaks": [0.5, 0.5]}, ValueError, "breaks must be increasing"),
        ({"breaks": [0.0, 0.5]}, ValueError, "breaks must be increasing times above 0, got"),
        ({"breaks": [-1.0]}, ValueError, "breaks must be increasing times above 0, got"),
        ({"breaks": 0.5}, ValueError, "breaks must be increasing times above 0, got"),
        ({"breaks": [[0.5]]}, ValueError, "breaks must be increasing times above 0, got"),
        ({"breaks": [0.5, np.nextafter(0.5, 1)]}, ValueError, "breaks must lie apart by more than"),
        ({"t_end": 5e-324}, ValueError, r"t_end must lie in \[1e-300, 1e\+300\], got 5e-324"),
        ({"breaks": [np.inf]}, ValueError, "breaks must be real, finite numbers, got"),
        ({"breaks": ["soon"]}, TypeError, "breaks must be real, finite numbers, got"),
        ({"events": [1.0]}, TypeError, r"events must be functions event\(t, y\), got 1.0"),
        ({"events": 1.0}, TypeError, "events must"),
        ({"events": "zero"}, TypeError, r"events must be functions event\(t, y\), got 'zero'"),
        ({"save_every": 0}, ValueError, "save_every must be a positive integer, got 0"),
        ({"t_eval": [2.0]}, ValueError, "t_eval must be increasing times"),
    ],
)
def test_wrong_arguments(change, kind, match):
    call = {"t_end": 1.0, "scheme": hd.Collocation()} | change
    with pytest.raises(kind, match=match):
        hd.solve(hd.scenes.relaxation(), **call)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("rtol", 1e-6),
        ("atol", 1e-8),
        ("max_step", 0.1),
        ("max_steps", 10),
    ],
)
def test_what_only_collocation_takes(name, value):
    required = rf"{name} must be left out or come with scheme=Collocation\(\), got"
    with pytest.raises(ValueError, match=required):
        hd.solve(hd.scenes.relaxation(), 1.0, 10, scheme=hd.BDF(2), **{name: value})


def test_times_whose_power_is_no_number():
    equation = hd.Equation(hd.Caputo(1.5), squared, [0.0, 0.0])
    with pytest.raises(ValueError, match=r"t_end must lie in \[1e-300, 1e\+200\], got 1e\+250"):
        hd.solve(equation, 1e250, rtol=1e-6)


@pytest.mark.parametrize("nodes", [1, 13, 0, -2, 2.5, True, "six"])
def test_numbers_of_nodes(nodes):
    with pytest.raises((ValueError, TypeError), match=r"nodes must .*, got"):
        hd.Collocation(nodes=nodes)


@pytest.mark.parametrize("horizon", [0.0, -1.0, np.inf, "far"])
def test_horizons(horizon):
    with pytest.raises((ValueError, TypeError), match=r"horizon must .*, got"):
        hd.Collocation(horizon=horizon)


@pytest.mark.parametrize("nodes", [2, 3, 5, 12])
def test_any_number_of_nodes_keeps_the_tolerance(nodes):
    sol = hd.solve(hd.scenes.relaxation(0.5), 5.0, rtol=1e-6, scheme=hd.Collocation(nodes=nodes))
    assert error(sol, half_order_relaxation, 1e-6) <= 10


def test_the_terms_of_the_highest_order_must_not_cancel():
    terms = [hd.Caputo(0.5), -hd.Caputo(0.5), hd.Caputo(0.3)]
    with pytest.raises(ValueError, match="terms must leave a nonzero coefficient"):
        hd.solve(hd.Equation(terms, squared, 1.0), 1.0, rtol=1e-6)
