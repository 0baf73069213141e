"""`hd.derivative` has the order that it states, and is exact for functions."""

import numpy as np
import pytest
from problems import observed_order
from scipy.integrate import quad
from scipy.special import gamma, rgamma

import hereditary as hd
from hereditary import exact


def power(t, k, alpha):
    return gamma(k + 1) / gamma(k + 1 - alpha) * t ** (k - alpha)


def smooth(t):
    return t**4 + t**2


def of_smooth(t, alpha):
    return power(t, 4, alpha) + power(t, 2, alpha)


@pytest.mark.parametrize("stretched", [1.0, 1.5])
@pytest.mark.parametrize("alpha", [0.3, 0.8, 1.0, 1.4, 1.9])
@pytest.mark.parametrize("scheme", [hd.L1(), hd.L12(), hd.L2()], ids=str)
def test_orders_for_smooth_data(scheme, alpha, stretched):
    def error(n):
        t = np.linspace(0.0, 1.0, n + 1) ** stretched
        found = hd.derivative(t, smooth(t), hd.Caputo(alpha), scheme)
        return np.abs(found - of_smooth(t, alpha))[n // 4 :].max()

    if scheme == hd.L12() and stretched > 1:
        with pytest.raises(ValueError, match="mesh"):
            error(20)
        return
    order = scheme.order(alpha) if alpha <= 1 else 3 - alpha
    errors = [error(320), error(640)]
    assert observed_order((320, 640), errors) == pytest.approx(order, abs=0.15)
    assert errors[1] < 0.06 * 320 ** (1 - order)


@pytest.mark.parametrize("a", [0.2, 0.5, 0.9])
@pytest.mark.parametrize("k", [0, 1, 2, 3])
def test_a_negative_order_names_the_integral_of_powers(a, k):
    with pytest.raises(ValueError, match=r"order must lie in .*Memory\(PowerLaw\(1 - a\) / scipy"):
        hd.Caputo(-a)
    integral, t = hd.Memory(hd.PowerLaw(1 - a) / gamma(a), 0), np.linspace(0.0, 2.0, 401)
    known = power(t, k, -a)
    assert np.abs(hd.derivative(t, lambda s: s**k, integral) - known).max() < 1e-11 * known.max()
    errors = np.abs(hd.derivative(t, t**k, integral) - known)
    assert errors.max() < (1e-12 if k < 2 else 2e-5) * known.max()


@pytest.mark.parametrize("m", [0, 1, 2])
@pytest.mark.parametrize("stretched", [1.0, 1.3])
def test_kernels_act_on_data_and_functions(m, stretched):
    kernel = hd.Prony([1.0, 3.0], [0.5, 2.0])
    slopes = [np.cos, lambda s: -np.sin(s), lambda s: -np.cos(s)]
    known = quad(lambda s: float(kernel(2.0 - s)) * slopes[m](s), 0, 2, epsabs=1e-13)[0]
    assert abs(hd.derivative([2.0], np.cos, hd.Memory(kernel, m))[0] - known) < 1e-11

    def error(n):
        t = 2 * np.linspace(0.0, 1.0, n + 1) ** stretched
        return abs(hd.derivative(t, np.cos(t), hd.Memory(kernel, m))[-1] - known)

    assert observed_order((100, 200), [error(100), error(200)]) == pytest.approx(2.0, abs=0.15)


@pytest.mark.parametrize("alpha", [0.05, 0.5, 0.99, 1.0, 1.5, 2.0])
def test_smooth_functions_to_rounding(alpha):
    t = np.array([0.0, 1e-3, 0.4, 2.0, 1.1])
    known = of_smooth(t, alpha)
    tolerance = (1e-11 if alpha <= 1 else 1e-10) * known.max()
    assert np.abs(hd.derivative(t, smooth, hd.Caputo(alpha)) - known).max() < tolerance
    late = hd.derivative(t + 3.0, lambda s: smooth(s - 3.0), hd.Caputo(alpha), t_start=3.0)
    assert np.abs(late - known).max() < tolerance


@pytest.mark.parametrize("rate", [2.0, -3.0])
@pytest.mark.parametrize("alpha", [1.5, 2.3, 2.98, 3.0, 3.5, 3.9])
def test_high_orders_of_functions(alpha, rate):
    """By the power series of the exponential; and a square has none above order 2."""
    t, k = np.linspace(0.1, 1.0, 10), np.arange(np.ceil(alpha), 60)
    known = (rate**k * np.power.outer(t, k - alpha) * rgamma(k + 1 - alpha)).sum(axis=1)
    size = max(np.abs(known).max(), np.exp(rate))
    found = hd.derivative(t, lambda s: np.exp(rate * s), hd.Caputo(alpha))
    assert np.abs(found - known).max() < (1e-10 if alpha <= 3 else 1e-9) * size
    if alpha > 2:
        assert np.abs(hd.derivative(t, lambda s: s**2, hd.Caputo(alpha))).max() < 1e-10


@pytest.mark.parametrize("alpha", [0.1, 0.5, 0.9])
def test_functions_that_start_like_t_to_the_order(alpha):
    known = exact.relaxation(alpha, 1.3)
    t = np.linspace(0.01, 5.0, 20)
    assert np.abs(hd.derivative(t, known, hd.Caputo(alpha)) + 1.3 * known(t)).max() < 1e-11


def test_riemann_and_liouvilles_of_a_constant():
    t = np.linspace(0.0, 1.0, 5)
    for y in (np.ones(5), np.ones_like):
        found = hd.derivative(t, y, hd.RiemannLiouville(0.5))
        assert found[0] == np.inf
        np.testing.assert_allclose(found[1:], (np.pi * t[1:]) ** -0.5, rtol=1e-13)


def test_terms_add_up_over_components():
    t = np.linspace(0.0, 1.0, 101)
    y = np.stack([t**2, t**3], axis=1)
    mixed = np.array([[0.0, 1.0], [2.0, 0.0]]) * hd.Caputo(0.3)
    found = hd.derivative(t, y, 2 * hd.Caputo([0.5, 0.7]) + mixed)
    parts = [hd.derivative(t, y[:, k], hd.Caputo(a)) for k, a in enumerate((0.5, 0.7))]
    low = hd.derivative(t, y, hd.Caputo(0.3))
    expected = 2 * np.stack(parts, axis=1) + low[:, ::-1] * [1.0, 2.0]
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("scheme", [hd.L1(), hd.L12(), hd.L2()], ids=str)
def test_values_are_those_of_a_memory_term(scheme):
    y = np.random.default_rng(0).normal(size=40)
    term = hd.memory_term(0.6, 0.1, scheme, y[0], history=hd.Direct())
    for value, own in zip(
        y[1:], hd.derivative(0.1 * np.arange(40), y, hd.Caputo(0.6), scheme)[1:], strict=True
    ):
        assert own == pytest.approx(float(term.weight * value + term.lag), abs=1e-12)
        term.absorb(value)


@pytest.mark.parametrize("alpha", [0.2, 0.5, 0.9])
def test_noise_grows_as_steps_get_shorter(alpha):
    def factor(n, scheme):
        t = np.linspace(0.0, 1.0, n + 1)
        of_units = hd.derivative(t, np.eye(n + 1), hd.Caputo(alpha), scheme)[-1]
        return np.linalg.norm(of_units)

    assert np.log2(factor(200, None) / factor(100, None)) == pytest.approx(alpha, abs=0.03)
    assert 1.0 < factor(200, None) * 200**-alpha < 1.5
    assert 1.0 < factor(200, hd.L12()) * 200**-alpha < 2.4


TABLE = hd.TabulatedKernel([0.1, 0.2, 0.3, 0.4], [1.0, 0.8, 0.7, 0.65])


def corner(t):
    return np.abs(t - 0.3)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"y": corner}, "y must be smooth"),
        ({"t": [0.0, 1.0, 0.5]}, "t must .* increase"),
        ({"y": np.ones(4)}, "y must have shape"),
        ({"scheme": hd.BDF(2)}, "scheme must be L1, L12 or L2"),
        ({"operator": hd.Caputo(lambda t: 0.5)}, "operator must have constant orders"),
        ({"operator": hd.Caputo([0.5, 0.6, 0.7])}, "one for each of 1 components"),
        ({"y": np.sin, "t_start": 2.0}, "t must not lie before t_start"),
        ({"operator": hd.Memory(hd.Prony([1.0], [1.0]), 1), "scheme": hd.L12()}, "terms must be"),
        ({"operator": hd.Memory(TABLE, 1)}, "t must stay within 0.4"),
    ],
)
def test_refusals(change, words):
    given = {"t": [0.0, 0.5, 1.0], "y": [0.0, 1.0, 2.0], "operator": hd.Caputo(0.5)} | change
    with pytest.raises(ValueError, match=words):
        hd.derivative(**given)
