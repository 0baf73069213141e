"""Laws every history obeys: linear, causal, as direct sums within tolerance, safe to store."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from strategies import orders, sequences

import hereditary as hd
from hereditary.compiled.reference import by_reference
from hereditary.given.fixed_stepper import FixedStepper
from hereditary.given.past import exchange_direct
from hereditary.given.plan import Convolution
from hereditary.given.signatures import HISTORY_TABLES, MEMORY, Tables, held
from hereditary.given.steps import UniformSteps
from hereditary.given.weights import FIRST_DIFFERENCES, SECOND_DIFFERENCES
from hereditary.kernels.step_kernel import PowerSteps

N_BLOCK, N_BLOCKS = 8, 6
N = N_BLOCK * N_BLOCKS
HISTORIES = [hd.Direct(), hd.FFT(), hd.SumOfExponentials(1e-6), hd.SumOfExponentials(1e-12)]


def convolution(alpha, gamma):
    """One class: a term of order alpha in (0, 2) and one of order gamma in (0, 1)."""
    rule = SECOND_DIFFERENCES if alpha > 1 else FIRST_DIFFERENCES
    first, second = PowerSteps(np.ceil(alpha) - alpha), PowerSteps(1 - gamma)
    terms = ((1.0, rule, first), (0.25, FIRST_DIFFERENCES, second))
    start = tuple((-f, FIRST_DIFFERENCES, p) for f, _, p in terms)
    return Convolution((terms,), (start,))


def open_memory(history, weights, start, n=N):
    memory = history.open(weights, len(start), N_BLOCK, n)
    memory.prepare(n)
    if memory.nbytes:
        memory.arrays.starts[:] = np.reshape(start, (-1, 1))
    return memory


def feed(memory, pieces, first_block=0, last_block=None):
    """Lags of the blocks, (W, N), while `pieces` (W, N) are absorbed block by block."""
    width = pieces.shape[0]
    padded = np.pad(pieces, ((0, 0), (1, 0)))
    groups = np.zeros(width, dtype=np.int64)
    lags = []
    for b in range(first_block, pieces.shape[1] // N_BLOCK if last_block is None else last_block):
        n = b * N_BLOCK
        handed = np.zeros((width, N_BLOCK + 1))
        if b:
            handed[:] = padded[:, n - N_BLOCK : n + 1]
        lag = np.zeros((width, N_BLOCK))
        tables = by_reference(memory.tables, HISTORY_TABLES)
        memory.exchange(lag, handed, n, groups, tables, by_reference(memory.arrays, MEMORY))
        lags.append(lag)
    return np.concatenate(lags, axis=1)


@pytest.mark.parametrize("history", HISTORIES, ids=repr)
@given(sequences(N), sequences(N), st.floats(-3, 3), st.floats(-3, 3), orders(0.05, 1.95))
def test_linear(history, u, v, a, b, alpha):
    weights = convolution(alpha, 0.6)

    def lag(pieces, start):
        return feed(open_memory(history, weights, [start]), pieces)

    mixed = lag(a * u + b * v, a * 0.3 + b * -0.7)
    expected = a * lag(u, 0.3) + b * lag(v, -0.7)
    np.testing.assert_allclose(mixed, expected, rtol=1e-9, atol=1e-11)


@pytest.mark.parametrize("history", HISTORIES, ids=repr)
@given(sequences(N), sequences(N), st.integers(1, N - 1), orders(0.05, 1.95))
def test_causal(history, u, v, change_at, alpha):
    """Pieces from `change_at` on do not touch lags of blocks that begin before they are made."""
    weights = convolution(alpha, 0.6)
    changed = np.where(np.arange(N) < change_at, u, v)
    before = feed(open_memory(history, weights, [0.1]), u)
    after = feed(open_memory(history, weights, [0.1]), changed)
    known = (change_at // N_BLOCK + 1) * N_BLOCK  # that block began with u_(change_at - 1) at most
    assert np.array_equal(before[:, :known], after[:, :known])


@pytest.mark.parametrize("tol", [1e-4, 1e-8, 1e-12])
@given(sequences(N), orders(0.02, 1.98), orders(0.02, 0.98))
def test_agrees_with_direct_sums_within_its_tolerance(tol, u, alpha, gamma):
    weights = convolution(alpha, gamma)
    direct = feed(open_memory(hd.Direct(), weights, [0.5]), u)
    fast = feed(open_memory(hd.SumOfExponentials(tol), weights, [0.5]), u)
    # relative to sum |b_k| |u_m|: second differences of u are at most four times u
    exact = FIRST_DIFFERENCES.exact(PowerSteps(np.ceil(alpha) - alpha), N).sum()
    scale = (4 * exact + FIRST_DIFFERENCES.exact(PowerSteps(1 - gamma), N).sum()) * (
        np.abs(u).max() + 0.5
    )
    # start weights are sums of exponentials from k = 2 on
    assert np.abs(fast - direct)[:, 2:].max() <= tol * scale + 1e-14


def test_the_tolerance_is_used():
    u = np.ones((1, N))
    weights = convolution(0.5, 0.6)
    direct = feed(open_memory(hd.Direct(), weights, [0.5]), u)
    for tol in (1e-4, 1e-8):
        fast = feed(open_memory(hd.SumOfExponentials(tol), weights, [0.5]), u)
        assert np.abs(fast - direct).max() > 1e-3 * tol


@pytest.mark.parametrize("history", HISTORIES, ids=repr)
@settings(max_examples=10)
@given(sequences(N, width=2), sequences(2, width=2))
def test_combinations_of_columns_are_linear_in_everything_held(history, u, matrix):
    weights, half = convolution(1.8, 0.8), N_BLOCKS // 2
    start = np.array([0.2, -0.4])
    memory = open_memory(history, weights, start)
    feed(memory, u, last_block=half)
    for array in memory.arrays:
        array[...] = matrix.T @ array
    mixed = matrix.T @ u
    combined = feed(memory, mixed, first_block=half)
    through = feed(open_memory(history, weights, matrix.T @ start), mixed)
    np.testing.assert_allclose(combined, through[:, half * N_BLOCK :], rtol=1e-9, atol=1e-10)


@pytest.mark.parametrize("history", HISTORIES, ids=repr)
def test_restore(history):
    rng = np.random.default_rng(3)
    u, weights, half = rng.normal(size=(1, N)), convolution(1.7, 0.4), 3
    through = feed(open_memory(history, weights, [0.2]), u)[:, half * N_BLOCK :]
    memory = open_memory(history, weights, [0.2])
    feed(memory, u, last_block=half)
    stored = memory.state()
    feed(memory, 5 * u, first_block=half)  # must not reach what was stored
    fresh = open_memory(history, weights, [99.0])
    fresh.restore(stored)
    fresh.prepare(N)
    assert np.array_equal(feed(fresh, u, first_block=half), through)


def test_storage():
    weights = convolution(1.8, 0.8)
    short, long = (open_memory(hd.SumOfExponentials(), weights, [0.0], n) for n in (10**4, 10**7))
    assert short.nbytes == long.nbytes == 2 * 8 * 56
    assert short.n_modes <= 56
    direct = open_memory(hd.Direct(), weights, [0.0, 0.0], 1000)
    assert direct.nbytes >= 2 * 8 * 1000


def test_classical_terms_need_no_memory():
    classical = PowerSteps(0.0)
    terms, starts = (1.0, SECOND_DIFFERENCES, classical), (1.0, FIRST_DIFFERENCES, classical)
    weights = Convolution(((terms,),), ((starts,),))
    for history in HISTORIES:
        memory = history.open(weights, 1, N_BLOCK, 100)
        assert memory.nbytes == memory.n_modes == 0


def test_a_horizon_is_kept_and_its_end_is_told():
    weights = convolution(1.8, 0.8)
    memory = open_memory(hd.SumOfExponentials(), weights, [0.0], 1000)
    memory.prepare(10**7)
    with pytest.raises(ValueError, match=r"SumOfExponentials\(horizon=\), the time"):
        memory.prepare(3 * 10**7)
    system, history = hd.scenes.relaxation().system, hd.SumOfExponentials(horizon=3e4)
    far = FixedStepper(system, hd.L1(), history, UniformSteps(1e-3), 1000)
    far.prepare(3 * 10**7)
    with pytest.raises(ValueError, match="resume must stay within"):
        far.prepare(3 * 10**8)


def test_direct_sums_lose_nothing_as_they_grow():
    """Equal terms: plain summation would be off by a few 1e-12 of the sum."""
    n = 1 << 17
    memory = held(1, pieces=n + 2, starts=1)
    memory.pieces[0, 1:] = 0.1
    tables = Tables(weights=np.full((1, n + 3), 0.1), start_weights=np.zeros((1, n + 3)))
    lag = np.zeros((1, 1))
    exchange_direct(lag, np.full((1, 2), 0.1), n, np.array([0]), tables, memory)
    assert lag[0, 0] == pytest.approx((n - 1) * 0.1 * 0.1, rel=2e-16, abs=0)
