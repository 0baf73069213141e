"""Implicit-explicit steps: the constant matrix implicitly, the rest explicitly."""

import pickle

import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import given
from hypothesis import strategies as st
from problems import linear_and_rest
from solver.runs import at_end, errors_of

import hereditary as hd

INNER = [hd.L1(), hd.BDF(1), hd.BDF(2)]


@pytest.mark.parametrize(
    ("scheme", "alpha", "kind", "largest"),
    [
        (hd.L1(), 0.5, "smooth", 8e-6), (hd.L1(), 0.5, "singular", 9e-5),
        (hd.L1(), 0.8, "smooth", 1.2e-4), (hd.L1(), 1.5, "smooth", 1e-5),
        (hd.BDF(1), 0.5, "singular", 9e-5), (hd.BDF(1), 0.8, "smooth", 6e-4),
        (hd.BDF(2), 0.3, "singular", 9.5e-5), (hd.BDF(2), 0.5, "singular", 1.7e-6),
        (hd.BDF(2), 0.5, "smooth", 1e-6), (hd.BDF(2), 0.8, "singular", 3e-7),
        (hd.BDF(2), 1.5, "singular", 9e-7),
    ],
)  # fmt: skip
def test_orders(scheme, alpha, kind, largest):
    powers = [3.0] if kind == "smooth" else [alpha, 2 * alpha]
    equation, exact = linear_and_rest(alpha, powers)
    imex = hd.IMEX(scheme)
    runs = [hd.solve(equation, 1.0, n, scheme=imex) for n in (1600, 3200)]
    errors = [np.abs(run.y[-1] - exact).max() for run in runs]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(imex.order(alpha, kind), abs=0.15)
    assert largest / 3 < errors[1] < largest
    assert runs[1].stats["n_rhs"] == 3200
    assert runs[1].stats["n_factorised"] == 1


def chain(d):
    return sp.diags_array([1.0, -2.0, 1.0], offsets=[-1, 0, 1], shape=(d, d)) * 30.0


@pytest.mark.parametrize("history", [hd.Direct(), hd.FFT(), hd.SumOfExponentials()], ids=repr)
@pytest.mark.parametrize("scheme", INNER, ids=repr)
@given(alpha=st.floats(0.1, 1.9), d=st.sampled_from([1, 7, 23]), dense=st.booleans())
def test_the_scheme_itself_where_all_is_implicit(scheme, history, alpha, d, dense):
    matrix = chain(d).toarray() if dense else chain(d)
    start = np.cos(np.arange(d))
    equation = hd.Equation(
        hd.Caputo(alpha), None, start if alpha <= 1 else [start, -start], linear=matrix
    )
    ends = [
        hd.solve(equation, 1.0, 70, scheme=each, history=history).y[-1]
        for each in (scheme, hd.IMEX(scheme))
    ]
    np.testing.assert_allclose(*ends, rtol=0, atol=1e-11)


def reaction(t, u, du, p):
    for i in range(u.size):
        du[i] = 5.0 * (u[i] - u[i] ** 3) + np.sin(t + i)


@pytest.mark.parametrize("terms", [hd.Caputo(0.7), hd.Caputo(1.6) + 0.3 * hd.Caputo(0.6)])
def test_every_form_of_the_matrix_gives_one_solution(terms):
    d, found = 25, []
    order = np.random.default_rng(1).permutation(d)
    start = np.cos(np.arange(d))
    y0 = [start, 0 * start] if len(terms._terms()) > 1 else start
    swapped = sp.eye_array(d).tocsr()[order]  # an entry far from the diagonal: SuperLU
    for matrix in (chain(d), chain(d).toarray(), chain(d) + 1e-13 * (swapped + swapped.T)):
        equation = hd.Equation(terms, reaction, y0, linear=matrix)
        found.append(hd.solve(equation, 2.0, 300, scheme=hd.IMEX(hd.BDF(2))).y[-1])
    np.testing.assert_allclose(found[1], found[0], rtol=0, atol=1e-10)
    np.testing.assert_allclose(found[2], found[0], rtol=0, atol=1e-10)


def test_graded_meshes_restore_the_order_of_l1():
    equation, exact = linear_and_rest(0.5, [0.5, 1.0])
    meshes, scheme = [hd.graded(n, 2.0) for n in (800, 1600)], hd.IMEX(hd.L1())
    runs = [hd.solve(equation, 1.0, mesh=mesh, scheme=scheme) for mesh in meshes]
    assert [run.stats["n_factorised"] for run in runs] == [800, 1600]
    errors = [np.abs(run.y[-1] - exact).max() for run in runs]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(1.5, abs=0.15)
    assert 3e-6 < errors[1] < 1e-5


def pushed(order, at, force):
    """A force that sets in at a time."""
    rhs = lambda t, y: np.where(t < at, 0.0, force) * np.ones(1)  # noqa: E731
    return hd.Equation(hd.Caputo(order), rhs, [0.0], linear=[[-1.0]])


def test_a_jump_is_seen_from_behind_it():
    equation, how = pushed(0.8, 0.3, 1.0), {"breaks": [0.3]}
    truth = hd.solve(equation, 1.0, rtol=1e-10, **how).y[-1]
    how |= {"scheme": hd.IMEX(hd.BDF(2))}
    errors = errors_of(at_end, truth, (1000, 2000), equation, 1.0, **how)
    assert errors[1] < 5e-4
    assert errors[1] < 0.6 * errors[0]


def test_a_break_is_not_extrapolated_over():
    equation, imex = pushed(0.2, 0.5, 10.0), hd.IMEX(hd.BDF(2))
    runs = [hd.solve(equation, 1.0, 100, scheme=s, breaks=[0.5]) for s in (imex, hd.BDF(2))]
    np.testing.assert_allclose(runs[0].y, runs[1].y, atol=1e-12)
    half = hd.solve(equation, 0.5, 50, scheme=imex)
    rest = hd.solve(equation, 1.0, resume=pickle.loads(pickle.dumps(half.state)), breaks=[0.5])
    assert np.array_equal(rest.y[-1], runs[0].y[-1])


def test_beyond_its_limit_a_run_says_so():
    equation = hd.Equation(hd.Caputo(0.9), lambda t, y: -100.0 * y, [1.0], linear=[[-1.0]])
    with pytest.warns(hd.SolveWarning):
        run = hd.solve(equation, 10.0, 100, scheme=hd.IMEX(hd.BDF(2)))
    assert not run.success


def diagonals(t, y, p):
    return np.array([[0.0, p[0]], [0.0, 0.0], [-1.0, 0.0]])


def test_few_components_compile_nothing_for_another_matrix():
    """Matrices are numbers that functions read: each run took 0.15 s to compile its own."""

    def compiled(scale):
        matrix = scale * np.array([[-2.0, 1.0], [1.0, -2.0]])
        given = {"params": [scale], "linear": matrix, "bandwidth": (1, 1), "jac": diagonals}
        system = hd.Equation(
            hd.Caputo(0.7), lambda t, y, p: np.array([p[0] * y[1], -y[0]]), [1.0, 0.0], **given
        ).system
        return [one.functions.code for one in (system, hd.IMEX(hd.L1()).reduction(system))]

    assert all(first == second for first, second in zip(*map(compiled, (1.0, 2.0)), strict=True))


def test_a_singular_matrix_is_named_and_a_blow_up_is_none():
    """Implicit Euler steps of 1/2 solve y' = 2 y with the matrix 1 - 1/2 * 2 = 0."""

    for rate, status in ((2.0, hd.Status.NOT_SOLVED), (-2.0, hd.Status.BLOWN_UP)):
        equation = hd.Equation(hd.Caputo(1.0), lambda t, y: y**2, [20.0], linear=[[rate]])
        with pytest.warns(hd.SolveWarning):
            run = hd.solve(equation, 20.0, 40, scheme=hd.IMEX(hd.L1()))
        assert run.status is status
        assert ("the matrix of a step is singular" in run.message) == (rate == 2.0)
