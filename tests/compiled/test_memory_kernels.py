"""The compiled halves of the histories, against NumPy."""

import numpy as np
import pytest

from hereditary.compiled.convolution import exchange_direct
from hereditary.compiled.jacobian import jacobian
from hereditary.compiled.modes import add_rows, exchange_modes

RNG = np.random.default_rng(5)


@pytest.mark.parametrize("m", [0, 1, 3, 4, 8, 9])
def test_add_rows(m):
    out, factors, rows = RNG.normal(size=7), RNG.normal(size=m), RNG.normal(size=(m, 7))
    expected = out + factors @ rows
    add_rows(out, factors, rows)
    np.testing.assert_allclose(out, expected, rtol=1e-13)


def test_direct_sums():
    n_block, n_blocks, width = 4, 5, 2
    n = n_block * n_blocks
    pieces = RNG.normal(size=(width, n))
    padded = np.pad(pieces, ((0, 0), (1, 0)))
    weights = RNG.normal(size=(2, n + n_block + 1))
    start_weights = RNG.normal(size=(2, n + n_block + 1))
    start = np.array([[0.0], [0.7]])
    groups = np.array([1, 0])
    unused = np.zeros((1, 0))
    tables = (weights, start_weights, *(unused,) * 6)
    memory = (np.zeros((width, n + 1)), start, unused)
    for b in range(n_blocks):
        lag = np.zeros((width, n_block))
        first = b * n_block
        # u_(first - B - 1) .. u_(first - 1), with u_(-1) = 0
        handed = np.zeros((width, n_block + 1))
        if b:
            handed[:] = padded[:, first - n_block : first + 1]
        exchange_direct(lag, handed, first, groups, tables, memory)
        for c in range(width):
            for i in range(n_block):
                known = pieces[c, : max(0, first - 1)]
                w = weights[groups[c]][first + i - np.arange(known.size)]
                expected = w @ known + start_weights[groups[c], first + i] * start[c, 0]
                assert lag[c, i] == pytest.approx(expected, rel=1e-12, abs=1e-13)


def test_direct_sums_lose_nothing_as_they_grow():
    """A million equal terms: plain summation would be off by a few 1e-12 of the sum."""
    n = 1 << 17
    unused = np.zeros((1, 0))
    memory = (np.full((1, n + 2), 0.1), np.zeros((1, 1)), unused)
    tables = (np.full((1, n + 3), 0.1), np.zeros((1, n + 3)), *(unused,) * 6)
    memory[0][0, 0] = 0.0
    lag = np.zeros((1, 1))
    exchange_direct(lag, np.full((1, 2), 0.1), n, np.array([0]), tables, memory)
    assert lag[0, 0] == pytest.approx((n - 1) * 0.1 * 0.1, rel=2e-16, abs=0)


def test_modes_are_decaying_sums():
    n_block, n_modes = 4, 8
    q = np.linspace(0.1, 1.0, n_modes)
    steps = np.arange(n_block + 1)
    powers = q[:, None] ** steps
    ahead = np.ascontiguousarray(powers[:, :n_block])
    back = np.vstack([powers[:, :n_block].T[::-1], powers[:, n_block]])
    weights, start_weights = RNG.normal(size=(1, n_modes)), RNG.normal(size=(1, n_modes))
    length = 5
    corrections = np.pad(RNG.normal(size=(1, length)), ((0, 0), (2, 0)))
    memory = (np.zeros((1, n_modes)), np.full((1, n_modes), 0.3), np.zeros((1, length)))
    unused = (np.zeros((1, 0)),) * 3
    tables = (weights, start_weights, ahead, np.ascontiguousarray(back), corrections, *unused)
    pieces = RNG.normal(size=3 * n_block)
    absorbed = np.zeros(0)
    for b in range(4):
        lag = np.zeros((1, n_block))
        handed = np.zeros((1, n_block + 1))
        if b:
            handed[0, :n_block] = pieces[(b - 1) * n_block : b * n_block]
            absorbed = pieces[: b * n_block]
        exchange_modes(lag, handed, b * n_block, np.array([0]), tables, memory)
        for i in range(n_block):
            age = absorbed.size - 1 - np.arange(absorbed.size)
            modes = (q[:, None] ** (age + i)) @ absorbed
            expected = weights[0] @ modes + start_weights[0] @ (0.3 * q ** (b * n_block + i))
            lacking = age + 2 + i < length + 2
            expected += corrections[0, (age + 2 + i)[lacking]] @ absorbed[lacking]
            assert lag[0, i] == pytest.approx(expected, rel=1e-11, abs=1e-12)


def test_jacobian_by_differences_and_by_the_user():
    def rhs(t, y, dy, params):
        dy[0] = np.sin(y[0]) * y[1] + t
        dy[1] = params[0] * y[0] ** 2

    def jac(t, y, out, params):
        out[:] = 7.0

    y, params, out = np.array([0.3, 100.0]), np.array([2.0]), np.empty((2, 2))
    plain = getattr(jacobian, "py_func", jacobian)
    plain(rhs, jac, 0, 1.0, y, params, np.ones(2), out)
    exact = [[np.cos(0.3) * 100.0, np.sin(0.3)], [4 * 0.3, 0.0]]
    np.testing.assert_allclose(out, exact, rtol=1e-9, atol=1e-9)
    plain(rhs, jac, 1, 1.0, y, params, np.ones(2), out)
    assert np.all(out == 7.0)
