"""Slopes, errors and verdicts of a record of growth."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hereditary.analysis.growth import Verdict, assess, kaplan_yorke

TIMES = np.linspace(1.0, 400.0, 400)


def judge(logs, memory="all", window=0.5, n_blocks=20):
    return assess(TIMES, np.atleast_2d(logs).T, window, n_blocks, memory)


@given(rate=st.floats(-2, 2), offset=st.floats(-5, 5))
def test_an_exponential_has_its_rate_as_slope(rate, offset):
    found = judge(rate * TIMES + offset)
    assert found.slope[0] == pytest.approx(rate, abs=1e-12)
    assert found.slope_stderr[0] < 1e-12


@given(power=st.floats(0.1, 1.9), offset=st.floats(-5, 5))
def test_a_power_has_its_exponent_as_algebraic_slope(power, offset):
    found = judge(offset - power * np.log(TIMES))
    assert found.algebraic_slope[0] == pytest.approx(power, abs=1e-12)
    assert found.verdicts == (Verdict.ALGEBRAIC_DECAY,)


def test_a_window_with_one_time_is_undetermined():
    """Renormalisations that lie twice as far apart each time leave it to an interrupted run."""
    times = 2.0 ** np.arange(1, 6)
    found = assess(times, times[:, None], 0.4, 20, "all")
    assert found.slope[0] == pytest.approx(1.0)
    assert np.isnan(found.algebraic_slope[0])
    assert found.verdicts == (Verdict.UNDETERMINED,)


def noise(seed, correlation=0.0):
    """Increments of unit variance, each depending on the one before."""
    fresh = np.random.default_rng(seed).normal(size=TIMES.size)
    steps = np.empty_like(fresh)
    steps[0] = fresh[0]
    for i in range(1, fresh.size):
        steps[i] = correlation * steps[i - 1] + np.sqrt(1 - correlation**2) * fresh[i]
    return np.cumsum(steps)


@pytest.mark.parametrize("correlation", [0.0, 0.5, 0.9])
def test_standard_error_covers_the_true_rate(correlation):
    """Within three of them in at least 95 of 100 records, and not by being too large."""
    rate = 0.3
    found = [judge(rate * TIMES + noise(seed, correlation)) for seed in range(100)]
    distances = np.array([abs(f.slope[0] - rate) / f.slope_stderr[0] for f in found])
    assert np.mean(distances < 3) >= 0.95
    assert np.median(distances) > 0.3


@pytest.mark.parametrize(
    ("logs", "memory", "verdict"),
    [
        (0.5 * TIMES + noise(1), "all", "exponential growth"),
        (-0.5 * TIMES + noise(1), "all", "algebraic decay"),
        (-0.5 * TIMES + noise(1), "none", "exponential decay"),
        (-0.5 * TIMES + noise(1), "some", "undetermined"),
        (-0.8 * np.log(TIMES), "some", "algebraic decay"),
        (np.sin(TIMES), "none", "neutral"),
        (0.8 * np.log(TIMES), "all", "undetermined"),  # a power, not an exponential
        (5 * noise(3), "none", "undetermined"),
        (np.where(TIMES < 390, 0.1 * TIMES, np.nan), "all", "undetermined"),
    ],
)
def test_verdicts(logs, memory, verdict):
    assert judge(logs, memory).verdicts[0] == verdict


def test_a_record_of_a_few_points_is_undetermined():
    found = assess(TIMES[:3], TIMES[:3, None] * [1.0, 2.0], 0.5, 20, "all")
    assert found.verdicts == (Verdict.UNDETERMINED,) * 2
    assert np.isnan(found.slope).all()


def test_the_window_leaves_the_start_out():
    """Transient growth in the first half of the record does not count."""
    logs = np.where(TIMES < 150, TIMES, 150.0) - 0.8 * np.log(TIMES)
    assert judge(logs).verdicts[0] == Verdict.ALGEBRAIC_DECAY
    assert judge(logs, window=1.0).verdicts[0] != Verdict.ALGEBRAIC_DECAY


@pytest.mark.parametrize(
    ("exponents", "dimension"),
    [
        ([0.9056, 0.0, -14.5723], 2 + 0.9056 / 14.5723),
        ([-14.5723, 0.9056, 0.0], 2 + 0.9056 / 14.5723),
        ([-0.1, -0.2], 0.0),
        ([0.3, -0.1], 2.0),
        ([0.0, -1.0], 1.0),
    ],
)
def test_kaplan_yorke(exponents, dimension):
    assert kaplan_yorke(np.array(exponents)) == pytest.approx(dimension, rel=1e-14)
