"""Power weights keep every digit, however long the run."""

import mpmath
import numpy as np
import pytest

from hereditary.special import (
    alternating_power_sum,
    bracketed_root,
    mean_exponential,
    power_differences,
    power_second_differences,
)

POWERS = [1e-6, 0.05, 0.2, 0.5, 0.8, 0.999]


def exact(p, k):
    with mpmath.workdps(50):
        p = mpmath.mpf(p)
        return [mpmath.mpf(j + 1) ** p - mpmath.mpf(j) ** p for j in (k - 1, k)]


@pytest.mark.parametrize("p", POWERS)
def test_differences_of_powers_keep_their_digits(p):
    n = 100_000
    b, c = power_differences(p, n), power_second_differences(p, n)
    assert b[0] == c[0] == 1
    for k in [1, 2, 5, 15, 16, 17, 18, 100, 1234, n - 1]:
        before, here = exact(p, k)
        assert b[k] == pytest.approx(float(here), rel=2e-15)
        assert c[k] == pytest.approx(float(here - before), rel=2e-14)


@pytest.mark.parametrize("p", POWERS)
def test_the_literal_formula_would_not_do(p):
    k = 99_999.0
    literal = (k + 1) ** p - 2 * k**p + (k - 1) ** p
    before, here = exact(p, 99_999)
    assert abs(literal / float(here - before) - 1) > 1e-9


def test_classical_terms_have_no_memory():
    assert power_differences(0.0, 5).tolist() == [1, 0, 0, 0, 0]
    assert power_second_differences(0.0, 40).tolist() == [1, -1] + 38 * [0]


@pytest.mark.parametrize("p", [0.0, *POWERS[1:]])
def test_alternating_sum(p):
    with mpmath.workdps(30):
        expected = 2 * mpmath.altzeta(-p)
    assert alternating_power_sum(p) == pytest.approx(float(expected), rel=1e-13)


def test_sums_of_weights_telescope():
    n, p = 5000, 0.37
    assert power_differences(p, n).sum() == pytest.approx(n**p, rel=1e-13)
    assert power_second_differences(p, n).sum() == pytest.approx(
        power_differences(p, n)[-1], rel=1e-12
    )


def test_mean_exponential():
    z = np.array([0.0, 1e-300, 1e-9, 0.3, 50.0, 1e6])
    with mpmath.workdps(40):
        expected = [1.0] + [float(-mpmath.expm1(-mpmath.mpf(v)) / mpmath.mpf(v)) for v in z[1:]]
    np.testing.assert_allclose(mean_exponential(z), expected, rtol=4e-16)


@pytest.mark.parametrize(
    ("function", "low", "high", "root"),
    [
        (lambda x: x - 1.0 / 3.0, 0.0, 1.0, 1.0 / 3.0),
        (lambda x: np.cos(x) - x, 0.0, 1.0, 0.7390851332151607),
        (lambda x: x**9, -1.0, 3.0, 0.0),  # flat: false position alone would creep
        (lambda x: np.expm1(50.0 * (x - 0.9)), 0.0, 1.0, 0.9),
        (lambda x: np.sign(x - 0.3), 0.0, 1.0, 0.3),  # a jump
        (lambda x: x, 0.0, 1.0, 0.0),
        (lambda x: x - 1.0, 0.0, 1.0, 1.0),
        (lambda x: 2.0 - x, 5.0, 1.0, 2.0),  # falling, given the other way round
    ],
)
def test_bracketed_root(function, low, high, root):
    calls = []

    def counted(x):
        calls.append(x)
        return function(x)

    found = bracketed_root(counted, low, high)
    assert found == pytest.approx(root, abs=1e-15)
    assert len(calls) < 250
