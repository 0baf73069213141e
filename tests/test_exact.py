"""Exact solutions, against other ways to the same numbers in high precision."""

import subprocess
import sys

import mpmath
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from problems import half_order_oscillator
from scipy.linalg import expm
from strategies import amplitudes, orders

pytest.importorskip("pymittagleffler")


from hereditary import exact

T = np.concatenate([[0.0], np.logspace(-8, 2.5, 60)])


def talbot(orders, coefficients, y0, rate, forcing, t, farthest):
    """The solution at t by Talbot's contour around poles up to a distance, with 30 to 75 digits.

    Shares no contour, no pole and no arithmetic with the library.
    """
    n = max(60, int(3.75 * farthest * t))
    with mpmath.workdps(n // 2):
        radius, total = mpmath.mpf(2 * n) / (5 * mpmath.mpf(float(t))), mpmath.mpf(0)
        a, c = ([mpmath.mpf(float(v)) for v in values] for values in (orders, coefficients))
        for k in range(n):
            theta = mpmath.pi * k / n
            cot = mpmath.cot(theta) if k else mpmath.mpf(0)
            s = radius * (theta * mpmath.mpc(cot, 1) if k else mpmath.mpc(1))
            weight = mpmath.mpc(1, theta + (theta * cot - 1) * cot) if k else mpmath.mpf(0.5)
            powers = [c_j * s**a_j for c_j, a_j in zip(c, a, strict=True)]
            above = y0[0] * sum(powers)
            if len(y0) == 2:
                above += y0[1] / s * sum(p for p, a_j in zip(powers, a, strict=True) if a_j > 1)
            above += sum(f * mpmath.gamma(p + 1) * s ** -mpmath.mpf(p) for f, p in forcing)
            value = above / (s * (sum(powers) + mpmath.mpf(float(rate))))
            total += (mpmath.exp(s * mpmath.mpf(float(t))) * value * weight).real
        return float(total * radius / n)


def residue_and_cut(beta, gamma, friction, stiffness, t):
    """x(0) = x'(0) = 1 at a late time t: a pair of poles plus an integral along the cut."""
    with mpmath.workdps(20):
        b, g, c, k, t = (mpmath.mpf(v) for v in (beta, gamma, friction, stiffness, t))

        def above(s):
            return s ** (b - 1) + c * s ** (g - 1) + s ** (b - 2)

        def below(s):
            return s**b + c * s**g + k

        pole = mpmath.findroot(below, 1j * k ** (1 / b))
        residue = above(pole) / (b * pole ** (b - 1) + c * g * pole ** (g - 1))

        def density(x):
            s = mpmath.mpc(-mpmath.exp(x), 0)
            return (above(s) / below(s) * s).imag * mpmath.exp(s.real * t)

        ends = [-mpmath.log(t) + v for v in (-50 / g, -30 / g, -15 / g, -5 / g, -2, 0, 2, 4.5)]
        cut = mpmath.quad(density, ends) / mpmath.pi
        return float(2 * (residue * mpmath.exp(pole * t)).real + cut)


def poles(solution):
    return solution.__closure__[0].cell_contents.poles


CASES = [
    # orders, coefficients, y0, rate, forcing
    ([1.8, 0.8], [1.0, 0.25], [1.0, 0.5], 1.0, ()),
    ([1.8, 0.8], [1.0, 0.25], [0.2, 0.3], 1e6, ()),
    ([1.9, 0.99], [1.0, 0.5], [1.0, -1.0], 1e6, [(2.0, 0.0)]),
    ([1.01, 0.5], [1.0, 0.3], [1.0, 0.5], 1.0, ()),
    ([1.05, 0.95], [1.0, -0.2], [1.0, 0.5], 1.0, ()),
    ([1.999, 0.01], [1.0, 0.1], [1.0, 0.5], 900.0, ()),
    ([1.5, 0.01], [1.0, 1.0], [1.0, 0.5], 1.0, [(1.0, 1.0)]),
    ([1.2, 0.3], [1.0, 10.0], [1.0, 0.5], 0.01, ()),
    ([1.7, 0.6], [1.0, 1e3], [1.0, 0.5], 1.0, [(-1.0, 0.5), (0.3, -0.4)]),
    ([2.0, 0.5], [1.0, 0.3], [1.0, 0.5], 1.0, [(1.0, 3.0)]),
    ([0.9, 0.3], [1.0, 1.0], [2.0], 1e6, ()),
    ([0.7, 0.31, 0.05], [1.0, 2.0, 0.5], [2.0], 0.0, [(1.0, 0.0)]),
    ([1.0, 0.5], [1.0, 2.0], [1.0], 1.0, [(1.0, 0.0)]),
    ([1.46, 1.95], [0.05, 600.0], [1.4, 1.8], 0.0, [(1.6, 0.0), (0.7, 2.0)]),
    ([1.9, 1.2], [1.0, 0.3], [0.0, 1.0], 1e-3, [(1.0, 4.0)]),
    ([1.57, 1.75, 0.05], [0.2, 0.07, 0.0016], [-3e-4, -0.1], 0.0, ()),
    ([1.8, 1.3, 0.4], [1.0, 0.2, 0.7], [1.0, 1.0], 3.0, [(1.0, 2.0)]),
    # growing ones
    ([1.8, 0.8], [1.0, -0.25], [1.0, 0.5], 1.0, ()),
    ([1.6, 0.7], [1.0, 0.3], [1.0, 0.5], -2.0, ()),
    ([0.8, 0.4], [1.0, 0.3], [1.0], -2.0, [(1.0, 0.0)]),
    # a growing pole with the weight 0
    ([1.8, 1.1], [200.0, -25.0], [-0.15, 1.2], 0.0, ()),
    ([1.4, 0.7], [-2.8, 0.1], [-0.5, 0.6], -3e-4, ()),
    ([1.8, 1.3, 0.4], [1.0, -2.0, 0.3], [1.0, 0.0], 1e-9, ()),
]


@pytest.mark.parametrize(("orders", "coefficients", "y0", "rate", "forcing"), CASES)
def test_against_talbot(orders, coefficients, y0, rate, forcing):
    solution = exact.several_terms(orders, coefficients, y0, rate=rate, forcing=forcing)
    fastest = np.abs(poles(solution)).max(initial=1e-3)
    reached = fastest if poles(solution).size else 0.0
    for t in (1e-8, 0.02 / fastest, 0.9 / fastest, 5.0 / fastest, 40.0 / fastest, 1e4):
        if t * fastest <= 60 or not poles(solution).size:
            expected = talbot(orders, coefficients, y0, rate, forcing, t, reached)
            scale = max(abs(expected), abs(y0[0]))
            assert abs(solution(t)[0] - expected) < 2e-13 * scale


@pytest.mark.parametrize(
    ("beta", "gamma", "friction", "stiffness", "t"),
    [
        (1.9999, 0.5, 1e-3, 1.0, 1e4),
        (1.99999, 0.9, 1e-5, 100.0, 1e3),
        (1.9, 0.5, 0.3, 1.0, 100.0),
        (1.8, 0.8, 0.25, 1.0, 1e4),
        (1.3, 0.3, 0.5, 1.0, 1e4),
    ],
)
def test_late_times(beta, gamma, friction, stiffness, t):
    expected = residue_and_cut(beta, gamma, friction, stiffness, t)
    solution = exact.oscillator(beta, gamma, friction, np.sqrt(stiffness), 1.0, 1.0)
    # the phase is known to rounding only
    phase = 1e-15 * np.abs(poles(solution)).max() * t
    assert abs(solution(t)[0] - expected) < 1e-11 * abs(expected) + phase
    if poles(solution)[0].real * t < -60:
        # nothing but the algebraic tail is left
        assert solution(t)[0] == pytest.approx(expected, rel=1e-11)


@pytest.mark.parametrize("friction", [0.0, 1e-4, 0.2, 1.9, 2.0, 2.1, 50.0, -0.1])
def test_classical_oscillator(friction):
    t = np.linspace(0.0, 100.0, 50)
    generator = np.array([[0.0, 1.0], [-1.0, -friction]])
    expected = np.array([(expm(generator * v) @ [1.0, 0.5])[0] for v in t])
    x = exact.oscillator(2.0, 1.0, friction, 1.0, 1.0, 0.5)(t)[:, 0]
    assert np.all(np.abs(x - expected) < 1e-12 * np.maximum(1.0, np.abs(expected)))
    if friction != 2.0:
        system = exact.system(1.0, generator, [1.0, 0.5])(t)[:, 0]
        assert np.all(np.abs(system - x) < 2e-12 * np.maximum(1.0, np.abs(expected)))


@pytest.mark.parametrize("scale", exact._SCALES)
def test_a_node_may_lie_on_a_pole(scale):
    """Then another scale is taken."""
    nodes = exact.ZETA[exact.ZETA.real < -0.01][:20]
    for node in nodes:
        pole, t = node / abs(node), scale * abs(node)
        x = exact.oscillator(2.0, 1.0, -2 * pole.real, 1.0, 0.0, 1.0)(t)[0]
        assert abs(x - np.exp(pole.real * t) * np.sin(pole.imag * t) / pole.imag) < 1e-13


def test_a_term_of_order_two_alone_and_a_free_fall():
    t = np.linspace(0.0, 30.0, 40)
    fall = exact.several_terms([2.0], [2.0], [1.0, -3.0], forcing=[(4.0, 0.0)])
    np.testing.assert_allclose(fall(t)[:, 0], 1 - 3 * t + t**2, rtol=1e-12, atol=1e-12)
    free = exact.several_terms([1.7, 1.2], [1.0, -4.0], [1.0, 2.0])
    np.testing.assert_allclose(free(t)[:, 0], 1 + 2 * t, rtol=1e-12)


def test_nearly_equal_poles():
    """Near 1e-2 digits are lost; below 1e-3 the problem is refused."""
    t = np.linspace(0.0, 10.0, 30)
    d = 0.01
    x = exact.several_terms([2.0, 1.0], [1.0, -2.0], [1.0, 1.0], rate=1 - d**2)(t)[:, 0]
    np.testing.assert_allclose(x, np.exp(t) * np.cosh(d * t), rtol=1e-11)


def test_blocks_and_order_of_times_do_not_matter():
    solution = exact.several_terms([1.8, 0.8], [1.0, 0.25], [1.0, 0.5], rate=1.0)
    t = np.linspace(0.0, 50.0, 3001)
    whole = solution(t)
    np.testing.assert_allclose(solution(t[::-1])[::-1], whole, rtol=0, atol=1e-15)
    np.testing.assert_allclose(solution(t[2000]), whole[2000], rtol=0, atol=1e-15)


@pytest.mark.parametrize("alpha", [0.05, 0.3, 0.5, 0.9, 0.999, 1.0, 1.001, 1.5, 1.9, 1.999, 2.0])
@pytest.mark.parametrize("rate", [1e-4, 1.0, 1e6, -2.0])
def test_relaxation_against_talbot(alpha, rate):
    y0 = [1.0, 0.5][: int(np.ceil(alpha))]
    relaxation, forced = exact.relaxation(alpha, rate, y0), [(0.7, 0.0)]
    one = exact.system(alpha, [[-rate]], np.reshape(y0, (-1, 1)), 0.7)
    time = abs(rate) ** (-1 / alpha)
    for t in (1e-8, 1e-3 * time, 0.7 * time, 40 * time, 1e4):
        if 1e-10 < t < 1e6 and (t <= 50 * time or (alpha <= 1 and rate > 0)):
            expected = talbot([alpha], [1.0], y0, rate, forced, t, min(1 / time, 40 / t))
            assert abs(one(t)[0] - expected) < 1e-12 * max(1.0, abs(expected))
            expected = exact.several_terms([alpha], [1.0], y0, rate=rate)(t)[0]
            assert abs(relaxation(t)[0] - expected) < 1e-12 * max(1.0, abs(expected))


@pytest.mark.parametrize("alpha", [0.4, 0.9, 1.0, 1.6, 2.0])
def test_system_of_a_rotation_solves_the_equation_of_its_square(alpha):
    """D^alpha (x, y) = (y, -x) is one complex relaxation with rate i: E_alpha(-i t**alpha)."""
    t = np.linspace(0.0, 8.0, 20)
    y0 = [[1.0, 0.0], [0.0, 0.0]][: int(np.ceil(alpha))]
    y = exact.system(alpha, [[0.0, 1.0], [-1.0, 0.0]], y0)(t)
    with mpmath.workdps(60):
        for v, (first, second) in zip(t, y, strict=True):
            z = mpmath.mpc(0, -1) * mpmath.mpf(v) ** mpmath.mpf(alpha)
            n = int(70 + 12 * v) * 3
            terms = [z**k * mpmath.rgamma(mpmath.mpf(alpha) * k + 1) for k in range(n)]
            w = complex(mpmath.fsum(terms))
            assert abs(complex(first, second) - w) < 1e-12 * max(1.0, abs(w))


def test_system_agrees_with_several_terms():
    """D^1.5 x + 0.5 D^0.5 x + x = 0 as three equations of order 1/2."""
    matrix = [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [-1.0, -0.5, 0.0]]
    y = exact.system(0.5, matrix, [1.0, 0.0, 0.0])(T)
    np.testing.assert_allclose(y[:, :1], half_order_oscillator(T), atol=2e-14)


def test_symmetric_matrices_may_have_equal_eigenvalues():
    generator = np.random.default_rng(1)
    basis = np.linalg.qr(generator.normal(size=(4, 4)))[0]
    matrix = basis @ np.diag([-1.0, -1.0, -1.0, -2.0]) @ basis.T
    matrix = (matrix + matrix.T) / 2
    y = exact.system(0.7, matrix, np.arange(4.0))(T)
    parts = np.hstack([exact.relaxation(0.7, r)(T) for r in (1.0, 1.0, 1.0, 2.0)])
    np.testing.assert_allclose(y, parts * (np.arange(4.0) @ basis) @ basis.T, atol=1e-13)


times = st.floats(-6, 3).map(lambda x: 10.0**x)


@settings(max_examples=25)
@given(orders(1.05, 1.95), orders(0.05, 0.95), amplitudes(), amplitudes(), times)
@example(1.8, 0.8, 1.0, -1.0, 30.0)
def test_linear_in_initial_values(beta, gamma, x0, v0, t):
    x, one, other = (
        exact.oscillator(beta, gamma, 0.25, 1.0, *start)(t)[0]
        for start in ((x0, v0), (1.0, 0.0), (0.0, 1.0))
    )
    assert abs(x - x0 * one - v0 * other) < 1e-12 * (1 + abs(x0) + abs(v0))
    both = exact.several_terms([beta, gamma], [1.0, 0.25], [[x0, 1.0], [v0, 0.0]], rate=1.0)(t)
    assert both == pytest.approx([x, one], rel=1e-13, abs=1e-12)


@settings(max_examples=25)
@given(orders(1.05, 1.95), orders(0.05, 0.95), st.floats(-2, 2), times)
@example(1.999, 0.001, 2.0, 10.0)
def test_scaling_of_time(beta, gamma, exponent, t):
    """x(t / unit) solves the equation whose coefficients carry the powers of the unit."""
    unit = 10.0**exponent
    x = exact.several_terms([beta, gamma], [1.0, 0.25], [1.0, 0.5], rate=1.0)(t)
    coefficients = [unit**beta, 0.25 * unit**gamma]
    scaled = exact.several_terms(
        coefficients=coefficients, orders=[beta, gamma], y0=[1.0, 0.5 / unit], rate=1.0
    )(unit * t)
    assert abs(x - scaled)[0] < 1e-12 * (1 + t)


@pytest.mark.parametrize(
    "solution",
    [
        exact.relaxation(0.3, 2.0, [1.0, 2.0]),
        exact.relaxation(1.3, 2.0, [[1.0, 2.0], [0.0, 1.0]]),
        exact.several_terms([1.2, 0.3], [1.0, 1.0], [[1.0, 2.0], [0.0, 1.0]], forcing=[(1.0, 0.0)]),
        exact.system(1.2, -np.eye(2), [[1.0, 2.0], [0.0, 1.0]], forcing=[1.0, 0.0]),
    ],
)
def test_shapes_and_initial_values(solution):
    assert solution(0).tolist() == solution(0.0).tolist() == [1.0, 2.0]
    assert solution([0.0, 1.0, 0.0])[[0, 2]].tolist() == [[1.0, 2.0], [1.0, 2.0]]
    assert solution([]).shape == (0, 2)
    assert solution([0.5, 1.0, 2.0]).shape == (3, 2)
    assert solution([0.5])[0].tolist() == pytest.approx(solution(0.5).tolist(), rel=1e-14)
    assert solution(1e-12).tolist() == pytest.approx([1.0, 2.0], rel=1e-3)


def test_growth_beyond_all_numbers_is_infinite():
    assert exact.relaxation(1.0, -1.0)(1e4).tolist() == [np.inf]
    assert exact.several_terms([0.5, 0.2], [1.0, 0.1], [1.0], rate=-1.0)(1e4).tolist() == [np.inf]


def test_zeros_and_repetitions_are_merged():
    plain = exact.several_terms([0.5], [2.0], 1.0, rate=1.0)(T)
    merged = exact.several_terms([0.5, 0.3, 0.5], [0.5, 0.0, 1.5], 1.0, rate=1.0, forcing=[(0, 1)])
    np.testing.assert_allclose(merged(T), plain, rtol=0, atol=0)


def test_a_missing_package_is_named():
    code = "import sys; sys.modules['pymittagleffler'] = None; import hereditary.exact"
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert result.returncode == 1
    assert "pip install hereditary[exact]" in result.stderr
