"""Sections: exact on what parabolas and dense outputs represent, of fixed size when asked."""

import numpy as np
import pytest

import hereditary as hd
from hereditary import maxima, stroboscopic


@pytest.fixture(scope="module")
def parabola():
    """x = 1 + 3 t - t**2 / 2, whose rows every parabola meets."""
    return hd.solve(hd.Equation(hd.Caputo(2.0), lambda t, x: -1.0, [1.0, 3.0]), 8.0, 80,
                    scheme=hd.L1(), estimate=False, save_every=7)  # fmt: skip


@pytest.fixture(scope="module")
def swing():
    """x = sin t, on a dense output."""
    return hd.solve(hd.Equation(hd.Caputo(2.0), lambda t, x: -x, [0.0, 1.0]), 40.0, rtol=1e-11)


def test_parabolas_through_rows_are_exact_for_parabolas(parabola):
    a, b, c = np.polynomial.polynomial.polyfit(parabola.t, parabola.y[:, 0], 2)
    found = stroboscopic(parabola, 0.37)
    np.testing.assert_allclose(found.y[:, 0], a + b * found.t + c * found.t**2, atol=1e-12)
    times, values = maxima(parabola)
    assert times[0] == pytest.approx(-b / (2 * c), abs=1e-11)
    assert values[0] == pytest.approx(a - b**2 / (4 * c), abs=1e-11)


def test_stroboscopic_samples_of_a_periodic_orbit_coincide(swing):
    section = stroboscopic(swing, np.pi / 2, transient=1.0)
    assert section.t == pytest.approx(np.pi / 2 * np.arange(1, 26))
    np.testing.assert_allclose(section.y[:, 0], np.sin(section.t), atol=1e-9)
    np.testing.assert_allclose(section.ydot[:, 0], np.cos(section.t), atol=1e-9)


def test_sections_of_a_fixed_size(swing):
    last = stroboscopic(swing, 2 * np.pi, count=3)
    assert last.t == pytest.approx(2 * np.pi * np.array([4, 5, 6]))
    padded = stroboscopic(swing, 2 * np.pi, transient=30.0, count=4)
    assert padded.y.shape == padded.ydot.shape == (4, 1)
    assert np.isfinite(padded.t).sum() == np.isfinite(padded.y).sum() == 2
    times, values = maxima(swing, count=9)
    assert np.isfinite(times).sum() == np.isfinite(values).sum() == 7
    assert maxima(swing, count=2)[0] == pytest.approx(np.pi * np.array([10.5, 12.5]))
    assert stroboscopic(swing, 50.0, transient=1.0).t.size == 0


def test_maxima_on_a_dense_output_are_located_beyond_its_steps(swing):
    for derivative, shift in ((0, 0.5), (1, 2.0)):
        times, values = maxima(swing, derivative=derivative, transient=2.0)
        assert times == pytest.approx(np.pi * (shift + 2 * np.arange(times.size)) + (1 - derivative)
                                      * 2 * np.pi, abs=1e-7)  # fmt: skip
        assert values == pytest.approx(np.ones(times.size), abs=1e-9)


def test_a_period_that_divides_the_run_gives_its_last_sample(parabola):
    for period in (0.1, 0.8, 8 / 3):
        assert stroboscopic(parabola, period).t[-1] == pytest.approx(8.0)


def test_places_in_a_cell_and_behind_a_pull(parabola):
    section = stroboscopic(parabola, 1.0)
    np.testing.assert_allclose(section.within(0.5), section.y % 0.5)
    np.testing.assert_allclose(section.lag(2.0)[:, 0], section.y[:, 0] - 2 * section.t)


def test_sections_without_a_derivative():
    decay = hd.solve(hd.Equation(hd.Caputo(0.5), lambda t, y: -y, 1.0), 1.0, 50)
    assert stroboscopic(decay, 0.1).ydot is None
