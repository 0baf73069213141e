"""A small draw of the campaign, and whether its exact solutions and its judge deserve belief.

The campaign itself is convergence/campaign.py.
"""

from dataclasses import replace

import numpy as np
import pytest
from _campaign_kinds import problem
from _campaign_verdicts import OK, TRUE, WRONG, judged
from _laplace_truth import Force, Truth, second_opinion

from hereditary import exact


def single(alpha, rate, start=(1.0, 0.0), forces=()):
    rows = np.array([[start[0]], [start[1] * (alpha > 1)]])
    return Truth(np.array([[alpha]]), np.ones((1, 1)), np.array([[-rate]]), rows, forces)


@pytest.mark.parametrize("alpha", [0.01, 0.5, 1 - 1e-9, 1.0, 1 + 1e-9, 1.5, 2 - 1e-6, 2.0])
def test_truth_is_the_mittag_leffler_solution(alpha):
    t = np.concatenate([[0.0, 1e-300], np.geomspace(1e-9, 20.0, 40)])
    truth = single(alpha, 3.0, (1.0, -0.5))
    right = exact.relaxation(alpha, 3.0, truth.start[: 1 + (alpha > 1)])
    assert np.abs(truth(t) - right(t)).max() < 1e-11


def test_truth_of_a_jordan_block_at_order_1():
    """y = exp(-t) (y0 + N t y0 + N^2 t^2 / 2 y0), in coordinates that are turned."""
    n = np.diag([1.0, 2.0], 1)
    turned = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    y0, t = np.array([1.0, -2.0, 0.5]), np.linspace(0.0, 5.0, 20)
    matrix = turned @ (n - np.eye(3)) @ turned.T
    rows = np.array([y0, np.zeros(3)])
    truth = Truth(np.ones((1, 3)), np.ones((1, 3)), matrix, rows)
    series = [np.linalg.matrix_power(n, k) / (1, 1, 2)[k] for k in range(3)]
    grown = np.array([sum(s**k * series[k] for k in range(3)) for s in t])
    right = np.exp(-t)[:, None] * (grown @ (turned.T @ y0) @ turned.T)
    assert np.abs(truth(t) - right).max() < 1e-13


@pytest.mark.parametrize("derivative", [0, 1])
def test_truth_of_coupled_orders_agrees_with_more_digits(derivative):
    """Other orders in each component, forced by a power and by a jump: two ways to invert."""
    matrix, rows = np.array([[-1.0, 2.0], [-1.5, -0.5]]), np.array([[1.0, 0.3], [-0.4, 0.0]])
    forces = [Force(0.0, 1.5, (1.0, 0.0)), Force(2.0, 0.0, (0.0, -3.0))]
    truth = Truth(np.array([[1.7, 0.4]]), np.ones((1, 2)), matrix, rows, forces)
    for t in (1e-8, 2.5, 9.0):
        value = truth(np.array([t]), derivative)[0]
        above = [0] if derivative else [0, 1]
        off = np.abs(value - second_opinion(truth, t, derivative))[above]
        assert np.all(off < 1e-13 * (1 + np.abs(value[above])))


def test_problems_are_functions_of_seed_and_number():
    for k in range(6):
        assert problem(3, k).code() == problem(3, k).code()
    assert problem(3, 0).code() != problem(4, 0).code()


def test_the_judge_sees_an_error_beyond_the_tolerance_and_none_within():
    """Two-sided: a run held against a solution three tolerances away, and against its own."""
    one = replace(problem(0, 9), truth=single(0.5, 2.0), t_end=3.0, rtol=1e-6)
    assert judged(one)["verdict"] == OK
    off = single(0.5, 2.0, (1 + 3e-6, 0.0))
    moved = type("Moved", (type(one),), {"solve": lambda self: one.solve()})
    other = moved(**{**one.__dict__, "truth": off})
    row = judged(other)
    assert row["verdict"] == WRONG
    assert 2.5 < row["ratio"] < 3.5


def test_truth_of_a_pair_has_all_of_its_poles():
    """Above order 1 an eigenvalue far from the positive axis has two, one of each turn."""
    matrix, rows = np.array([[-3.0, 0.5], [-0.5, -3.0]]), np.array([[1.0, 0.2], [-0.7, 2.0]])
    truth = Truth(np.full((1, 2), 1.85), np.ones((1, 2)), matrix, rows)
    assert len(truth.poles) == 4
    for t in (0.3, 2.0, 10.0):
        off = np.abs(truth(np.array([t]))[0] - second_opinion(truth, t))
        assert off.max() < 1e-14


# Seed and number of problems that were at fault once, and what they are to be judged now.
ONCE_AT_FAULT = [
    (0, 384, OK),  # y next to t = 0: a tiny order beside orders just above 1
    (0, 313, OK),  # y' there
    (1, 493, OK),  # y there, between the nodes of a tiny order and those of t
    (2, 44, OK),  # y' at t = 0, as the basis shows it
    (0, 188, TRUE),  # a set of rates that could not be prolonged
    (0, 136, TRUE),  # a relay at zero told as blown up
    (1, 456, OK),  # y' that may err absolutely by as much as y, for a million units of time
    (3, 36, OK),  # a jump between the start of a step and its first node
    (13, 5057, OK),  # a Jacobian differenced across a jump
    (14, 715, TRUE),  # a first step that errs by what is much later on, told as a jump
]


@pytest.mark.parametrize(("seed", "k", "verdict"), ONCE_AT_FAULT)
def test_problems_once_at_fault(seed, k, verdict):
    assert judged(problem(seed, k))["verdict"] == verdict
