"""Terms with other kernels beside orders that vary: constant orders, definition, histories."""

import math
import pickle

import numpy as np
import pytest
from varying import alpha, beta, decay, swing

import hereditary as hd
from hereditary.analysis.order import observed_order

SCHEMES = [hd.ExplicitCaputo(), hd.L1()]
PRONY = hd.Prony((1.0, 10.0), (0.3, 0.7))
TEMPERED = hd.TemperedPowerLaw(0.4, 0.5)


# the Caputo term's order, the terms beside it, and initial values
CASES = {
    "y'": (alpha, [0.5 * hd.Memory(PRONY, 1)], 1.0),
    "y": (alpha, [0.5 * hd.Memory(PRONY, 0)], 1.0),
    "y' above order 1": (beta, [0.5 * hd.Memory(TEMPERED, 1)], [0.2, 0.3]),
    "y above order 1": (beta, [0.5 * hd.Memory(PRONY, 0)], [0.2, 0.3]),
    "y''": (beta, [0.5 * hd.Memory(PRONY, 2)], [0.2, 0.3]),
    "all": (
        beta,
        [0.5 * hd.Memory(PRONY, m) for m in (0, 1, 2)] + [0.3 * hd.Caputo(0.7)],
        [0.2, 0.3],
    ),
}
# L1 takes no memory of y itself above order 1
PAIRS = [
    (scheme, name)
    for scheme in SCHEMES
    for name in CASES
    if isinstance(scheme, hd.ExplicitCaputo) or name not in ("y above order 1", "all")
]


def made(name, order=None):
    varying, terms, y0 = CASES[name]
    return hd.Equation([hd.Caputo(varying if order is None else order), *terms], decay, y0)


def system():
    first, second = np.array([1.0, 0.0]), np.array([0.0, 1.0])
    terms = [
        first * hd.Caputo(beta), 0.5 * first * hd.Memory(PRONY, 1),
        second * hd.Caputo(alpha), 0.3 * hd.Memory(TEMPERED, 1),
    ]  # fmt: skip
    return hd.Equation(terms, swing, [[1.0, 0.5], [0.3, 0.0]])


@pytest.mark.parametrize(("scheme", "name"), PAIRS, ids=str)
def test_a_constant_function_is_the_constant_order(scheme, name):
    value = float(CASES[name][0](1.0))
    constant, varying = made(name, value), made(name, lambda t: value)
    expected = hd.solve(constant, 5.0, 1000, scheme=scheme, history=hd.Direct()).y
    direct = hd.solve(varying, 5.0, 1000, scheme=scheme, history=hd.Direct()).y
    assert np.abs(direct - expected).max() < 1e-12
    for tol in (1e-6, 1e-10):
        modes = hd.solve(varying, 5.0, 1000, scheme=scheme, history=hd.SumOfExponentials(tol)).y
        assert np.abs(modes - expected).max() < 20 * tol


@pytest.mark.parametrize(("scheme", "name"), PAIRS, ids=str)
def test_modes_agree_with_direct_sums(scheme, name):
    equation = made(name)
    direct = hd.solve(equation, 20.0, 2000, scheme=scheme, history=hd.Direct()).y
    for tol in (1e-5, 1e-10):
        modes = hd.solve(equation, 20.0, 2000, scheme=scheme, history=hd.SumOfExponentials(tol)).y
        assert np.abs(modes - direct).max() < 20 * tol * np.abs(direct).max()


def forced(t, y):
    """For 1 + 2 t + t**3 with the kernel exp(-t): int_0^t exp(-(t-s)) (2 + 3 s**2) ds beside."""
    b = 1.5 + 0.3 * math.cos(t)
    held = 3 * t**2 - 6 * t + 8 - 8 * math.exp(-t)
    return 6 / math.gamma(4 - b) * t ** (3 - b) + 0.5 * held + 1 + 2 * t + t**3 - y


@pytest.mark.parametrize("scheme", SCHEMES, ids=str)
def test_order(scheme):
    maxwell = hd.Memory(hd.Prony((1.0,), (1.0,)), 1)
    equation = hd.Equation([hd.Caputo(beta), 0.5 * maxwell], forced, [1.0, 2.0])
    steps, errors = [400, 800, 1600], []
    for n in steps:
        sol = hd.solve(equation, 2.5, n, scheme=scheme)
        errors.append(np.abs(sol.y[:, 0] - (1 + 2 * sol.t + sol.t**3)).max())
    table = observed_order(steps, errors)
    assert table.slope == pytest.approx(scheme.order(1.8), abs=0.1), table
    assert errors[-1] < 0.02


@pytest.mark.parametrize("history", [hd.Direct(), hd.SumOfExponentials()], ids=str)
@pytest.mark.parametrize(("scheme", "name"), PAIRS, ids=str)
def test_resumes_bit_for_bit(scheme, name, history):
    equation = made(name)
    whole = hd.solve(equation, 3.125, 400, scheme=scheme, history=history)
    for n in (1, 2, 3, 150):
        first = hd.solve(equation, n / 128, n, scheme=scheme, history=history)
        state = pickle.loads(pickle.dumps(first.state))
        rest = hd.solve(equation, 3.125, scheme=scheme, history=history, resume=state)
        assert np.array_equal(np.vstack([first.y, rest.y[1:]]), whole.y)


@pytest.mark.parametrize("history", [hd.Direct(), hd.SumOfExponentials()], ids=str)
@pytest.mark.parametrize(("scheme", "name"), [*PAIRS, *((s, "system") for s in SCHEMES)], ids=str)
def test_tangents_and_pairs_of_orbits_agree(scheme, name, history):
    equation = system() if name == "system" else made(name)
    arguments = {"k": 1, "renorm": 0.5, "scheme": scheme, "history": history}
    tangent = hd.lyapunov(equation, 5.0, 500, mode="tangent", **arguments)
    pair = hd.lyapunov(equation, 5.0, 500, mode="pair", **arguments)
    assert tangent.exponents == pytest.approx(pair.exponents, abs=1e-5)


@pytest.mark.parametrize("scheme", SCHEMES, ids=str)
def test_components_may_differ(scheme):
    """A system that does not hang together is its two equations, solved alone."""
    first, second = np.array([1.0, 0.0]), np.array([0.0, 1.0])
    terms = [
        first * hd.Caputo(alpha), 0.5 * first * hd.Memory(PRONY, 1), second * hd.Memory(TEMPERED, 1)
    ]  # fmt: skip
    both = hd.Equation(terms, lambda t, y: np.array([np.cos(t) - y[0], -y[1]]), [1.0, 2.0])
    sol = hd.solve(both, 5.0, 500, scheme=scheme).y
    alone = [
        hd.solve(hd.Equation(t, f, y), 5.0, 500, scheme=scheme, history=hd.Direct()).y[:, 0]
        for t, f, y in (
            ([hd.Caputo(alpha), 0.5 * hd.Memory(PRONY, 1)], decay, 1.0),
            (hd.Memory(TEMPERED, 1), lambda t, y: -y, 2.0),
        )
    ]
    assert np.abs(sol - np.column_stack(alone)).max() < 1e-9


def test_the_step_limit_counts_the_kernels_in():
    frozen = hd.Equation([hd.Caputo(0.6), 2.0 * hd.Memory(PRONY, 1)], lambda t, y: -3.0 * y, 1.0)
    varying = hd.Equation(
        [hd.Caputo(lambda t: 0.6), 2.0 * hd.Memory(PRONY, 1)], lambda t, y: -3.0 * y, 1.0
    )
    ratios = [hd.solve(e, 10.0, 1000).stats["stiffness_ratio"] for e in (frozen, varying)]
    assert ratios[1] == pytest.approx(ratios[0], rel=1e-9)


def test_what_is_refused():
    with pytest.raises(ValueError, match="history must be Direct or SumOfExponentials where"):
        hd.solve(made("y'"), 1.0, 100, history=hd.FFT())
    with pytest.raises(ValueError, match="derivative must be 1 or 2 with L1"):
        hd.solve(made("all"), 1.0, 100, scheme=hd.L1())
    for scheme in (hd.L2(), hd.BDF(2), hd.Adams()):
        with pytest.raises(ValueError, match="terms must have constant orders with"):
            hd.solve(made("y'"), 1.0, 100, scheme=scheme)
    state = hd.solve(made("y'"), 1.0, 100).state
    other = hd.Equation([hd.Caputo(alpha), 0.5 * hd.Memory(TEMPERED, 1)], decay, 1.0)
    with pytest.raises(ValueError, match="same kernels"):
        hd.solve(other, 2.0, resume=state)
