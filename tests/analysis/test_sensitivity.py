"""Sensitivities: closed forms of Mittag-Leffler's derivatives, and differences of runs."""

import re
import signal
from functools import partial

import mpmath
import numpy as np
import pytest
from cases import GIVEN
from problems import delayed_growth
from scipy.special import gamma

import hereditary as hd
from hereditary import exact

ALL = ("params", "y0", "orders")


def driven(t, x, p):
    return p[0] * np.cos(t) - p[1] * np.sin(x)


def predators(t, y, dy, p):
    dy[0] = y[0] * (p[0] - y[1])
    dy[1] = y[1] * (y[0] - p[1])


def relaxation(alpha=0.7, rate=1.5, y0=2.0):
    return hd.Equation(hd.Caputo(alpha), lambda t, y, p: -p[0] * y, y0, params=[rate])


def swing(t_start=0.0):
    terms = hd.Caputo(1.8) + 0.25 * hd.Caputo(0.8)
    return hd.Equation(terms, driven, [0.3, 0.1], params=[1.0, 2.0], t_start=t_start)


def mittag_leffler(alpha, z):
    return mpmath.nsum(lambda n: z**n / mpmath.gamma(alpha * n + 1), [0, mpmath.inf])


@pytest.mark.parametrize("alpha", [0.3, 0.7, 1.0])
def test_derivatives_of_mittag_leffler_functions(alpha):
    times, rate, y0 = [0.25, 0.5, 1.0], 1.5, 2.0
    found = hd.sensitivities(relaxation(alpha), 1.0, rtol=1e-10, wrt=ALL, t_eval=times)
    assert found.success
    with mpmath.workdps(30):
        for i, t in enumerate(map(mpmath.mpf, times)):

            def y(a, k, t=t):
                return y0 * mittag_leffler(a, -k * t**a)

            assert found.y[i, 0] == pytest.approx(float(y(alpha, rate)), abs=1e-10)
            by_rate = float(mpmath.diff(lambda k: y(alpha, k), rate))
            assert found.by_params[i, 0, 0] == pytest.approx(by_rate, abs=1e-9)
            assert found.by_y0[i, 0, 0] == pytest.approx(float(y(alpha, rate)) / y0, abs=1e-10)
            by_order = float(mpmath.diff(lambda a: y(a, rate), alpha))
            assert found.by_orders[i, 0, 0] == pytest.approx(by_order, abs=3e-7)


@pytest.mark.parametrize("how", [{"rtol": 1e-10}, {"n_steps": 4000, "scheme": hd.BDF(2)}], ids=str)
@pytest.mark.parametrize("start", [0.0, 3.0])
def test_several_terms_of_order_above_1(how, start):
    equation = swing(start)
    found = hd.sensitivities(equation, start + 4.0, wrt=ALL, **how)
    assert found.by_params.shape == (2, 1, 2)
    assert found.by_y0.shape == found.by_orders.shape == (2, 1, 2)
    assert np.array_equal(found.by_y0[0], [[1.0, 0.0]])
    for k in range(2):
        for of, ours in (("params", found.by_params), ("y0", found.by_y0)):
            by_runs = by_differences(equation, k, 1e-4, start + 4.0, of=of, **how)
            assert ours[-1, :, k] == pytest.approx(by_runs, abs=2e-6)


@pytest.mark.parametrize("how", [{"rtol": 1e-10}, {"n_steps": 4000, "scheme": hd.BDF(2)}], ids=str)
@pytest.mark.parametrize("start", [0.0, 3.0])
def test_a_force_that_begins_at_a_break(how, start):
    """Its derivative is a Mittag-Leffler function of the time since then."""
    alpha, rate = 0.7, 1.5

    def pushed(t, y, p):
        return -p[0] * y + (p[1] if t >= start + 1 else 0.0)

    eq = hd.Equation(hd.Caputo(alpha), pushed, 2.0, params=[rate, 0.4], t_start=start)
    times = [start + 1.0, start + 2.0]
    found = hd.sensitivities(
        eq, start + 2.0, t_eval=times, breaks=times[:1], wrt=("params", "orders"), **how
    )
    assert found.by_params[0, 0, 1] == 0.0
    known = exact.mittag_leffler(-rate, alpha, 1 + alpha).real
    error = 1e-8 if "rtol" in how else 1e-3
    assert found.by_params[1, 0, 1] == pytest.approx(known, abs=error)
    by_order = relaxation(alpha).replace(params=[rate])
    free = hd.sensitivities(by_order, 1.0, wrt="orders", **how).by_orders[-1, 0, 0]
    assert found.by_orders[0, 0, 0] == pytest.approx(free, abs=1e-5)


def test_components_whose_orders_differ():
    equation = hd.Equation(hd.Caputo([0.9, 0.7]), predators, [1.0, 0.5], params=[1.0, 0.8])
    found = hd.sensitivities(equation, 3.0, rtol=1e-9)
    steps = hd.sensitivities(equation, 3.0, 4000, scheme=hd.BDF(2))
    assert np.abs(found.by_params[-1] - steps.by_params[-1]).max() < 1e-5
    assert np.abs(found.by_y0[-1] - steps.by_y0[-1]).max() < 1e-5


@pytest.mark.parametrize("scale", [1e-10, 1e-3, 1e8])
@pytest.mark.parametrize("how", [{"rtol": 1e-9}, {"n_steps": 400, "scheme": hd.BDF(2)}], ids=str)
def test_the_unit_of_parameters_does_not_matter(scale, how):
    """Only p1 / p0 acts, so the derivatives by the two of them are opposite."""
    equation = hd.Equation(
        hd.Caputo(0.7), lambda t, y, p: -p[1] / p[0] * y, 1.0, params=[scale, scale]
    )
    found = hd.sensitivities(equation, 2.0, **how).by_params[-1, 0] * scale
    assert found == pytest.approx([0.2534105, -0.2534105], abs=1e-6)


def test_the_unit_of_y_does_not_matter():
    """Differences over 6e-6 of 1 would not see a solution of 1e-10 bend."""

    def saturating(t, y, p):
        return -p[0] * 1e-10 * y / (1e-10 + y)

    equation = hd.Equation(hd.Caputo(0.7), saturating, 1e-10, params=[1.0])
    found = hd.sensitivities(equation, 2.0, 1000, scheme=hd.BDF(2))
    above, below = (
        hd.solve(equation.replace(y0=y0), 2.0, 1000, scheme=hd.BDF(2)).y[-1, 0]
        for y0 in (1.001e-10, 0.999e-10)
    )
    assert found.by_y0[-1, 0, 0] == pytest.approx((above - below) / 2e-13, rel=1e-4)


def test_orders_whose_runs_end_early():
    growing = hd.Equation(hd.Caputo(0.9), lambda t, y, p: p[0] * y * y, 1.0, params=[1.0])
    found = hd.sensitivities(growing, 2.0, t_eval=[0.0, 0.5, 0.8105], wrt="orders", rtol=1e-8)
    assert np.isfinite(found.by_orders[:2]).all()
    assert np.isnan(found.by_orders[2]).all()


def test_a_run_that_ends_early_keeps_its_rows():
    growing = hd.Equation(hd.Caputo(0.8), lambda t, y, p: p[0] * y**2, 1.0, params=[1.0])
    with pytest.warns(hd.SolveWarning):
        found = hd.sensitivities(growing, 5.0, rtol=1e-6, wrt=ALL, t_eval=[0.1, 0.3, 4.0])
    assert found.status == "blown_up"
    assert found.t.tolist() == [0.1, 0.3]
    assert found.by_params.shape == found.by_orders.shape == (2, 1, 1)


def test_equations_without_params_and_with_orders_that_vary():
    bare = hd.Equation(hd.Caputo(0.8), lambda t, y: -y, 1.0)
    assert hd.sensitivities(bare, 1.0, rtol=1e-6).by_params is None
    varying = hd.Equation(
        hd.Caputo(lambda t: 0.7 + 0.1 * t), lambda t, y, p: -p[0] * y, 1.0, params=[1.0]
    )
    found = hd.sensitivities(varying, 1.0, rtol=1e-8)
    by_runs = by_differences(varying, 0, 1e-3, 1.0, rtol=1e-10)
    assert found.by_params[-1, :, 0] == pytest.approx(by_runs, abs=1e-5)


def chorus(t, y, dy, p):
    dy[0] = -y[0] * y[0]
    for k in range(p.size):
        dy[0] += p[k] * np.cos((k + 1) * t) / (k + 1)


@pytest.mark.parametrize("rtol", [1e-4, 1e-8, 1e-11])
def test_fifty_parameters_of_little_effect(rtol):
    """Each moves f by some hundredths of it, where rounding shows in differences of f."""
    equation = hd.Equation(hd.Caputo(0.7), chorus, 1.0, params=np.linspace(0.5, 1.0, 50))
    found = hd.sensitivities(equation, 2.0, rtol=rtol, wrt="params")
    assert found.success
    for k in (0, 7, 49):
        by_runs = by_differences(equation, k, 2e-4, rtol=1e-12)
        assert found.by_params[-1, :, k] == pytest.approx(by_runs, abs=max(0.1 * rtol, 1e-8))


def by_differences(equation, k, change, t_end=2.0, n_steps=None, of="params", **how):
    """Return the derivative of the last row by a parameter or an initial value, by two runs."""
    values = getattr(equation, of)
    moved = change * np.eye(values.size)[k].reshape(values.shape)
    above, below = (
        hd.solve(equation.replace(**{of: values + e}), t_end, n_steps, **how).y[-1]
        for e in (moved, -moved)
    )
    return (above - below) / (2 * change)


def pairs(t, y, dy, p):
    dy[0] = p[0] * np.sin(y[1]) - y[0]
    dy[1] = -p[1] * y[0] * y[1]


@pytest.mark.parametrize("scheme", GIVEN, ids=repr)
def test_every_scheme_gives_the_derivative_of_its_own_rows(scheme):
    equation = hd.Equation(hd.Caputo(0.8), pairs, [1.0, 0.5], params=[1.2, 0.7])
    found = hd.sensitivities(equation, 1.0, 40, scheme=scheme)
    for k in range(2):
        by_runs = by_differences(equation, k, 1e-4, 1.0, 40, scheme=scheme)
        assert found.by_params[-1, :, k] == pytest.approx(by_runs, abs=1e-7)


@pytest.mark.parametrize("t_end", [1.0, 2.0])
def test_jumps_next_to_bounded_kernels(t_end):
    """Of an exponential kernel y jumps at the start and with f, and so do its derivatives."""
    term = hd.Memory(hd.Prony([1.0], [2.0]), 1)
    equation = hd.Equation(
        term, lambda t, y, p: (p[1] if t >= 1.0 else 0.5) - p[0] * y**3, 1.0, params=[0.8, 1.5]
    )
    how = {"rtol": 1e-11, "breaks": [1.0]}
    found = hd.sensitivities(equation, t_end, wrt="params", **how)
    for k in range(2):
        by_runs = by_differences(equation, k, 1e-4, t_end, **how)
        assert found.by_params[-1, :, k] == pytest.approx(by_runs, abs=1e-7)


def chain(t, y, dy, p):
    for c in range(y.size):
        left, right = y[c - 1] if c > 0 else 1.0, y[c + 1] if c < y.size - 1 else 0.0
        dy[c] = p[0] * (left - 2.0 * y[c] + right) - p[1] * y[c] ** 3


@pytest.mark.parametrize("how", [{"rtol": 1e-8}, {"n_steps": 200, "scheme": hd.BDF(2)}], ids=str)
def test_many_components_with_stated_entries(how):
    """Twenty neighbours that act on each other with the same force."""
    given = hd.Caputo(0.8), chain, np.zeros(20)
    dense = hd.Equation(*given, params=[1.0, 0.5])
    banded = hd.Equation(*given, params=[1.0, 0.5], bandwidth=(1, 1))
    found, same = (hd.sensitivities(e, 2.0, wrt="params", **how) for e in (banded, dense))
    assert found.by_params == pytest.approx(same.by_params, abs=1e-8)
    for k in range(2):
        by_runs = by_differences(banded, k, 1e-4, **how)
        assert found.by_params[-1, :, k] == pytest.approx(by_runs, abs=1e-6)


def recalling(t, y, memory, p):
    return p[1] * memory[0] * np.cos(t) - p[0] * y


HOW = {"rtol": 1e-10}, {"n_steps": 100, "scheme": hd.L1()}, {"n_steps": 100}


@pytest.mark.parametrize("how", HOW, ids=str)
@pytest.mark.parametrize("memory", [hd.Caputo(0.4), hd.Memory(hd.Prony([1.0], [0.5]), 0)], ids=repr)
def test_memory_that_the_right_hand_side_reads(memory, how):
    equation = hd.Equation(hd.Caputo(0.8), recalling, 1.0, params=[1.0, 0.5], memory=memory)
    found = hd.sensitivities(equation, 2.0, wrt="params", **how)
    for k in range(2):
        by_runs = by_differences(equation, k, 1e-4, **how)
        assert found.by_params[-1, :, k] == pytest.approx(by_runs, abs=1e-7)


@pytest.mark.usefixtures("ctrl_c")
@pytest.mark.parametrize("how", [{"n_steps": 10**7, "scheme": hd.ExplicitCaputo()}, {"rtol": 1e-9}])
def test_an_interrupted_run_has_its_rows(how):
    equation = hd.Equation(
        hd.Caputo([2.0, 1.0]), lambda t, y, p: np.array([-p[0] * y[0], np.cos(1e3 * t)]),
        [[1.0, 0.0], [0.0, 0.0]], params=[2e3],
    )  # fmt: skip
    times = np.linspace(0.0, 1e4, 10_001)
    hd.sensitivities(equation, 1.0, **(how | ({"n_steps": 1000} if "n_steps" in how else {})))
    previous = signal.signal(signal.SIGALRM, lambda *_: signal.raise_signal(signal.SIGINT))
    signal.setitimer(signal.ITIMER_REAL, 0.5)
    try:
        found = hd.sensitivities(equation, 1e4, t_eval=times, wrt=ALL[:2], **how)
    finally:
        signal.signal(signal.SIGALRM, previous)
    assert found.status is hd.Status.INTERRUPTED
    assert 0 < len(found.t) == len(found.by_params) == len(found.by_y0) < times.size


def test_rows_lie_between_steps_with_a_tolerance():
    """A gamma density makes a larger system, among whose components y and its tangents are."""
    terms = hd.Caputo(1.6) + 0.5 * hd.Memory(hd.GammaDensity(2.0, 3.0), 0)
    equation = hd.Equation(
        terms, lambda t, y, p: p[1] * np.cos(t) - p[0] * y, [1.0, 0.2], params=[1.0, 0.5]
    )
    times = np.linspace(0.0, 2.0, 9)
    found = hd.sensitivities(equation, 2.0, rtol=1e-10, t_eval=times)
    assert np.array_equal(found.by_y0[0], [[1.0, 0.0]])
    assert not found.by_params[0].any()
    for i in (1, 4, 8):
        for k in range(2):
            by_runs = by_differences(equation, k, 1e-4, times[i], rtol=1e-11)
            assert found.by_params[i, :, k] == pytest.approx(by_runs, abs=1e-7)
    unit = hd.solve(equation.replace(y0=[2.0, 0.2]), 2.0, rtol=1e-10, t_eval=times).y
    assert found.y[:, 0] + found.by_y0[:, 0, 0] == pytest.approx(unit[:, 0], abs=1e-8)


def recalling_twice(t, y, memory, p):
    return -p[0] * y - p[1] * memory[0] ** 2 * y


def cubes(t, y, p):
    return -p[0] * y**3


MASS, FRICTION = np.array([[1.0, 0.3], [0.3, 1.0]]), np.array([[0.2, 0.1], [0.0, 0.3]])
WITH_MEMORY = [
    partial(hd.Equation, hd.Caputo(order), recalling_twice, y0, params=[1.0, 0.5], memory=memory)
    for order, y0 in ((0.7, [1.0]), (1.6, [1.0, 0.4]))
    for memory in (hd.Caputo(0.4), hd.Memory(hd.GammaDensity(3.0, 3.0), 0))
]
WITH_MATRICES = [
    partial(
        hd.Equation, MASS * hd.Caputo(order) + FRICTION * hd.Caputo(0.3), cubes, y0, params=[1.0]
    )
    for order, y0 in ((0.7, [1.0, 0.5]), (1.6, [[1.0, 0.5], [0.0, 0.2]]))
]


@pytest.mark.parametrize("how", [{"rtol": 1e-10}, {"n_steps": 200, "scheme": hd.BDF(2)}], ids=str)
@pytest.mark.parametrize("place", range(6))
def test_initial_values_beside_memory_and_matrices(place, how):
    """Components that stand for memory have no initial values of their own."""
    equation = [*WITH_MEMORY, *WITH_MATRICES][place]()
    if "n_steps" in how and place in (1, 3):
        how = how | {"scheme": hd.L1()}
    found = hd.sensitivities(equation, 2.0, **how)
    assert found.by_y0.shape == (2, equation.d, equation.y0.size)
    for k in range(equation.y0.size):
        by_runs = by_differences(equation, k, 1e-4, of="y0", **how)
        assert found.by_y0[-1, :, k] == pytest.approx(by_runs, abs=1e-7)
    by_runs = by_differences(equation, 0, 1e-4, **how)
    assert found.by_params[-1, :, 0] == pytest.approx(by_runs, abs=1e-7)


class InPython:
    def __call__(self, t, y, p):
        return [p[0] * np.sin(y[1]) - y[0], -p[1] * y[0] * y[1]]


def pairs_late(t, y, late, dy, p):
    dy[0] = p[0] * np.sin(y[1]) - y[0] + 0.0 * late[0, 0]
    dy[1] = -p[1] * y[0] * y[1]


def pair_of_parts(t, z, p):
    return p[0] * np.sin(z[0].imag) - z[0].real - 1j * p[1] * z[0].real * z[0].imag


def of_pairs(rhs=pairs, y0=(1.0, 0.5), **given):
    return hd.Equation(hd.Caputo(0.8), rhs, y0, params=[1.2, 0.7], **given)


# the same two components, with tangents and without
WITHOUT_TANGENTS = {
    "a function is called in Python": lambda: of_pairs(InPython()),
    "the equation has delays": lambda: of_pairs(pairs_late, memory=hd.Delay(0.7)),
    "y is complex": lambda: of_pairs(pair_of_parts, [1.0 + 0.5j]),
}
WAYS = {"rtol": 1e-10}, {"n_steps": 400, "scheme": hd.BDF(2)}, {"n_steps": 400}


def error_of(found):
    """The error of derivatives, as a fraction of their size, that the message has."""
    return float(re.search(r"their errors are about (\S+) of", found.message)[1])


@pytest.mark.filterwarnings("ignore::hereditary.PythonFunctionWarning")
@pytest.mark.parametrize("how", WAYS, ids=str)
@pytest.mark.parametrize("reason", WITHOUT_TANGENTS)
def test_differences_equal_tangents(reason, how):
    given = {"wrt": ALL, "t_eval": [0.0, 1.0, 4.0], **how}
    tangents = hd.sensitivities(of_pairs(), 4.0, **given)
    found = hd.sensitivities(WITHOUT_TANGENTS[reason](), 4.0, **given)
    assert found.success
    assert f"differences of runs, because {reason}" in found.message
    assert "differences" not in tangents.message
    for kind in ("by_params", "by_y0", "by_orders"):
        ours, theirs = getattr(found, kind), getattr(tangents, kind)
        if reason == "y is complex":
            ours = np.stack([ours.real, ours.imag], axis=2).reshape(theirs.shape)
        assert ours == pytest.approx(theirs, abs=error_of(found) * np.abs(theirs).max())


def bent_chain(t, y, dy, p):
    dy[0], dy[1] = y[1], y[2]
    dy[2] = -p[0] * y[0] - p[1] * y[0] ** 3


def test_differences_of_order_3_and_their_error_where_y_bends():
    """y''(0) = 0 has no size of its own, and y grows until it ends at t = 5.3."""
    start, params = [1.0, 0.2, 0.0], [1.2, 0.7]
    found = hd.sensitivities(
        hd.Equation(hd.Caputo(3), lambda t, y, p: -p[0] * y - p[1] * y**3, start, params), 3.0
    )
    chain = hd.Equation(hd.Caputo(1), bent_chain, start, params)
    tangents = hd.sensitivities(chain, 3.0, rtol=1e-11)
    assert "because an order exceeds 2" in found.message
    assert found.by_y0.shape == (2, 1, 3)
    for ours, theirs in (
        (found.by_params, tangents.by_params[:, :1]),
        (found.by_y0, tangents.by_y0[:, :1]),
    ):
        assert ours == pytest.approx(theirs, abs=error_of(found) * np.abs(theirs).max())


@pytest.mark.parametrize("start", [0.0, 3.0])
@pytest.mark.parametrize("alpha", [0.3, 0.7, 1.5])
def test_differences_of_delays_are_the_exact_derivative(alpha, start):
    """y = sum_j p^j (t - j + 1)_+^(j alpha) / Gamma(j alpha + 1); a default past moves with y0."""
    equation = delayed_growth(alpha, -2.0).replace(t_start=start)
    found = hd.sensitivities(equation, start + 4.0, wrt=("params", "y0"))
    j = np.arange(1, 6)
    terms = (5.0 - j).clip(0.0) ** (j * alpha) / gamma(j * alpha + 1)
    by_p, error = np.sum(j * (-2.0) ** (j - 1) * terms), error_of(found)
    assert found.success
    assert found.by_params[-1, 0, 0] == pytest.approx(by_p, rel=error)
    assert found.by_y0[-1, 0, 0] == pytest.approx(found.y[-1, 0], rel=error)


def test_differences_beside_algebraic_rows_satisfy_them():
    def loop(t, y, late, p):
        return np.array([y[1] - y[0], p[0] * y[0] + p[1] * late[0, 1] - y[1]])

    first = np.array([1.0, 0.0]) * hd.Caputo(0.8)
    delay = hd.Delay(0.7, past=[1.0, 0.5])
    equation = hd.Equation(first, loop, [1.0, 0.5], params=[0.5, 0.0], memory=delay)
    found = hd.sensitivities(equation, 2.0)
    alone = hd.Equation(hd.Caputo(0.8), lambda t, y, p: (p[0] - 1) * y, 1.0, params=[0.5])
    known = hd.sensitivities(alone, 2.0, rtol=1e-10)
    assert found.by_params[0, :, 0] == pytest.approx([0.0, 1.0], abs=1e-7)
    assert found.by_params[0, :, 1] == pytest.approx([0.0, 0.5], abs=1e-7)
    assert found.by_y0[0] == pytest.approx(np.array([[1.0, 0.0], [0.5, 0.0]]), abs=1e-7)
    assert found.by_params[-1, 0, 0] == pytest.approx(known.by_params[-1, 0, 0], abs=1e-7)
    assert found.by_y0[-1, 0] == pytest.approx([known.by_y0[-1, 0, 0], 0.0], abs=1e-7)


def test_changes_are_small_where_y_grows():
    """An epidemic of a millionth grows to a share of 1 by a factor of 250,000 between."""

    def spread(t, y, late, p):
        return p[0] * y * (1 - y) + 0.0 * late[0]

    late = hd.Equation(hd.Caputo(1), spread, 1e-6, params=[1.0], memory=hd.Delay(1.0))
    found = hd.sensitivities(late, 14.0)
    grown = 1e-6 * np.exp(14.0)
    by_y0 = np.exp(14.0) / (1 + grown) ** 2
    assert found.by_y0[-1, 0, 0] == pytest.approx(by_y0, rel=1e-6)
    assert found.by_params[-1, 0, 0] == pytest.approx(14e-6 * by_y0, rel=1e-6)


def test_a_derivative_of_0_beside_a_bend_has_an_error_of_its_size():
    """y = p[0]^2 t + |p[1]| t at p = 0, where no size of the derivative is known."""

    def rising(t, z, p):
        return p[0] ** 2 + abs(p[1]) + 0j * z

    found = hd.sensitivities(hd.Equation(hd.Caputo(1), rising, 0j, params=[0.0, 0.0]), 2.0)
    assert np.array_equal(found.by_params, np.zeros((2, 1, 2)))
    assert error_of(found) == 1.0


def test_differences_whose_runs_end_early():
    def growing(t, y, late, p):
        return p[0] * y * y + 0.0 * late[0]

    late = hd.Equation(hd.Caputo(1), growing, 1.0, params=[1.0], memory=hd.Delay(0.3))
    found = hd.sensitivities(late, 1.0 - 1e-9, t_eval=[0.5, 1.0 - 1e-9], wrt="orders")
    assert np.isfinite(found.by_orders[0, 0, 0])
    assert np.isnan(found.by_orders[1, 0, 0])
    assert "NaN where a run of a changed equation has no rows" in found.message
    with pytest.warns(hd.SolveWarning):
        found = hd.sensitivities(late, 2.0, t_eval=[0.5, 1.5])
    assert found.status == "blown_up"
    assert found.t.tolist() == [0.5]
    assert found.by_params[:, 0, 0] == pytest.approx([0.5 / 0.5**2], rel=1e-6)


def pulsed(t, y, p):
    return p[0] * np.exp(-(((t - 5.0) / 0.01) ** 2)) - p[1] * y


def test_a_longest_step_finds_a_short_force():
    equation = hd.Equation(hd.Caputo(1), pulsed, 0.0, params=[1.0, 0.1])
    found = hd.sensitivities(equation, 10.0, rtol=1e-8, wrt="params", max_step=0.01)
    area = 0.01 * np.sqrt(np.pi) * np.exp(-0.5)
    assert found.by_params[-1, 0, 0] == pytest.approx(area, rel=1e-3)
    with pytest.raises(ValueError, match="max_step must be left out"):
        hd.sensitivities(equation, 10.0, 100, max_step=0.01)
