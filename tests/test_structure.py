"""Large systems: bands, patterns and constant matrices give the numbers of dense Jacobians."""

import pickle

import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import given, settings
from hypothesis import strategies as st
from problems import laplacian, plane

import hereditary as hd
from hereditary.exact import mittag_leffler

D = 30


def force(t, u, du, p):
    du[:] = 50.0 * np.sin(3 * t) * u - 30.0 * u**3


def reaction(t, u, du, p):
    force(t, u, du, p)
    n = u.size
    for i in range(n):
        left, right = u[i - 1] if i > 0 else 0.0, u[i + 1] if i < n - 1 else 0.0
        du[i] += (left - 2 * u[i] + right) * (n + 1.0) ** 2


def slope(t, u):
    return 50.0 * np.sin(3 * t) - 90.0 * u**2


def packed(t, u, ab, p):
    ab[0] = ab[2] = (u.size + 1.0) ** 2
    ab[0, 0] = ab[2, -1] = 0.0
    ab[1] = slope(t, u) - 2 * (u.size + 1.0) ** 2


def dense(t, u):
    n = u.size
    beside = np.eye(n, k=1) + np.eye(n, k=-1) - 2 * np.eye(n)
    return (n + 1.0) ** 2 * beside + np.diag(slope(t, u))


def matrix(t, u):
    """As SciPy's users write it."""
    return laplacian(u.size) + sp.diags_array(slope(t, u))


def data(t, u, values, p):
    """Values of the pattern of `laplacian`, in CSR order."""
    values[:] = (u.size + 1.0) ** 2
    values[::3] = slope(t, u) - 2 * (u.size + 1.0) ** 2


def diagonal(t, u, ab, p):
    ab[0] = slope(t, u)


def start(d):
    places = np.arange(1, d + 1) / (d + 1)
    return np.sin(np.pi * places) + np.sin(3 * np.pi * places)


def statements(d):
    """Ways of stating the reaction, by name."""
    a = laplacian(d)
    return {
        "band": {"rhs": reaction, "bandwidth": (1, 1)},
        "wider band": {"rhs": reaction, "bandwidth": (2, 3)},
        "band and jac": {"rhs": reaction, "bandwidth": (1, 1), "jac": packed},
        "pattern": {"rhs": reaction, "jac_sparsity": a},
        "pattern, dense": {"rhs": reaction, "jac_sparsity": a.toarray() != 0},
        "pattern and jac": {"rhs": reaction, "jac_sparsity": a, "jac": data},
        "pattern and matrices": {"rhs": reaction, "jac_sparsity": a, "jac": matrix},
        "linear": {"rhs": force, "linear": a},
        "linear and band": {"rhs": force, "linear": a, "bandwidth": (0, 0)},
        "linear, band and jac": {"rhs": force, "linear": a, "bandwidth": (0, 0), "jac": diagonal},
        "dense linear": {"rhs": force, "linear": a.toarray(), "bandwidth": (0, 0)},
    }


@pytest.mark.parametrize("d", [5, D])
@pytest.mark.parametrize("name", statements(D))
def test_every_statement_gives_the_numbers_of_dense_jacobians(name, d):
    eq = hd.Equation(hd.Caputo(0.8), reaction, start(d), jac=dense)
    same = hd.Equation(hd.Caputo(0.8), y0=start(d), **statements(d)[name])
    expected = hd.solve(eq, 1.0, 100, scheme=hd.BDF(2))
    found = hd.solve(same, 1.0, 100, scheme=hd.BDF(2))
    assert np.abs(found.y - expected.y).max() < 1e-12
    how = {"scheme": hd.BDF(2), "verify": False}
    exponents = [hd.lyapunov(each, 1.0, 100, **how).exponents for each in (same, eq)]
    np.testing.assert_allclose(*exponents, rtol=1e-6)
    jacobian = eq.jacobian(0.3, start(d))
    assert np.abs(same.jacobian(0.3, start(d)) - jacobian).max() < 1e-8 * np.abs(jacobian).max()
    again = pickle.loads(pickle.dumps(same))
    assert np.array_equal(hd.solve(again, 1.0, 100, scheme=hd.BDF(2)).y, found.y)


def by_time(t, y):
    out = np.zeros_like(y)
    out[0] = np.sin(t) * y.size
    return out


def by_time_in_place(t, y, dy, params):
    dy[:] = np.sin(t) * len(y)


@pytest.mark.parametrize("dense", [False, True])
@pytest.mark.parametrize(
    ("rhs", "alone"),
    [
        (by_time, True),
        (by_time_in_place, True),
        (lambda t, y: np.full_like(y, y[0]) + np.sin(t), False),
        (lambda t, y: by_time(t, y), False),
    ],
)
def test_a_force_that_reads_no_y_leaves_the_matrix_its_entries(rhs, alone, dense):
    a = laplacian(D).toarray() if dense else laplacian(D)
    eq = hd.Equation(hd.Caputo(0.8), rhs, start(D), linear=a)
    assert (eq.system.structure is not None) == alone
    if alone:
        found, expected = (
            hd.solve(each, 1.0, rtol=1e-6).y for each in (eq, eq.replace(bandwidth=(0, 0)))
        )
        assert np.array_equal(found, expected)


@pytest.mark.parametrize("scheme", [hd.BDF(2), hd.L1(), hd.L2Sigma()], ids=repr)
@pytest.mark.parametrize("m", [4, 40])
def test_a_mode_of_the_plane_is_a_single_equation(scheme, m):
    """A wide pattern goes to SuperLU (m = 40), and a narrow one to LAPACK: an eigenvector stays."""
    waves = np.sin(np.pi * np.arange(1, m + 1) / (m + 1))
    mode, rate = np.outer(waves, waves).ravel(), 8 * (m + 1) ** 2 * np.sin(np.pi / (2 * m + 2)) ** 2
    eq = hd.Equation(hd.Caputo(0.7), None, mode, linear=plane(m))
    single = hd.Equation(hd.Caputo(0.7), lambda t, y, p: -p[0] * y, 1.0, params=[rate])
    expected = hd.solve(single, 1.0, 100, scheme=scheme).y
    sol = hd.solve(eq, 1.0, 100, scheme=scheme)
    assert np.abs(sol.y - expected * mode).max() < 1e-12
    assert sol.stats["n_factorised"] <= 3
    half = hd.solve(eq, 0.5, 50, scheme=scheme)
    assert np.array_equal(hd.solve(eq, 1.0, resume=half.state).y, sol.y[50:])


def ring(t, u, du, p):
    """Neighbours on a ring, the last beside the first."""
    n = u.size
    for i in range(n):
        du[i] = 100.0 * (u[i - 1] - 2 * u[i] + u[(i + 1) % n]) - u[i] ** 3


def test_components_are_put_in_the_order_of_a_narrow_band():
    d = 200
    pattern = sp.diags_array(np.ones((3, d)), offsets=[-1, 0, 1], shape=(d, d)).tolil()
    pattern[0, d - 1] = pattern[d - 1, 0] = 1.0
    eq = hd.Equation(hd.Caputo(0.8), ring, start(d), jac_sparsity=pattern.tocsr())
    assert eq.system.structure.band.lower + eq.system.structure.band.upper <= 4
    expected = hd.solve(eq.replace(jac_sparsity=None), 1.0, 50, scheme=hd.BDF(2)).y
    assert np.abs(hd.solve(eq, 1.0, 50, scheme=hd.BDF(2)).y - expected).max() < 1e-12


def times(t, y, p):
    return p.reshape(y.size, y.size) @ y


@settings(max_examples=30)
@given(st.integers(11, 40), st.integers(0, 2**32 - 1), st.floats(0.01, 0.3))
def test_differences_by_groups_are_those_of_every_column(d, seed, density):
    random = np.random.default_rng(seed)
    a = sp.random_array((d, d), density=density, rng=random, format="csr")
    eq = hd.Equation(hd.Caputo(0.5), times, np.ones(d), a.toarray().ravel(), jac_sparsity=a)
    assert np.abs(eq.jacobian(0.0, random.normal(size=d)) - a).max() < 1e-9


def test_a_matrix_that_is_singular_ends_the_run_with_its_reason():
    """Where scale and lead meet an eigenvalue the step has no solution."""
    m, h = 40, 0.1
    scale = 1 / (h**0.5 * 0.886226925452758)  # of L1 at order 0.5, 1 / Gamma(1.5) h**-0.5
    for linear in (scale * sp.eye_array(D), scale * sp.eye_array(m * m) + 0 * plane(m)):
        eq = hd.Equation(hd.Caputo(0.5), None, np.ones(linear.shape[0]), linear=linear.tocsr())
        with pytest.warns(hd.SolveWarning):
            sol = hd.solve(eq, 1.0, 10, scheme=hd.L1())
        assert sol.status in (hd.Status.NOT_SOLVED, hd.Status.BLOWN_UP)


@pytest.mark.parametrize(("stiffness", "largest"), [(1e8, 2e-6), (1e11, 2e-6), (1e13, 1e-4)])
def test_steps_are_solved_as_far_as_rounding_of_f_allows(stiffness, largest):
    """Pairs that stay together by springs so stiff that f rounds to more than Newton's goal."""
    pair = stiffness * np.array([[-1.0, 1.0], [1.0, -1.0]]) - np.eye(2)
    y0 = np.linspace(1, 2, 8).repeat(2)
    eq = hd.Equation(hd.Caputo(0.7), None, y0, linear=sp.block_diag([pair] * 8).tocsr())
    sol = hd.solve(eq, 1.0, 400, scheme=hd.BDF(2))
    assert sol.success
    assert np.abs(sol.y[-1] - y0 * mittag_leffler(-1.0, 0.7, 1.0)).max() < largest


def test_linear_steps_take_one_iteration_and_as_many_as_they_need():
    eq = hd.Equation(hd.Caputo(0.7), None, start(D), linear=laplacian(D))
    sol = hd.solve(eq, 1.0, 200, scheme=hd.BDF(2))
    assert sol.stats["n_factorised"] == 1
    assert sol.stats["n_rhs"] <= 210
    iterated = eq.replace(rhs=lambda t, u: 0.0 * u, bandwidth=(0, 0))
    again = hd.solve(iterated, 1.0, 200, scheme=hd.BDF(2))
    assert again.stats["n_rhs"] > 400
    np.testing.assert_allclose(sol.y, again.y, rtol=0, atol=1e-13)
    for scheme in (hd.L12(), hd.L2Sigma()):  # whose first step has another matrix
        ends = [hd.solve(each, 1.0, 100, scheme=scheme).y[-1] for each in (eq, iterated)]
        np.testing.assert_allclose(*ends, rtol=0, atol=1e-13)


@pytest.mark.parametrize("scheme", [hd.BDF(2), hd.L1(), hd.IMEX(hd.BDF(2))], ids=repr)
def test_another_matrix_is_factorised_where_a_run_goes_on(scheme):
    ends = []
    for d in (5, 12):
        eq, other = (
            hd.Equation(hd.Caputo(0.7), None, np.ones(d), linear=-k * np.eye(d)) for k in (1, 1e3)
        )
        half = hd.solve(eq, 1.0, 100, scheme=scheme).state
        run = hd.solve(other, 2.0, resume=half, allow_change=True)
        ends.append(run.y[-1][0])
        assert run.success
    assert ends[1] == pytest.approx(ends[0], rel=1e-12)


def test_states_go_on_with_other_statements():
    """Factors of another pattern are no longer in force; those of the same one are."""
    d = 14
    ways = {name: statements(d)[name] for name in ("band", "wider band", "band and jac", "pattern")}
    ways["dense"] = {"rhs": reaction}
    equations = {name: hd.Equation(hd.Caputo(0.8), y0=start(d), **ways[name]) for name in ways}
    expected = hd.solve(equations["dense"], 1.0, 100, scheme=hd.BDF(2)).y[50:]
    for first in equations.values():
        state = hd.solve(first, 0.5, 50, scheme=hd.BDF(2)).state
        for second in equations.values():
            found = hd.solve(second, 1.0, resume=state)
            assert found.success
            assert np.abs(found.y - expected).max() < 1e-12
    stated = {"linear": laplacian(d), "bandwidth": (0, 0), "jac": diagonal}
    begun = hd.solve(
        hd.Equation(hd.Caputo(0.8), force, start(d), **stated), 0.5, 50, scheme=hd.L1()
    )
    other = hd.Equation(hd.Caputo(0.8), force, start(d), **(stated | {"linear": 2 * laplacian(d)}))
    assert hd.solve(other, 1.0, resume=begun.state, allow_change=True).success


def pinned(t, x):
    """Masses in a row of springs, each with a soft one of its own."""
    out = -7.0 * x - x**3
    out[1:] += 4.0 * x[:-1]
    out[:-1] += 4.0 * x[1:]
    return out


def pinned_band(t, x, ab, p):
    ab[0] = ab[2] = 4.0
    ab[1] = -7.0 - 3 * x**2


def test_classical_exponents_take_bands():
    d = 12
    terms = hd.Caputo(2.0) + 0.5 * hd.Caputo(1.0)
    y0 = [5.0 * np.sin(np.arange(1.0, d + 1)), np.zeros(d)]
    eq = hd.Equation(terms, pinned, y0)
    expected = hd.lyapunov(eq, 10.0, 400, verify=False).exponents
    for more in ({}, {"jac": pinned_band}):
        found = hd.lyapunov(eq.replace(bandwidth=(1, 1), **more), 10.0, 400, verify=False)
        assert np.abs(found.exponents - expected).max() < 1e-8


@pytest.mark.parametrize("kind", [sp.coo_array, sp.csc_array, sp.csr_array, sp.lil_array])
def test_values_stand_in_the_order_of_the_pattern(kind):
    pattern = kind(laplacian(D))
    found = pattern.tocoo() if kind is not sp.lil_array else pattern.tocsr().tocoo()
    rows, columns = found.row, found.col

    def values(t, u):
        return np.array([dense(t, u)[i, j] for i, j in zip(rows, columns, strict=True)])

    eq = hd.Equation(hd.Caputo(0.8), reaction, start(D), jac_sparsity=pattern, jac=values)
    assert np.abs(eq.jacobian(0.3, start(D)) - dense(0.3, start(D))).max() == 0.0


@pytest.mark.parametrize("d", [3, 14])
def test_patterns_may_be_empty(d):
    given = {"jac_sparsity": np.zeros((d, d)), "jac": lambda t, u: np.zeros(0)}
    many = hd.Equation(hd.Caputo(0.8), lambda t, u: np.cos(t) + 0 * u, np.zeros(d), **given)
    one = hd.Equation(hd.Caputo(0.8), lambda t, u: np.cos(t), 0.0)
    found, exact = (hd.solve(eq, 1.0, 50, scheme=hd.L1()).y for eq in (many, one))
    assert np.abs(found - exact).max() < 1e-14
