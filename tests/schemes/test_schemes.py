"""Every scheme by every history: exact on its monomials, and of its order from both sides."""

import numpy as np
import pytest
from problems import errors, errors_on_mesh, observed_order, singular_problem, smooth_problem
from scipy.special import rgamma

import hereditary as hd

HISTORIES = [hd.Direct(), hd.FFT(), hd.SumOfExponentials(1e-13)]


# Powers of t on which a scheme is exact at an order alpha, and the next on which it is not.
def rest(alpha):
    return ((0,), 1) if alpha <= 1 else ((0, 1), 2)


def lines(alpha):
    return (0, 1), 2


def parabolas(alpha):
    return ((0, 1, 2), 3) if alpha <= 1 else ((0, 1), 2)


def forces(alpha):
    """Return the powers for constant and linear forces."""
    return (0, alpha, 1 + alpha), 2 + alpha


# Scheme, monomials, and the last errors for smooth and singular solutions at each order alpha, as
# measured; a third more is allowed.
ROWS = [
    (hd.ExplicitCaputo(), rest, {
        0.1: (2.0e-3, 4.4e-6), 0.3: (2.1e-3, 1.6e-5), 0.5: (2.3e-3, 3.4e-5), 0.8: (2.3e-3, 7.2e-5),
        0.95: (1.8e-3, 8.7e-5), 1.2: (1.5e-3, 3.5e-5), 1.5: (1.5e-3, 7.4e-5), 1.8: (1.3e-3, 2.5e-4),
        1.95: (5.1e-4, 3.2e-4),
    }),
    (hd.GrunwaldLetnikov(), rest, {
        0.1: (1.9e-3, 4.4e-6), 0.3: (1.8e-3, 1.6e-5), 0.5: (1.7e-3, 3.0e-5), 0.8: (1.5e-3, 5.9e-5),
        0.95: (1.4e-3, 7.8e-5), 1.2: (1.2e-3, 7.7e-5), 1.5: (7.9e-4, 1.3e-4), 1.8: (3.4e-4, 1.9e-4),
        1.95: (8.7e-5, 2.6e-4),
    }),
    (hd.L12(), lines, {
        0.1: (4.0e-10, 3.2e-6), 0.3: (4.0e-9, 8.4e-6), 0.5: (2.6e-8, 1.2e-5), 0.8: (3.6e-7, 9.7e-6),
        0.95: (1.3e-6, 3.4e-6),
    }),
    (hd.BDF(1), rest, {
        0.1: (9.9e-5, 4.0e-6), 0.3: (3.2e-4, 1.3e-5), 0.5: (5.8e-4, 2.3e-5), 0.8: (1.0e-3, 5.0e-5),
        0.95: (1.3e-3, 7.5e-5), 1.2: (1.8e-3, 8.7e-5), 1.5: (2.4e-3, 1.6e-4), 1.8: (3.0e-3, 1.3e-4),
        1.95: (3.4e-3, 2.4e-5),
    }),
    (hd.BDF(2), rest, {
        0.1: (1.6e-7, 1.0e-9), 0.3: (5.0e-7, 3.3e-9), 0.5: (8.8e-7, 6.3e-9), 0.8: (1.5e-6, 1.4e-8),
        0.95: (1.9e-6, 2.0e-8), 1.2: (2.5e-6, 3.7e-9), 1.5: (3.5e-6, 6.9e-8), 1.8: (4.5e-6, 2.2e-7),
        1.95: (4.7e-6, 2.8e-7),
    }),
    (hd.BDF(3), rest, {
        0.1: (3.6e-9, 5.9e-10), 0.3: (1.1e-8, 1.9e-9), 0.5: (2.0e-8, 3.4e-9), 0.8: (3.6e-8, 6.0e-9),
        0.95: (4.4e-8, 5.4e-9),
    }),
    (hd.L1(), lines, {
        0.1: (5.5e-7, 3.9e-6), 0.3: (4.9e-6, 1.2e-5), 0.5: (2.7e-5, 2.0e-5), 0.8: (3.0e-4, 3.7e-5),
        0.95: (9.6e-4, 6.5e-5), 1.2: (5.3e-8, 1.2e-9), 1.5: (3.7e-5, 2.1e-6), 1.8: (4.0e-4, 9.3e-6),
        1.95: (1.2e-3, 6.4e-5),
    }),
    (hd.L2(), parabolas, {
        0.1: (1.2e-10, 3.2e-6), 0.3: (1.4e-9, 8.4e-6), 0.5: (1.7e-8, 1.2e-5), 0.8: (3.4e-7, 9.7e-6),
        0.95: (1.3e-6, 3.4e-6),
    }),
    (hd.L2Sigma(), parabolas, {
        0.1: (1.1e-7, 2.9e-6), 0.3: (2.8e-7, 6.6e-6), 0.5: (4.0e-7, 7.7e-6), 0.8: (5.2e-7, 4.7e-6),
        0.95: (6.2e-7, 1.4e-6), 1.2: (3.4e-7, 1.8e-5), 1.5: (4.4e-7, 2.0e-5), 1.8: (4.6e-7, 1.5e-5),
        1.95: (4.6e-7, 4.7e-6),
    }),
    (hd.Adams(corrections=1), forces, {
        0.1: (1.0e-3, 1.8e-6), 0.3: (4.2e-5, 8.9e-7), 0.5: (2.9e-6, 2.4e-7), 0.8: (5.1e-7, 2.6e-8),
        0.95: (5.0e-7, 1.1e-8), 1.2: (8.3e-9, 2.2e-11), 1.5: (5.8e-7, 1.4e-8),
        1.8: (5.3e-7, 3.4e-8), 1.95: (2.4e-7, 4.2e-8),
    }),
    (hd.Adams(corrections=3), forces, {
        0.1: (2.0e-4, 1.7e-6), 0.3: (9.4e-7, 8.5e-7), 0.5: (4.4e-7, 2.3e-7), 0.8: (4.7e-7, 2.6e-8),
        0.95: (4.9e-7, 1.1e-8),
    }),
    (hd.ProductTrapezoid(), forces, {
        0.1: (2.4e-7, 1.7e-6), 0.3: (3.9e-7, 8.5e-7), 0.5: (4.4e-7, 2.3e-7), 0.8: (4.7e-7, 2.6e-8),
        0.95: (4.9e-7, 1.1e-8), 1.2: (8.3e-9, 2.2e-11), 1.5: (5.8e-7, 1.4e-8),
        1.8: (5.3e-7, 3.4e-8), 1.95: (2.4e-7, 4.2e-8),
    }),
]  # fmt: skip
CASES = [(*row[:2], alpha, *both) for row in ROWS for alpha, both in row[2].items()]
# Where the proven order shows late: a term of nearly the same order goes with it.
LATE = {("L1()", 1.2), ("ProductTrapezoid()", 1.2), ("Adams(corrections=1)", 1.2)}


def error_on(k, scheme, alpha, history, **steps):
    """Return the largest error of t**k, whose derivative is the force.

    The first step of L2 is solved with a line: there the force for t**2 is the line's derivative.
    """
    given = k == 0 or (k == 1 and alpha > 1)  # by the initial values
    params = (0.0, 0.0) if given else (rgamma(k + 1 - alpha) / rgamma(k + 1), k - alpha)
    first = 1.5 * steps["mesh"][1] if "mesh" in steps else 1.5 / 40
    bent = scheme == hd.L2() and k == 2
    params += (first, rgamma(2 - alpha)) if bent else (0.0, params[0])
    y0 = [float(k == 0), float(k == 1)][: 1 + (alpha > 1)]
    equation = hd.Equation(
        hd.Caputo(alpha), lambda t, y, p: (p[0] if t > p[2] else p[3]) * t ** p[1], y0, params
    )
    sol = hd.solve(equation, 1.0, scheme=scheme, history=history, **(steps or {"n_steps": 40}))
    return np.abs(sol.y[:, 0] - sol.t**k).max()


@pytest.mark.parametrize(
    ("scheme", "powers", "alpha"),
    [c[:3] for c in CASES],
    ids=lambda v: getattr(v, "__name__", str(v)),
)
def test_exact_on_its_monomials_and_not_on_the_next(scheme, powers, alpha):
    exact, beyond = powers(alpha)
    for history in HISTORIES:
        assert error_on(0, scheme, alpha, history) == 0.0
        for k in exact:
            assert error_on(k, scheme, alpha, history) < 1e-13, (k, history)
        assert error_on(beyond, scheme, alpha, history) > 1e-7, history


MESHES = [np.linspace(0, 1, 41) ** 2, np.append(0, np.sort(np.random.default_rng(2).random(40)))]
MESHES[1] /= MESHES[1][-1]


ON_MESHES = [
    (scheme, alpha)
    for scheme in (hd.L1(), hd.L2(), hd.L2Sigma())
    for alpha in (0.1, 0.5, 0.95, 1.2, 1.8)
    if alpha <= min(scheme.meshes_up_to, scheme.orders[1])
]


@pytest.mark.parametrize("history", [HISTORIES[0], HISTORIES[2]], ids=repr)
@pytest.mark.parametrize("mesh", MESHES, ids=["graded", "irregular"])
@pytest.mark.parametrize(("scheme", "alpha"), ON_MESHES, ids=repr)
def test_exact_on_its_monomials_on_any_mesh(scheme, alpha, mesh, history):
    """Where neighbouring steps differ much, parabolas give way to lines."""
    exact, beyond = (lines if scheme == hd.L1() else parabolas)(alpha)
    for k in exact[: None if mesh is MESHES[0] else 2]:
        assert error_on(k, scheme, alpha, history, mesh=mesh) < 1e-12, k
    assert error_on(beyond, scheme, alpha, history, mesh=mesh) > 1e-7


def graded_rows():
    """Yield problem, scheme, grading, steps, and order and largest error over all times there."""
    for scheme in (hd.L1(), hd.L2(), hd.L2Sigma()):
        for alpha in (0.3, 0.5, 0.8, 0.95):
            order = scheme.order(alpha, "smooth")
            bound = 2e-4 * 4 ** (2 - order)
            yield singular_problem(alpha), scheme, order / alpha, 250, order, bound
        yield singular_problem(0.5), scheme, 1.0, 2000, 0.5, 1e-2  # the start limits it
        yield smooth_problem(0.5), scheme, 1.5, 200, scheme.order(0.5, "smooth"), 1e-3
    for scheme in (hd.L2(), hd.L2Sigma()):  # moments in closed form would lose digits here
        yield singular_problem(0.3), scheme, 9.0, 500, scheme.order(0.3, "smooth"), 1e-4
    for beta, bound in ((1.2, 1e-6), (1.5, 3e-5), (1.8, 4e-4)):
        yield singular_problem(beta), hd.L1(), 3.0, 400, 3 - beta, bound
        yield singular_problem(beta), hd.L2Sigma(), 4 / beta, 200, 2.0, 5e-6


@pytest.mark.parametrize(
    ("problem", "scheme", "grading", "n", "order", "bound"),
    list(graded_rows()),
    ids=lambda v: getattr(v, "name", str(v)),
)
def test_order_on_graded_meshes(problem, scheme, grading, n, order, bound):
    steps = [n, 2 * n, 4 * n]
    found = [errors_on_mesh(problem, scheme, HISTORIES[2], hd.graded(k, grading)) for k in steps]
    assert observed_order(steps, found) == pytest.approx(order, abs=0.15)
    assert found[-1] < bound


@pytest.mark.parametrize(("alpha", "grading"), [(0.02, 40.0), (0.05, 20.0), (0.1, 29.0)])
@pytest.mark.parametrize("scheme", [hd.L1(), hd.L2(), hd.L2Sigma()], ids=repr)
def test_the_steepest_meshes_give_no_garbage(scheme, alpha, grading):
    """Neighbouring steps differ by 2**grading there: parabolas over that ratio would amplify."""
    problem, mesh = singular_problem(alpha), hd.graded(1000, grading)
    direct, modes = (
        hd.solve(problem.equation(), 2.0, mesh=mesh, scheme=scheme, history=history)
        for history in HISTORIES[::2]
    )
    assert np.abs(direct.y - problem.exact(direct.t)).max() < 1e-3
    assert np.abs(modes.y - direct.y).max() < 1e-11


@pytest.mark.parametrize("history", HISTORIES, ids=repr)
@pytest.mark.parametrize("smoothness", ["smooth", "singular"])
@pytest.mark.parametrize(
    ("scheme", "alpha", "smooth", "singular"), [c[:1] + c[2:] for c in CASES], ids=str
)
def test_order(scheme, alpha, smooth, singular, smoothness, history):
    """Of 1 + t**3 over all times; of relaxation and oscillation, y ~ t**alpha, at a fixed time."""
    if smoothness == "smooth":
        problem, steps, bound, where = smooth_problem(alpha), [200, 400, 800], smooth, 1
    else:
        problem, steps, bound, where = singular_problem(alpha), [800, 1600, 3200], singular, 0
    if scheme == hd.BDF(3):
        steps = [80, 160, 320]
    elif (repr(scheme), alpha) in LATE:
        steps = [8 * n for n in steps]
    found = [errors(problem, scheme, history, n)[where] for n in steps]
    order = scheme.order(alpha, smoothness)
    assert observed_order(steps, found) == pytest.approx(order, abs=0.15), found
    assert np.all(np.diff(found) < 0)
    assert found[-1] < bound * 4 / 3
