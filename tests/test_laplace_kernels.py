"""Kernels from Laplace transforms: closed forms, fits, Scarpi's derivative."""

import mpmath
import numpy as np
import pytest

import hereditary as hd

T = np.geomspace(1e-10, 1e6, 33)


def scarpi(s):
    return s ** ((0.9 * 2 + 0.6 * s) / (2 + s) - 1)


def havriliak_negami(a, c):
    return lambda s: (1 + s**a) ** -c


@pytest.mark.parametrize(
    "kernel",
    [
        hd.PowerLaw(0.3),
        hd.PowerLaw(0.97),
        hd.MittagLeffler(0.6, 2.0),
        hd.DistributedOrder([0.0, 0.5], [1.0, 2.0]),
        hd.TemperedPowerLaw(0.5, 3.0),
        hd.Prony([0.0, 2.0], [1.0, 3.0]),
    ],
    ids=repr,
)
def test_values_and_integrals(kernel):
    same = hd.kernel_from_laplace(kernel.laplace)
    assert same.singular_exponent == pytest.approx(kernel.singular_exponent, abs=1e-12)
    mean = kernel.integral(T) / T
    assert np.abs((same(T) - kernel(T)) / mean).max() < 3e-14
    assert np.abs(same.integral(T) / kernel.integral(T) - 1).max() < 3e-14
    assert same.integral(0.0) == 0.0


@pytest.mark.parametrize("t", [0.01, 1.0, 4.0])
def test_havriliak_and_negami(t):
    """The closed form is Prabhakar's function, here by its series."""
    a, c = mpmath.mpf("0.8"), mpmath.mpf("0.5")
    with mpmath.workdps(60):

        def term(k):
            rising = mpmath.rf(c, k) / mpmath.factorial(k)
            return rising * (-(mpmath.mpf(t) ** a)) ** k * mpmath.rgamma(a * k + a * c)

        known = t ** (a * c - 1) * mpmath.nsum(term, [0, mpmath.inf], method="d")
    kernel = hd.kernel_from_laplace(havriliak_negami(0.8, 0.5))
    assert float(kernel(t)) == pytest.approx(float(known), rel=1e-13)


@pytest.mark.parametrize("tol", [1e-4, 1e-8, 1e-11])
@pytest.mark.parametrize("kind", ["Havriliak-Negami", "Scarpi"])
def test_sums_of_exponentials_keep_their_tolerance(kind, tol):
    signed = kind == "Scarpi"
    transform = scarpi if signed else havriliak_negami(0.8, 0.5)
    kernel = hd.kernel_from_laplace(transform, signed=signed)
    fit = kernel.fit(1e-6, 1.0, tol)
    t = np.geomspace(1e-6, 1.0, 5001)
    assert np.abs(fit(t) / kernel(t) - 1).max() < 1.1 * tol
    assert fit.n_modes < 140
    assert signed or fit.weights.min() > 0


@pytest.mark.parametrize("rtol", [1e-4, 1e-8, 1e-10])
def test_relaxation_with_an_order_that_varies_by_scarpi(rtol):
    operator = hd.Memory(hd.kernel_from_laplace(scarpi, signed=True), 1)
    found = hd.solve(hd.Equation(operator, lambda t, y: -y, 1.0), 1.0, rtol=rtol)
    assert found.success
    assert found.y[-1, 0] == pytest.approx(0.4261864876354208, rel=rtol)


def test_long_after_the_change_of_order():
    """There complex rates are needed: real ones leave 8e-7 of the kernel."""
    kernel = hd.kernel_from_laplace(scarpi, signed=True)
    equation = hd.Equation(hd.Memory(kernel, 1), lambda t, y: -y, 1.0)
    found = hd.solve(equation, 100.0, rtol=1e-7)
    with mpmath.workdps(30):
        known = mpmath.invertlaplace(
            lambda s: scarpi(s) / (s * scarpi(s) + 1), 100, method="talbot", degree=60
        )
    assert found.success
    assert found.y[-1, 0] == pytest.approx(float(known), rel=1e-7)


def test_one_order_is_caputos_derivative():
    kernel = hd.kernel_from_laplace(lambda s: s**-0.3)
    runs = [
        hd.solve(hd.Equation(operator, lambda t, y: -y, 1.0), 5.0, rtol=1e-9)
        for operator in (hd.Memory(kernel, 1), hd.Caputo(0.7))
    ]
    assert runs[0].y[-1, 0] == pytest.approx(runs[1].y[-1, 0], rel=1e-9)


CANCELLING = {
    "logarithm": (
        lambda s: np.log((s + 10) / (s + 0.5)) / np.log(20),
        lambda t: np.exp(-10 * t) * np.expm1(9.5 * t) / (t * np.log(20)),
        0.0,
    ),
    "roots": (
        lambda s: np.sqrt(s + 1) - np.sqrt(s),
        lambda t: -np.expm1(-t) / (2 * np.sqrt(np.pi) * t**1.5),
        0.5,
    ),
    "signed": (
        lambda s: 1 / (s + 1) - 1 / (s + 2),
        lambda t: -np.exp(-t) * np.expm1(-t),
        0.0,
    ),
}


@pytest.mark.parametrize("scale", [1e-12, 1.0, 1e9])
@pytest.mark.parametrize("name", CANCELLING)
def test_transforms_that_cancel_at_infinity(name, scale):
    """Rounding of F decides at tiny times; values are right where a run needs them."""
    transform, known, exponent = CANCELLING[name]
    signed = name == "signed"
    kernel = hd.kernel_from_laplace(lambda s: transform(s / scale) / scale, signed=signed)
    assert kernel.singular_exponent == exponent
    t = np.geomspace(1e-3, 20.0, 40)
    error = np.abs(kernel(t / scale) - known(t))
    assert np.all(error < 1e-11 * np.maximum(known(t), 1e-3 * known(t).max()))
    early = np.geomspace(1e-30, 1e-7, 20)
    assert np.all(np.isfinite(kernel(early / scale)))
    if not signed:
        assert np.abs(kernel(1e-7 / scale) / known(1e-7) - 1) < 1e-5
        ratio = kernel.integral(1e-12 / scale) / kernel.integral(1e-14 / scale)
        assert ratio == pytest.approx(100 ** (1 - exponent), rel=1e-6)
