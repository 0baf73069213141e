"""The step limit is sharp, and what happens beyond it is seen: zigzags, growth, divergence."""

import math
import warnings

import numpy as np
import pytest

import hereditary as hd

SCHEME, POWER_SERIES = hd.ExplicitCaputo(), hd.GrunwaldLetnikov()
EXPLICIT = [SCHEME, POWER_SERIES]
SETS = [
    (2.0, 1.0, 0.0),
    (2.0, 1.0, 0.25),
    (1.95, 0.2, 2.0),
    (1.8, 0.8, 0.25),
    (1.5, 0.5, 0.5),
    (1.2, 0.3, 0.1),
    (1.05, 0.9, 1.0),
]
OMEGA = 10.0


def oscillator(beta, gamma, friction):
    return hd.scenes.oscillator(beta, gamma, friction, omega=OMEGA, x0=1.0, v0=0.0)


def solve_at(scheme, share, beta, gamma, friction, n=20_000):
    """A run whose stiffness is `share` of the limit at its step."""
    h = scheme.step_limit(oscillator(beta, gamma, friction), OMEGA**2)
    equation = hd.scenes.oscillator(beta, gamma, friction, omega=OMEGA * math.sqrt(share))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        sol = hd.solve(equation, n * h, n, scheme=scheme)
    return sol, [str(w.message) for w in caught if w.category is hd.StabilityWarning]


@pytest.mark.parametrize("scheme", EXPLICIT, ids=repr)
@pytest.mark.parametrize(("beta", "gamma", "friction"), SETS)
def test_the_limit_parts_bounded_runs_from_zigzags(scheme, beta, gamma, friction):
    sol, caught = solve_at(scheme, 0.99, beta, gamma, friction)
    assert sol.success
    assert not caught
    assert np.abs(sol.y).max() < 12  # the undamped one at 0.99 swings to 1 / sqrt(1 - 0.99) = 10
    sol, caught = solve_at(scheme, 1.02, beta, gamma, friction)
    assert not sol.success
    assert len(caught) == 1
    assert "zigzag" in caught[0]
    signs = np.sign(np.diff(sol.y[-100:, 0]))
    assert np.all(signs[1:] == -signs[:-1])


@pytest.mark.parametrize("scheme", EXPLICIT, ids=repr)
def test_limit_is_the_closed_form(scheme):
    assert scheme.step_limit(oscillator(2.0, 1.0, 0.0), OMEGA**2) == pytest.approx(2 / OMEGA)
    decay = hd.scenes.relaxation(alpha=1.0, rate=5.0)
    assert scheme.step_limit(decay, 5.0) == pytest.approx(2 / 5.0)


@pytest.mark.parametrize("alpha", [0.05, 0.3, 0.8, 1.3, 1.9])
def test_limit_of_the_power_series(alpha):
    """K h**alpha = 2**alpha, sharp to half a per cent; and of two components the smaller limit."""
    y0 = 1.0 if alpha <= 1 else [1.0, 0.0]
    for share, stable in ((0.995, True), (1.005, False)):
        equation = hd.Equation(hd.Caputo(alpha), decaying, y0, (share * 2**alpha,))
        limit = POWER_SERIES.step_limit(equation, share * 2**alpha)
        assert limit == pytest.approx(share ** (-1 / alpha))
        sol, found = warned_of(equation, 20_000.0, 20_000, scheme=POWER_SERIES)
        assert found != stable
        assert (np.abs(sol.y).max() < 15) == stable
    both = hd.Equation(hd.Caputo([0.9, 0.5]), lambda t, y: -y, [1.0, 1.0])
    assert POWER_SERIES.step_limit(both, 4.0) == pytest.approx(2 / 4.0**2)


# Stiffness that saturates: beyond the limit the orbit zigzags and stays bounded.
SATURATING = [
    (hd.Caputo(1.8) + 0.25 * hd.Caputo(0.8), lambda t, y: -100.0 * np.tanh(y) + np.sin(t), 100.0),
    (hd.Caputo(0.9), lambda t, y: -50.0 * np.arctan(y), 50.0),
]


@pytest.mark.parametrize("scheme", EXPLICIT, ids=repr)
@pytest.mark.parametrize(("terms", "force", "stiffness"), SATURATING)
def test_bounded_zigzag_is_seen_where_no_overflow_comes(scheme, terms, force, stiffness):
    y0 = [0.2, 0.0] if stiffness == 100.0 else 1.0
    equation = hd.Equation(terms, force, y0)
    h = scheme.step_limit(equation, stiffness)
    with pytest.warns(hd.StabilityWarning, match="zigzag"):
        sol = hd.solve(equation, 5000 * 1.1 * h, 5000, scheme=scheme)
    assert sol.status is hd.Status.ZIGZAG
    assert np.abs(sol.y).max() < 10
    assert "take smaller steps" in sol.message
    assert hd.solve(equation, 5000 * 0.8 * h, 5000, scheme=scheme).success


@pytest.mark.parametrize("scheme", [*EXPLICIT, hd.Adams()], ids=repr)
@pytest.mark.parametrize("order", [0.5, 0.9])
def test_other_schemes_are_named(scheme, order):
    equation = hd.scenes.relaxation(alpha=order, rate=20.0)
    with pytest.warns(hd.StabilityWarning, match=r"rtol=1e-6, or BDF\(2\)$"):
        hd.solve(equation, 10.0, 100, scheme=scheme)


def test_many_components_are_told_of_their_jacobian():
    equation = hd.Equation(hd.Caputo(0.5), lambda t, y: -100.0 * y, np.ones(12))
    with pytest.warns(hd.StabilityWarning, match=r"BDF\(2\), with linear= or bandwidth= for 12"):
        hd.solve(equation, 1.0, 10)


def test_passing_the_limit_on_the_way_warns():
    passing = lambda t, y: -(3000.0 if 0.5 < t < 0.6 else 1.0) * y  # noqa: E731
    with pytest.warns(hd.StabilityWarning, match="had grown"):
        sol = hd.solve(hd.Equation(hd.Caputo(1.0), passing, 1e-3), 1.0, 1000)
    assert sol.status is hd.Status.STEP_TOO_LARGE
    assert not sol.success


def test_resting_and_constant_solutions_are_no_zigzag():
    assert hd.solve(hd.scenes.oscillator(x0=0.0, v0=0.0), 100.0, 10_000).success
    assert hd.solve(hd.scenes.oscillator(2.0, 1.0, 1.0), 200.0, 20_000).success


@pytest.mark.parametrize("user_jacobian", [True, False])
def test_stiff_component_of_a_system(user_jacobian):
    matrix = np.array([[-1.0, 0.5], [0.3, -40.0]])
    jac = (lambda t, y: matrix) if user_jacobian else None
    equation = hd.Equation(hd.Caputo(1.0), lambda t, y: matrix @ y, [1.0, 1.0], jac=jac)
    largest = np.abs(np.linalg.eigvals(matrix)).max()
    for share, stable in ((0.99, True), (1.02, False)):
        assert warned_of(equation, 2000 * share * 2 / largest, 2000)[1] != stable


@pytest.mark.parametrize("scheme", EXPLICIT, ids=repr)
@pytest.mark.parametrize(("order", "n_steps"), [(1.0, 100), (0.95, 100), (0.8, 100)])
def test_stiff_spirals_are_seen(scheme, order, n_steps):
    """Eigenvalues -1 +- 100 i at h = 0.01: a real limit of 200 would not notice."""

    def spiral(t, y):
        return np.array([-y[0] + 100 * y[1], -100 * y[0] - y[1]])

    equation = hd.Equation(hd.Caputo(order), spiral, [1.0, 0.0])
    with pytest.warns(hd.StabilityWarning, match="had grown"):
        sol = hd.solve(equation, 1.0, n_steps, scheme=scheme)
    assert not sol.success
    finer = {"save_every": 1000, "estimate": False}
    assert hd.solve(equation, 1.0, 200 * n_steps, scheme=scheme, **finer).success


@pytest.mark.parametrize(("order", "limit"), [(1.6, 9.32), (2.0, 12.0)])
def test_limits_of_the_product_trapezoid_are_sharp_and_watched(order, limit):
    """A force that saturates: beyond the limit the orbit is bounded and wrong."""
    for share, fine in ((0.98, True), (1.1, False)):
        rate = share * limit  # h = 1
        equation = hd.Equation(hd.Caputo(order), saturating, [1e-3, 0.0], (rate,))
        sol, found = warned_of(equation, 4000.0, 4000, scheme=hd.ProductTrapezoid())
        assert found != fine, (share, sol.message)
        assert (np.abs(sol.y).max() < 2e-3) == fine


def saturating(t, y, p):
    return -p[0] * np.tanh(y)


def decaying(t, y, p):
    return -p[0] * y


def warned_of(equation, *arguments, **options):
    """The run and whether it warned of its step."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        sol = hd.solve(equation, *arguments, **options)
    found = any(w.category is hd.StabilityWarning for w in caught)
    assert found != sol.success
    return sol, found


# Largest K h**alpha / Gamma(alpha + 2) of stable steps, by order and number of corrections.
LIMITS_OF_SWEEPS = {
    (0.3, 1): 1.0, (0.8, 1): 1.0, (1.2, 1): 0.9553, (1.5, 1): 0.7637, (1.9, 1): 0.3507,
    (0.3, 2): 0.9038, (0.8, 2): 0.7785, (1.2, 2): 0.7058, (1.5, 2): 0.6679, (1.9, 2): 0.6416,
    (0.3, 4): 0.9399, (0.8, 4): 0.8531, (1.2, 4): 0.7967, (1.5, 4): 0.7647, (1.9, 4): 0.7413,
}  # fmt: skip


@pytest.mark.parametrize(("order", "corrections"), LIMITS_OF_SWEEPS)
@pytest.mark.parametrize("force", [decaying, saturating])
def test_adams_is_watched_with_any_sweeps_and_orders(corrections, order, force):
    limit = LIMITS_OF_SWEEPS[order, corrections] * math.gamma(order + 2)  # h = 1
    y0 = 1e-3 if order <= 1 else [1e-3, 0.0]
    for share in (0.98, 1.5):
        equation = hd.Equation(hd.Caputo(order), force, y0, (share * limit,))
        scheme = hd.Adams(corrections=corrections)
        sol, found = warned_of(equation, 1000.0, 1000, scheme=scheme)
        assert found == (share > 1), sol.message
        assert (np.abs(sol.y).max() > 2e-3) == (share > 1)


@pytest.mark.parametrize("scheme", [*EXPLICIT, hd.Adams(corrections=2)])
@pytest.mark.parametrize("n_stiff", [10, 0])
def test_stiffness_of_a_few_steps_is_seen(scheme, n_stiff):
    """Ten steps of 1,000."""

    def pulse(t, y, p):
        return -(p[0] if 0.5005 < t < 0.5005 + p[1] else 1.0) * y

    equation = hd.Equation(hd.Caputo(0.5), pulse, 1.0, (2000.0, n_stiff / 1000))
    sol, found = warned_of(equation, 1.0, 1000, scheme=scheme)
    assert found == (n_stiff > 0)
    assert (np.abs(sol.y).max() > 1e3) == (n_stiff > 0)


@pytest.mark.parametrize("scheme", [*EXPLICIT, hd.Adams(corrections=2)])
def test_cycles_of_a_force_that_saturates_are_seen(scheme):
    """From far out: the orbit need not turn at every step."""
    if scheme in EXPLICIT:
        unit = hd.Equation(hd.Caputo(1.7), saturating, [-20.0, 0.0], (1.0,))
        limit = scheme.step_limit(unit, 1.0) ** 1.7
    else:
        limit = 0.6511 * math.gamma(3.7)
    for share in (0.9, 1.2):
        rate = share * limit  # h = 1
        equation = hd.Equation(hd.Caputo(1.7), saturating, [-20.0, 0.0], (rate,))
        sol, found = warned_of(equation, 3000.0, 3000, scheme=scheme)
        assert found == (share > 1), sol.message
        assert (np.abs(sol.y[-50:]).max() > 0.5) == (share > 1)


def test_slow_spirals_that_grow_are_seen():
    """1 + h mu = 0.99 + 0.3 i: each step grows by 3 per cent, of a solution that decays."""
    equation = hd.Equation(
        hd.Caputo(1.0),
        lambda t, y: np.array([-0.1 * y[0] + 3 * y[1], -3 * y[0] - 0.1 * y[1]]),
        [1.0, 0.0],
    )
    sol, found = warned_of(equation, 100.0, 1000)
    assert found
    assert "a few steps had grown" in sol.message
    assert not warned_of(equation, 100.0, 100_000, save_every=1000)[1]


@pytest.mark.parametrize("scheme", [*EXPLICIT, hd.Adams()])
def test_what_is_no_instability(scheme):
    """Growth, jumps of the force, chaos, beats, and increments that are hardly floats."""

    for force, y0, t_end, n in (
        (lambda t, y: 3.0 * y, 1e-6, 5.0, 1000),
        (lambda t, y: -100.0 * y + 1e4 * np.floor(5 * t), 1e-6, 5.0, 2000),
        (lambda t, y: np.sin(10 * t) + np.sin(10.5 * t), 0.0, 50.0, 5000),
    ):
        sol, found = warned_of(hd.Equation(hd.Caputo(0.8), force, y0), t_end, n, scheme=scheme)
        assert not found, sol.message
    assert not warned_of(hd.scenes.lorenz(), 30.0, 6000, scheme=scheme)[1]
    tiny = hd.Equation(hd.Caputo(1.0), decaying, 5e-324, (1.5,))
    assert not warned_of(tiny, 1000.0, 1000, scheme=scheme)[1]
