"""Figures: what they hold, not how they look."""

import matplotlib.pyplot as plt
import numpy as np
import pytest

import hereditary as hd


@pytest.fixture(autouse=True)
def close_figures():
    yield
    plt.close("all")


@pytest.fixture(scope="module")
def oscillation():
    return hd.solve(hd.scenes.stick_slip(), 2.0, 200)


@pytest.fixture(scope="module")
def relaxation():
    return hd.solve(hd.Equation(hd.Caputo(0.5), lambda t, y: -y, [1.0, 2.0]), 1.0, 50)


def test_oscillogram_and_velocity(oscillation):
    for draw, values in (
        (hd.plots.oscillogram, oscillation.y),
        (hd.plots.velocity, oscillation.ydot),
    ):
        ax = draw(oscillation)
        assert np.array_equal(ax.lines[0].get_xdata(), oscillation.t)
        assert np.array_equal(ax.lines[0].get_ydata(), values[:, 0])
        assert ax.get_xlabel() == "$t$"


def test_phase_portrait(oscillation, relaxation):
    ax = hd.plots.phase_portrait(oscillation)
    assert np.array_equal(ax.lines[0].get_xdata(), oscillation.y[:, 0])
    assert np.array_equal(ax.lines[0].get_ydata(), oscillation.ydot[:, 0])
    plane = hd.plots.phase_portrait(relaxation)
    assert np.array_equal(plane.lines[0].get_ydata(), relaxation.y[:, 1])


def test_given_axes_are_used(oscillation):
    _, ax = plt.subplots()
    assert hd.plots.oscillogram(oscillation, ax) is ax
    assert hd.plots.phase_portrait(oscillation, ax=ax) is ax


def test_components_get_a_legend(relaxation):
    ax = hd.plots.oscillogram(relaxation)
    assert [text.get_text() for text in ax.get_legend().get_texts()] == [
        "component 0",
        "component 1",
    ]


def test_no_velocity_without_a_derivative(relaxation):
    with pytest.raises(ValueError, match="solution must hold a first derivative"):
        hd.plots.velocity(relaxation)
