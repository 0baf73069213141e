"""Sections, the 0-1 test and power spectra of series and orbits whose nature is known."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import hereditary as hd
from hereditary import maxima, stroboscopic


def logistic(r, n=1500, x=0.3):
    found = []
    for _ in range(500 + n):
        x = r * x * (1 - x)
        found.append(x)
    return np.array(found[500:])


def driven(t, x):
    return 0.5 * np.cos(1.2 * t) - x


@pytest.mark.parametrize("r", [3.9, 3.97, 4.0])
def test_chaos_of_the_logistic_map(r):
    found = hd.zero_one_test(logistic(r))
    assert found.verdict == "chaotic"
    assert found.k > 0.95
    assert found.rates.shape == found.frequencies.shape == (100,)


@pytest.mark.parametrize("r", [2.8, 3.2, 3.5, 3.83])
def test_cycles_of_the_logistic_map(r):
    found = hd.zero_one_test(logistic(r))
    assert found.verdict == "regular"
    assert abs(found.k) < 0.1


@settings(max_examples=20)
@given(st.floats(1e-3, 1e3), st.floats(-1e3, 1e3), st.sampled_from([3.5, 4.0]))
def test_scale_and_origin_do_not_matter(scale, origin, r):
    plain = hd.zero_one_test(logistic(r, 400), n_c=20)
    moved = hd.zero_one_test(scale * logistic(r, 400) + origin, n_c=20)
    assert moved.k == pytest.approx(plain.k, abs=1e-4)


def test_orbits_and_what_exponents_say_of_them():
    lorenz = hd.solve(hd.scenes.lorenz(), 400.0, rtol=1e-6)
    assert hd.zero_one_test(lorenz, component=2, transient=20.0).verdict == "chaotic"
    assert hd.lyapunov(hd.scenes.lorenz(), 100.0, 20_000).verdict == "exponential growth"
    terms = hd.Caputo(1.8) + 0.3 * hd.Caputo(0.8)
    swing = hd.Equation(terms, driven, [0.0, 0.0])
    orbit = hd.solve(swing, 1500.0, rtol=1e-6)
    assert hd.zero_one_test(orbit, transient=300.0).verdict == "regular"
    assert hd.lyapunov(swing, 200.0, 10_000).exponents[0] < 0


def test_oversampled_series_are_tested_by_their_extrema():
    lorenz = hd.solve(hd.scenes.lorenz(), 400.0, rtol=1e-6)
    x = lorenz(np.arange(20.0, 400.0, 0.02))[:, 2]
    assert hd.zero_one_test(x[:4000]).verdict != "chaotic"
    for take in ("maxima", "extrema"):
        by_series = hd.zero_one_test(x, take=take)
        by_orbit = hd.zero_one_test(lorenz, component=2, transient=20.0, take=take)
        assert by_series.verdict == by_orbit.verdict == "chaotic"
        assert by_series.n == by_orbit.n
    swing = np.sin(0.1 * np.arange(30_000)) + 0.5 * np.sin(0.2 * np.arange(30_000))
    both, tops = (hd.zero_one_test(swing, take=take) for take in ("extrema", "maxima"))
    assert both.verdict == tops.verdict == "regular"
    assert abs(both.n - 2 * tops.n) <= 1


@pytest.mark.parametrize("take", ["maxima", "extrema"])
def test_digitised_series_have_plateaus(take):
    """Shoulders of a staircase are no extrema: a series of whole numbers stays regular."""
    t = np.arange(0, 4000, 0.02 * 1.0173)
    swing = np.sin(t) + 0.5 * np.sin(np.sqrt(2) * t)
    whole, rounded = (hd.zero_one_test(x, take=take) for x in (swing, np.round(1000 * swing)))
    assert rounded.verdict == "regular"
    assert abs(rounded.n - whole.n) <= 2
    assert rounded.k == pytest.approx(whole.k, abs=0.05)


def test_a_constant_series_is_regular():
    assert hd.zero_one_test(np.full(300, 2.5)).k == 0.0
    noise = np.random.default_rng(0).normal(size=300)
    assert hd.zero_one_test(1 + 1e-15 * noise).k == 0.0


def test_a_large_start_does_not_count():
    start = hd.scenes.lorenz().replace(y0=[1.0, 1.0, 3e4])
    orbit = hd.solve(start, 250.0, rtol=1e-6)
    assert hd.zero_one_test(orbit, component=2, transient=20.0).verdict == "chaotic"


def test_spectra_of_runs_that_begin_before_0():
    equation = hd.Equation(hd.Caputo(1.0), lambda t, y: np.cos(2 * t), 0.0, t_start=-150.0)
    found = hd.power_spectrum(hd.solve(equation, 0.0, 30_000))
    assert found.peaks[0]["omega"] == pytest.approx(2.0, abs=1e-4)
    assert found.resolution == pytest.approx(4 * np.pi / 150, rel=1e-3)


@settings(max_examples=30)
@given(st.floats(0.5, 20.0), st.floats(1e-3, 1e3), st.floats(0.0, 6.0), st.floats(-5.0, 5.0))
def test_lines_are_found(omega, amplitude, phase, mean):
    t = 0.05 * np.arange(4096)
    found = hd.power_spectrum(mean + amplitude * np.cos(omega * t + phase), 0.05)
    peak = found.peaks[0]
    assert peak["omega"] == pytest.approx(omega, abs=1e-3 * found.resolution)
    assert peak["amplitude"] == pytest.approx(amplitude, rel=1e-3)
    # Parseval: the density's integral is the variance
    power = np.sum(found.power[1:-1]) + 0.5 * (found.power[0] + found.power[-1])
    variance = power * found.omega[1] / (2 * np.pi)
    assert variance == pytest.approx(amplitude**2 / 2, rel=0.05)


def test_the_steady_response_of_a_fractional_oscillator():
    """Amplitude and frequency are those of the transfer function."""
    terms = hd.Caputo(1.8) + 0.3 * hd.Caputo(0.8)
    orbit = hd.solve(hd.Equation(terms, driven, [0.0, 0.0]), 1500.0, rtol=1e-7)
    found = hd.power_spectrum(orbit, transient=300.0)
    s = 1.2j
    expected = 0.5 / abs(s**1.8 + 0.3 * s**0.8 + 1)
    assert found.peaks[0]["omega"] == pytest.approx(1.2, abs=1e-5)
    assert found.peaks[0]["amplitude"] == pytest.approx(expected, rel=1e-3)
    assert len(found.peaks) == 1 or found.peaks[1]["amplitude"] < 1e-3 * expected
    rows = hd.solve(hd.Equation(terms, driven, [0.0, 0.0]), 1500.0, 60_000)
    again = hd.power_spectrum(rows, transient=300.0)
    assert again.peaks[0]["amplitude"] == pytest.approx(expected, rel=0.02)


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
