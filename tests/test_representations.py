"""What results show as text: their numbers, and how they ended."""

import re
from functools import cache

import numpy as np
import pytest

import hereditary as hd

decaying = cache(lambda: hd.Equation(hd.Caputo(0.5), lambda t, y, p: -p[0] * y, 1.0, params=[1.0]))
driven = cache(
    lambda: hd.Equation(hd.Caputo(0.5), lambda t, y, p: np.cos(p[0] * t) - y, 0.0, params=[1.0])
)
TIMES = np.array([0.5, 1.0, 2.0])
TIMES_OF_ROWS = np.linspace(0.0, 1.0, 11)


def halved(t):
    """A kernel, or a transform, of exponent one half."""
    return t**-0.5


def late(t, y, memory):
    return -memory[0]


def fitted():
    data = hd.solve(decaying().replace(params=[1.5]), 2.0, rtol=1e-8)(TIMES)[:, 0] + [
        1e-3,
        0.0,
        -1e-3,
    ]
    return hd.fit(lambda rate: decaying().replace(params=[rate]), TIMES, data, {"rate": 1.0})


RESULTS = {
    r"FitResult\(rate = 1\.49\d+ \+- 0\.00\d+; cost .*condition is satisfied\.\)": fitted,
    r"LyapunovResult\(-0\.\d+ \(late .*, algebraic decay\); mode 'tangent', the run .* end\)": (
        lambda: hd.lyapunov(decaying(), 20.0, 400)
    ),
    r"Ensemble\(2 of 2 completed; 11 rows of 1 components\)": (
        lambda: hd.ensemble(decaying(), 1.0, 10, params=[1.0, 2.0])
    ),
    r"Solution\(the run reached the end; 11 rows of 1 components, t = 0 \.\. 1\)": (
        lambda: hd.solve(decaying(), 1.0, 10)
    ),
    r"FrequencyResponse\(2 responses, omega = 0\.5 \.\. 2; 0 turning points; the curve was .*\)": (
        lambda: hd.frequency_response(driven(), [0.5, 2.0])
    ),
    r"Sensitivities\(by params, y0; the run reached the end; 11 rows of 1 components\)": (
        lambda: hd.sensitivities(decaying(), 1.0, t_eval=TIMES_OF_ROWS)
    ),
    r"PowerSpectrum\(peaks: 1, highest at 1\.[23]\d*; resolution 0\.\d+; \d+ frequencies\)": (
        lambda: hd.power_spectrum(np.sin(1.3 * np.arange(200.0)), 1.0, n_peaks=1)
    ),
    r"Kernel\(halved, singular_exponent=0\.5\)": lambda: hd.Kernel(halved),
    r"Kernel\(cos, singular_exponent=0, signed=True\)": lambda: hd.Kernel(np.cos, signed=True),
    r"LaplaceKernel\(halved, singular_exponent=0\.5\)": lambda: hd.kernel_from_laplace(halved),
    r"TabulatedKernel\(4 values, t = 1 \.\. 4, singular_exponent=0\)": (
        lambda: hd.Kernel.from_table([1.0, 2.0, 3.0, 4.0], [1.0, 1.0, 0.9, 0.1])
    ),
}


RESULTS |= {
    r"Equation\(1\.0 \* Caputo\(0\.5\) = rhs, d=1, memory=\[Delay\(2\.0\), .*Caputo\(0\.3\)\]\)": (
        lambda: hd.Equation(hd.Caputo(0.5), late, 1.0, memory=[hd.Delay(2.0), hd.Caputo(0.3)])
    ),
}


@pytest.mark.parametrize("shown", RESULTS)
def test_representations(shown):
    assert re.fullmatch(shown, repr(RESULTS[shown]()))


def test_an_ensemble_has_the_length_of_its_members():
    assert len(hd.ensemble(decaying(), 1.0, 10, params=[1.0, 2.0, 3.0])) == 3


@pytest.mark.parametrize(("alpha", "order"), [(0.5, 8.5), (1.0, 9.0), (1.5, 8.5)])
def test_the_order_of_collocation_is_that_of_its_nodes(alpha, order):
    assert hd.Collocation().order(alpha) == order


def test_the_transform_of_a_gamma_density():
    """Its integral with exp(-s t), by a sum over its values."""
    density, s, h = hd.GammaDensity(2.5, 1.0), 0.7, 1e-3
    t = h * (np.arange(40_000) + 0.5)
    assert density.laplace(s) == pytest.approx(h * np.sum(density(t) * np.exp(-s * t)), rel=1e-6)
