"""Tables of mode factors that one march leaves to the next."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

import hereditary as hd
from hereditary.collocation.kept_tables import KeptTables, kept_tables
from hereditary.compiled.structures import ExponentialBasis


def basis(rates, weights=(), masses=()):
    """Modes with one fractional integral, and general kernels of these weights and masses."""
    rates = np.array(rates)
    held = np.array([np.ones(rates.size), *weights])
    return ExponentialBasis(rates, held, np.array(masses), np.zeros((4, 4, 4)))


def test_a_table_is_one_march_s_at_a_time():
    kept, modes = KeptTables(), basis([1.0, 2.0])
    first, second = kept.take(modes, 4, 0), kept.take(modes, 4, 0)
    assert first[1] is not second[1]
    kept.give_back(first)
    assert kept.take(modes, 4, 0)[1] is first[1]
    assert kept.take(modes, 4, 0)[1] is not first[1]


def test_a_table_serves_the_same_modes_and_nodes_alone():
    kept = KeptTables()
    kernel = [[0.5, 0.5]], [0.25]
    taken = kept.take(basis([1.0, 2.0], *kernel), 4, 0)
    kept.give_back(taken)
    others = [
        (basis([1.0, 3.0], *kernel), 4, 0),
        (basis([1.0, 2.0], [[0.5, 0.6]], [0.25]), 4, 0),
        (basis([1.0, 2.0], [[0.5, 0.5]], [0.5]), 4, 0),
        (basis([1.0, 2.0], *kernel), 5, 0),
        (basis([1.0, 2.0]), 4, 0),
        (basis([1.0, 2.0], *kernel), 4, 1),
    ]
    for other in others:
        assert kept.take(*other)[1] is not taken[1]
    same = kept.take(basis([1.0, 2.0], *kernel), 4, 0)
    assert same[1] is taken[1]
    assert same[1].local.shape == (64, 1, 4, 4)


def test_few_tables_are_kept():
    kept = KeptTables()
    taken = [kept.take(basis([rate]), 4, 0) for rate in range(1, 40)]
    for one in taken:
        kept.give_back(one)
    again = [kept.take(basis([rate]), 4, 0)[1] for rate in range(1, 40)]
    assert sum(a is b for a, (_, b) in zip(again, taken, strict=True)) == 8


@given(st.floats(0.2, 0.95), st.floats(1.0, 30.0))
def test_runs_do_not_depend_on_what_is_kept(order, t_end):
    """Bit for bit: with tables of no length yet, with those of other runs, and from threads."""
    eq = hd.Equation(hd.Caputo(order), lambda t, y: np.cos(t) - y, 1.0)

    def rows(end=t_end):
        return hd.solve(eq, end, rtol=1e-6).y

    kept_tables.__init__()
    fresh = rows()
    rows(0.7 * t_end)
    assert np.array_equal(rows(), fresh)
    with ThreadPoolExecutor(4) as pool:
        assert all(np.array_equal(found, fresh) for found in pool.map(lambda _: rows(), range(8)))
