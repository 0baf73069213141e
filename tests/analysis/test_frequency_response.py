"""Steady responses: transfer functions, and marches that have settled."""

import itertools
from functools import cache, partial

import matplotlib
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad

import hereditary as hd

matplotlib.use("Agg")


def driven(t, x, p):
    return p[1] * np.cos(p[0] * t) - x - p[2] * x**3


def coupled(t, x, dx, p):
    dx[0] = np.cos(p[0] * t) - x[0] + 0.3 * (x[1] - x[0])
    dx[1] = 0.5 * np.sin(p[0] * t) - 2.0 * x[1] + 0.3 * (x[0] - x[1])


coupled_pair = cache(
    lambda: hd.Equation(hd.Caputo([1.7, 0.8]), coupled, np.zeros((2, 2)), params=[1.0])
)


def duffing(force=0.3, hardening=0.5, beta=1.95, gamma=0.9, friction=0.1, y0=(0.0, 0.0)):
    terms = hd.Caputo(beta) + friction * hd.Caputo(gamma)
    return hd.Equation(terms, driven, y0, params=[1.0, force, hardening])


def settled(equation, coefficients, omega):
    """Return the first coefficient of a march that begins at a response's own values."""
    k, period = np.arange(coefficients.size), 2 * np.pi / omega
    y0 = [np.sum(coefficients).real, np.sum(1j * omega * k * coefficients).real]
    times = np.linspace(200 * period, 204 * period, 257)
    march = equation.replace(params=[omega, *equation.params[1:]], y0=y0)
    y = hd.solve(march, times[-1], rtol=1e-8, t_eval=times).y[:-1, 0]
    return 2 * np.mean(y * np.exp(-1j * omega * times[:-1]))


@settings(max_examples=25)
@given(st.floats(1.05, 2.0), st.floats(0.05, 1.0), st.floats(0.05, 1.0))
def test_linear_responses_are_transfer_functions(beta, gamma, friction):
    equation = duffing(0.7, 0.0, beta, gamma, friction)
    omegas = np.linspace(0.2, 3.0, 12)
    found = hd.frequency_response(equation, omegas, harmonics=3)
    s = 1j * omegas
    expected = 0.7 / (s**beta + friction * s**gamma + 1)
    assert found.complete
    assert np.array_equal(found.omega, omegas)
    error = np.abs(found.coefficients[:, 0, 1] - expected)
    assert error.max() < 1e-12 * max(1.0, np.abs(expected).max())
    assert np.abs(found.coefficients[:, 0, [0, 2, 3]]).max() < 1e-11
    assert np.allclose(found.amplitude[:, 0], np.abs(expected), rtol=1e-10)
    assert np.allclose(found.phase[:, 0], np.angle(expected), atol=1e-9)


def test_values_that_the_force_reads_are_those_of_now():
    stiffness = 1.0
    force = lambda t, x, p: np.cos(p[0] * t) - stiffness * x  # noqa: E731
    equation = hd.Equation(hd.Caputo(1.8), force, [0.0, 0.0], params=[1.0])
    for stiffness in (1.0, 3.0):
        found = hd.frequency_response(equation, [1.0], harmonics=1)
        assert found.coefficients[0, 0, 1] == pytest.approx(1 / (1j**1.8 + stiffness), rel=1e-12)


MATRIX = np.array([[1.0, 0.2], [-0.3, 1.0]])
BEHIND_MATRIX = partial(hd.Equation, MATRIX * hd.Caputo(0.8), coupled, [0.0, 0.0], params=[1.0])


@pytest.mark.parametrize(
    ("made", "left"),
    [
        (coupled_pair, lambda s: np.diag([s**1.7, s**0.8])),
        (BEHIND_MATRIX, lambda s: MATRIX * s**0.8),
    ],
    ids=["different orders", "a matrix"],
)
def test_coupled_components(made, left):
    omegas = np.array([2.5, 1.2, 0.4])
    found = hd.frequency_response(made(), omegas, harmonics=2)
    for omega, coefficients in zip(omegas, found.coefficients, strict=True):
        matrix = left(1j * omega) + np.array([[1.3, -0.3], [-0.3, 2.3]])
        assert np.allclose(coefficients[:, 1], np.linalg.solve(matrix, [1.0, -0.5j]), atol=1e-12)


def test_marches_settle_on_both_branches():
    """Begun at a response's own values, in the range that has three of them."""
    equation = duffing()
    found = hd.frequency_response(equation, np.linspace(0.4, 2.4, 101), harmonics=9)
    assert found.complete
    assert found.turning.size == 2
    assert found.turning[1] < found.turning[0]
    chosen = [k for k in range(found.omega.size) if abs(found.omega[k] - 1.26) < 1e-9]
    assert found.branch[chosen].tolist() == [0, 1, 2]
    assert np.all(np.diff(found.amplitude[chosen, 0]) < 0)
    for k in (chosen[0], chosen[2]):
        found_by_march = abs(settled(equation, found.coefficients[k, 0], found.omega[k]))
        assert found_by_march == pytest.approx(found.amplitude[k, 0], rel=2e-4)


def test_the_curve_does_not_depend_on_its_direction():
    up = hd.frequency_response(duffing(), np.linspace(0.4, 2.4, 41))
    down = hd.frequency_response(duffing(), np.linspace(2.4, 0.4, 41))
    assert np.allclose(up.turning, down.turning[::-1], atol=2e-4)
    assert np.allclose(up.omega, down.omega[::-1])
    assert np.allclose(up.coefficients, down.coefficients[::-1], atol=1e-10)


@pytest.mark.parametrize("omegas", [np.linspace(100, 1000, 20), np.logspace(-4, 4, 30)], ids=str)
def test_every_frequency_has_its_row(omegas):
    """Also where responses are so small or so stiff that rounding ends Newton's method."""
    found = hd.frequency_response(duffing(hardening=0.0), omegas)
    assert found.complete
    assert np.array_equal(found.omega, omegas)
    soft = hd.Equation(
        hd.Caputo(1.8), lambda t, x, p: np.cos(p[0] * t) - 1e-4 * x, [0.0, 0.0], params=[1.0]
    )
    assert hd.frequency_response(soft, np.linspace(0.3, 3.0, 30)).omega.size == 30


def test_frequencies_next_to_turning_points_have_three_rows():
    omegas = [0.4, 1.25255, 1.25256, 1.274275, 2.4]  # folds are at 1.252546 and 1.274290
    found = hd.frequency_response(duffing(), omegas)
    assert found.complete
    for omega in omegas[1:4]:
        here = found.omega == omega
        assert found.branch[here].tolist() == [0, 1, 2]
        assert np.all(np.diff(found.amplitude[here, 0]) < 0)
    assert found.turning == pytest.approx([1.274290, 1.252546], abs=5e-6)


def test_a_narrow_peak_is_passed():
    equation = duffing(1.0, 0.0, 2.0, 1.0, 1e-4)
    found = hd.frequency_response(equation, np.linspace(0.3, 3.0, 28), harmonics=1)
    assert found.complete
    s = 1j * found.omega
    expected = 1 / (s**2 + 1e-4 * s + 1)
    assert np.allclose(found.coefficients[:, 0, 1], expected, rtol=1e-9)
    assert np.isnan(found.quality())  # one frequency at its top


def test_more_harmonics_change_little():
    few = hd.frequency_response(duffing(), np.linspace(0.6, 1.2, 7), harmonics=5)
    more = hd.frequency_response(duffing(), np.linspace(0.6, 1.2, 7), harmonics=11)
    assert np.abs(few.coefficients[..., :6] - more.coefficients[..., :6]).max() < 1e-5
    y = more.period(64)
    assert y.shape == (7, 1, 64)
    assert y[0, 0, 0] == pytest.approx(more.coefficients[0, 0].sum().real)


def test_the_quality_factor_of_a_classical_oscillator():
    """Of weak damping 2 zeta: 1 / (2 zeta), to second order in it."""
    equation = duffing(1.0, 0.0, 2.0, 1.0, 0.02)
    found = hd.frequency_response(equation, np.linspace(0.9, 1.1, 401), harmonics=1)
    assert found.quality() == pytest.approx(50.0, rel=0.01)
    narrow = hd.frequency_response(equation, np.linspace(0.999, 1.001, 11), harmonics=1)
    assert np.isnan(narrow.quality())


def test_figure():
    found = hd.frequency_response(duffing(), np.linspace(0.4, 2.4, 101))
    ax = hd.plots.frequency_response(found)
    assert [line.get_linestyle() for line in ax.lines[:3]] == ["-", "--", "-"]
    upper, lower = hd.plots.amplitude_and_phase(found)
    assert (upper.get_ylabel(), lower.get_ylabel()) == ("amplitude", "phase")
    first, second = (line.get_xydata() for line in lower.lines[:2])
    assert np.array_equal(first[-1], second[0])  # drawn through the fold
    assert max(first[:, 0].max(), second[:, 0].max()) == pytest.approx(found.turning[0], abs=2e-3)
    drawn = np.column_stack([found.values, found.phase[:, 0]])[found.branch == 1]
    distances = np.linalg.norm(drawn[:, None] - second, axis=2)
    assert np.max(np.min(distances, axis=1)) < 1e-12


def between(t, v, p):
    return np.array([np.cos(p[0] * t) - v[0] + v[1], v[0] - v[1]])


def test_a_free_mean_is_told_and_is_0():
    """A constant phase element, and two bodies that nothing holds; a mean force has no response."""
    omegas = np.geomspace(1e-3, 1e3, 20)
    element = hd.Equation(
        hd.Caputo(0.5), lambda t, v, p: p[1] + np.cos(p[0] * t), 0.0, params=[1.0, 0.0]
    )
    bodies = hd.Equation(hd.Caputo(1.5), between, np.zeros((2, 2)), params=[1.0])
    for equation, expected in (
        (element, lambda s: [s**-0.5]),
        (bodies, lambda s: np.array([s**1.5 + 1, 1.0]) / (s**3 + 2 * s**1.5)),
    ):
        with pytest.warns(UserWarning, match="mean of y is free"):
            found = hd.frequency_response(equation, omegas)
        assert found.complete
        assert np.array_equal(found.omega, omegas)
        exact = np.array([expected(1j * omega) for omega in omegas])
        np.testing.assert_allclose(found.coefficients[:, :, 1], exact, rtol=1e-6)
        size = np.abs(found.coefficients[:, :, 1])
        assert np.all(np.abs(found.coefficients[:, :, 0]) < 1e-9 * size.max(axis=1, keepdims=True))
    with pytest.warns(UserWarning, match="mean of y is free"):
        found = hd.frequency_response(element.replace(params=[1.0, 1.0]), omegas)
    assert not found.complete


def test_a_response_that_is_not_found_is_told():
    def none(t, x, p):
        return np.cos(p[0] * t) - x + 50.0 + 10.0 * x**2

    equation = hd.Equation(hd.Caputo(1.8) + 0.1 * hd.Caputo(0.8), none, [0.0, 0.0], params=[1.0])
    found = hd.frequency_response(equation, [1.0, 2.0])
    assert not found.complete
    assert "no response was found at the first value" in found.message
    assert found.omega.size == 0
    assert np.all(np.isnan(found.peak()))
    assert np.isnan(found.quality())


def test_a_curve_that_turns_back_keeps_its_responses():
    """Of the means 10 x**2 - x + p = 0, which meet at p = 0.025."""

    def two_means(t, x, p):
        return 1e-6 * np.cos(p[0] * t) + p[1] - x + 10.0 * x**2

    equation = hd.Equation(hd.Caputo(1.0), two_means, 0.0, params=[1.0, 0.0])
    found = hd.frequency_response(equation, [0.0, 0.01, 0.02, 0.03], along=1, harmonics=1)
    assert not found.complete
    assert "the curve turns back beyond the first value" in found.message
    assert found.values.tolist() == [0.0, 0.01, 0.02, 0.02, 0.01, 0.0]
    assert found.branch.tolist() == [0, 0, 0, 1, 1, 1]
    assert found.turning == pytest.approx([0.025], abs=1e-6)
    root = np.sqrt(1 - 40 * found.values) * (1 - 2 * found.branch)
    assert found.coefficients[:, 0, 0].real == pytest.approx((1 - root) / 20, abs=1e-9)


KERNELS = [
    hd.TemperedPowerLaw(0.4, 0.7),
    2.0 * hd.Prony([0.3, 5.0], [0.4, 0.6]),
    hd.MittagLeffler(0.6, 1.5),
    hd.DistributedOrder([0.2, 0.7], [0.5, 0.3]),
    hd.PowerLaw(0.3),
]


@settings(max_examples=40)
@given(st.sampled_from(KERNELS), st.floats(0.05, 3.0), st.floats(-5.0, 5.0))
def test_transforms_of_kernels_are_their_integrals(kernel, real, imaginary):
    s = complex(real, imaginary)

    def part(x, of):  # t = x**4: smooth enough at 0
        return of(4 * x**3 * kernel(x**4) * np.exp(-s * x**4))

    end = (60.0 / real) ** 0.25
    whole = [quad(part, 1e-300, end, of, limit=2000)[0] for of in (np.real, np.imag)]
    assert abs(kernel.laplace(s) - complex(*whole)) < 1e-7 * abs(kernel.laplace(real))


@pytest.mark.parametrize(
    ("kernel", "m"), [*itertools.product(KERNELS[:4], [1, 2]), (KERNELS[0], 0), (KERNELS[1], 0)]
)
def test_linear_responses_with_kernels(kernel, m):
    terms = hd.Caputo(2.0) + 0.3 * hd.Caputo(1.0) + 0.2 * hd.Memory(kernel, m)
    equation = hd.Equation(terms, driven, [0.0, 0.0], params=[1.0, 0.7, 0.0])
    found = hd.frequency_response(equation, np.linspace(0.2, 3.0, 7), harmonics=2)
    s = 1j * found.omega
    expected = 0.7 / (s**2 + 0.3 * s + 0.2 * s**m * kernel.laplace(s) + 1)
    assert np.allclose(found.coefficients[:, 0, 1], expected, rtol=1e-11, atol=0)


def test_a_fitted_sum_stands_for_a_kernel():
    exact, base = hd.MittagLeffler(0.6, 1.5), duffing(1.0, 0.2, 2.0, 1.0, 0.3)
    both = [
        hd.frequency_response(
            base.replace(terms=[*base.terms, hd.Memory(kernel, 1)]), [0.5, 1.0]
        ).coefficients
        for kernel in (exact, hd.fit_exponentials(exact, 1e-8, 1e8, 1e-9))
    ]
    assert np.abs(both[0] - both[1]).max() < 1e-6


def reads_friction(t, x, memory, p):
    return p[1] * np.cos(p[0] * t) - x - 0.2 * memory[0, 0] - p[2] * x[0] ** 2 * memory[0, 0]


def test_memory_that_the_right_hand_side_reads():
    """As the same term on the left side, where it is linear; and as a march, where it is not."""
    read = hd.Equation(
        hd.Caputo(1.9), reads_friction, [0.0, 0.0], params=[1.0, 0.5, 0.0], memory=hd.Caputo(0.8)
    )
    written = duffing(0.5, 0.0, 1.9, 0.8, 0.2)
    omegas = np.linspace(0.5, 2.0, 6)
    one, other = (hd.frequency_response(eq, omegas).coefficients for eq in (read, written))
    assert np.allclose(one, other, atol=1e-12)
    found = hd.frequency_response(read.replace(params=[1.0, 0.5, 0.4]), [1.1], harmonics=11)
    start = found.coefficients[0, 0]
    by_march = settled(read.replace(params=[1.0, 0.5, 0.4]), start, 1.1)
    assert abs(by_march - start[1]) < 2e-4 * abs(start[1])


def test_the_curve_follows_another_parameter():
    """Through both folds of the force, onto the responses of a curve of frequencies."""
    equation = duffing().replace(params=[1.4, 0.3, 0.5])
    by_force = hd.frequency_response(equation, np.linspace(0.0, 1.0, 51), along=1)
    assert by_force.complete
    assert by_force.turning.size == 2
    assert np.all(by_force.omega == 1.4)
    assert by_force.values[0] == 0.0
    assert np.isnan(by_force.quality())
    by_frequency = hd.frequency_response(
        equation.replace(params=[1.0, 0.5, 0.5]), np.linspace(0.4, 2.4, 101)
    )
    here = np.abs(by_frequency.omega - 1.4) < 1e-9
    there = np.abs(by_force.values - 0.5) < 1e-9
    assert here.sum() == there.sum() == 3
    one, other = (
        np.sort(found.amplitude[at, 0]) for found, at in ((by_frequency, here), (by_force, there))
    )
    assert np.allclose(one, other, rtol=1e-9)


def test_peaks_lie_between_frequencies():
    """Of classical resonance: at sqrt(1 - 2 zeta**2), 1 / (2 zeta sqrt(1 - zeta**2)) high."""
    zeta = 0.1
    equation = duffing(1.0, 0.0, 2.0, 1.0, 2 * zeta)
    found = hd.frequency_response(equation, np.linspace(0.8, 1.2, 41), harmonics=1)
    omega, height = found.peak()
    assert omega == pytest.approx(np.sqrt(1 - 2 * zeta**2), abs=1e-4)
    assert height == pytest.approx(1 / (2 * zeta * np.sqrt(1 - zeta**2)), rel=1e-5)
    rising = hd.frequency_response(equation, np.linspace(0.2, 0.8, 11), harmonics=1)
    assert rising.peak() == (0.8, rising.amplitude[-1, 0])


@pytest.mark.parametrize("force", [0.1, 0.2, 0.3, 0.6])
def test_peaks_beside_folds_do_not_depend_on_the_frequencies_asked_for(force):
    """Never below a response that was found, and above the highest of many by next to nothing."""
    equation = duffing().replace(params=[1.0, force, 0.5])
    for n in (20, 50, 61):
        found = hd.frequency_response(equation, np.linspace(0.4, 2.4, n))
        assert len(found.peaks) == 1
        near = found.peak()[0] + np.linspace(-0.05, 0.05, 51)
        fine = hd.frequency_response(equation, np.append(0.4, near)).amplitude.max()
        assert found.peak()[1] >= found.amplitude.max()
        assert fine - 1e-9 <= found.peak()[1] < fine * (1 + 1e-4)


def test_several_components_have_a_legend():
    found = hd.frequency_response(coupled_pair(), [0.5, 1.0, 1.5], harmonics=2)
    ax = hd.plots.frequency_response(found, components=[0, 1], label="x")
    texts = [text.get_text() for text in ax.get_legend().get_texts()]
    assert texts == ["x, component 0", "x, component 1"]
    assert hd.plots.frequency_response(found).get_legend() is None
