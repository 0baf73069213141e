"""A memory term that another program steps gives what the library's own steps give."""

import pickle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import hereditary as hd

RATES = np.array([1.0, 3.0])
SCHEMES = [hd.BDF(1), hd.BDF(2), hd.L1(), hd.L12(), hd.L2(), hd.L2Sigma()]
HISTORIES = [hd.Direct(), hd.FFT(), hd.SumOfExponentials()]


def relaxed(term, n_steps):
    """Steps of term = -RATES u."""
    for _ in range(n_steps):
        theta = term.theta
        known = -RATES * (1 - theta) * term.u - term.lag
        term.absorb(known / (term.weight + theta * RATES))
    return term.u


def decay(t, y):
    return -np.array([1.0, 3.0]) * y


@pytest.mark.parametrize("history", HISTORIES, ids=repr)
@pytest.mark.parametrize("scheme", SCHEMES, ids=repr)
@given(alpha=st.floats(0.05, 1.0), n_steps=st.integers(1, 150), h=st.floats(1e-4, 0.5))
def test_equal_to_the_run_of_the_scheme(scheme, history, alpha, n_steps, h):
    u0 = np.array([1.0, 2.0])
    if isinstance(scheme, hd.L2Sigma) and alpha == 1.0:
        alpha = 0.9
    term = hd.memory_term(alpha, h, scheme, u0, term0=-RATES * u0, history=history)
    run = hd.solve(
        hd.Equation(hd.Caputo(alpha), decay, u0), n_steps * h, n_steps, scheme=scheme,
        history=history,
    )  # fmt: skip
    assert np.abs(relaxed(term, n_steps) - run.y[-1]).max() < 1e-12


@pytest.mark.parametrize("scheme", [hd.BDF(2), hd.L1()], ids=repr)
def test_orders_above_1_begin_with_a_velocity(scheme):
    u0, v0 = np.array([1.0, 2.0]), np.array([0.5, -1.0])
    term = hd.memory_term(1.6, 0.01, scheme, u0, v0=v0, term0=-RATES * u0)
    equation = hd.Equation(hd.Caputo(1.6), decay, [u0, v0])
    run = hd.solve(equation, 3.0, 300, scheme=scheme)
    assert np.abs(relaxed(term, 300) - run.y[-1]).max() < 1e-11


def test_kernels_are_taken_as_they_are():
    kernel = hd.Prony([1.0, 10.0], [0.3, 0.7])
    term = hd.memory_term(kernel, 0.01, hd.L1(), [1.0, 2.0])
    equation = hd.Equation(
        hd.Memory(kernel, 1) + 1e-30 * hd.Caputo(1), decay, [1.0, 2.0]
    )  # an equation needs a derivative
    run = hd.solve(equation, 2.0, 200, scheme=hd.L1())
    assert np.abs(relaxed(term, 200) - run.y[-1]).max() < 1e-12


@pytest.mark.parametrize("history", HISTORIES, ids=repr)
@pytest.mark.parametrize("stop", [0, 1, 31, 32, 33, 100])
def test_goes_on_bit_for_bit(history, stop):
    def fresh():
        how = {"term0": -RATES, "v0": [0.1, 0.2], "history": history}
        return hd.memory_term(1.5, 0.01, hd.BDF(2), [1.0, 1.0], **how)

    unbroken, first, second = fresh(), fresh(), fresh()
    assert relaxed(first, stop) is not None
    if stop == 32:
        assert first.lag.shape == (2,)  # opens the block
    second.restore(pickle.loads(pickle.dumps(first.state())))
    assert second.n == stop
    assert np.array_equal(relaxed(second, 80), relaxed(unbroken, stop + 80))
    with pytest.raises(ValueError, match="state must come from"):
        hd.memory_term(1.5, 0.02, hd.BDF(2), [1.0, 1.0], history=history).restore(first.state())


GRID = np.linspace(0.01, 3.0, 300)


@pytest.mark.parametrize("history", HISTORIES[::2], ids=repr)
def test_kernels_known_by_values_make_the_steps_asked_for(history):
    def term(n_steps):
        table = hd.TabulatedKernel(GRID, np.exp(-GRID))
        return hd.memory_term(table, 0.01, hd.L1(), 1.0, history=history, n_steps=n_steps)

    def made(one, n_steps):
        for _ in range(n_steps):
            one.absorb(-one.lag / (one.weight + 1.0))
        return one.u

    first, second = term(100), term(100)
    made(first, 40)
    second.restore(pickle.loads(pickle.dumps(first.state())))
    assert made(first, 60) == made(second, 60)
    with pytest.raises(ValueError, match="n_steps must cover all steps, got 101"):
        made(first, 1)
    long = term(320)
    with pytest.raises(ValueError, match="stay within t = 3"):
        made(long, 320)
    assert long.n == 300


def test_any_shape():
    square = np.arange(6.0).reshape(2, 3)
    term = hd.memory_term(0.5, 0.1, hd.L1(), square)
    assert term.lag.shape == (2, 3)
    term.absorb(2 * square)
    assert np.array_equal(term.u, 2 * square)
    assert (term.n, term.t, term.theta) == (1, 0.1, 1.0)


def test_bad_values_are_refused_and_change_nothing():
    term = hd.memory_term(0.5, 0.1, hd.L1(), [1.0, 2.0])
    for bad in ([1.0, np.nan], [1.0, 2.0, 3.0]):
        with pytest.raises(ValueError, match="u must"):
            term.absorb(bad)
    assert term.n == 0
