"""Lyapunov exponents: laws that hold for every stepper, and values known otherwise."""

import signal

import numpy as np
import pytest
from cases import FIRST_ORDER, ORBITS, SECOND_ORDER
from problems import observed_order
from pymittagleffler import mittag_leffler

import hereditary as hd

pytestmark = pytest.mark.rounding

DIRECT = hd.Direct()
HISTORIES = [DIRECT, hd.FFT(), hd.SumOfExponentials()]
EXPLICIT = hd.ExplicitCaputo()
ML = mittag_leffler


def alone(*arguments, **settings):
    """A run without a second one to compare its verdicts with."""
    return hd.lyapunov(*arguments, **settings, verify=False)


@pytest.mark.parametrize("history", HISTORIES, ids=str)
@pytest.mark.parametrize(
    ("scheme", "scene"), ORBITS, ids=lambda v: repr(v) if v in FIRST_ORDER else ""
)
def test_exponents_do_not_depend_on_the_interval(scheme, scene, history):
    """Renormalisation invariance, the property that a forgotten part of the memory breaks."""
    equation = scene()
    found = [
        alone(equation, 20.0, 2000, 2, scheme=scheme, history=history, renorm=renorm).exponents
        for renorm in (0.05, 0.5, 5.0, None)
    ]
    assert np.ptp(found, axis=0).max() < 1e-9


def linear(alpha, rate):
    """D^alpha y = rate y."""
    return hd.scenes.relaxation(alpha, -rate)


@pytest.mark.parametrize(
    ("alpha", "rate", "t", "value"),
    [
        (0.8, -1.0, 10.0, -0.3147037),
        (0.9, -1.0, 20.0, -0.2411859),
        (0.8, -1.0, 100.0, -0.0517640),
        (0.8, 0.5, 20.0, 0.4316051),
        (0.9, 1.0, 10.0, 1.0105360),
    ],
)
@pytest.mark.parametrize("scheme", FIRST_ORDER, ids=repr)
def test_scalar_equations_have_the_mittag_leffler_rate(scheme, alpha, rate, t, value):
    """ln E_alpha(rate t**alpha) / t, to the scheme's order for solutions like t**alpha."""
    exact = float(np.log(ML(rate * t**alpha, alpha=alpha, beta=1.0).real) / t)
    assert exact == pytest.approx(value, abs=6e-8)
    steps = [3200, 12_800]
    errors = [
        abs(alone(linear(alpha, rate), t, n, scheme=scheme).exponents[0] - exact) for n in steps
    ]
    assert errors[-1] < 0.01 * abs(exact)
    assert observed_order(steps, errors) > scheme.order(alpha, "singular") - 0.15


@pytest.mark.parametrize("scheme", SECOND_ORDER, ids=repr)
@pytest.mark.parametrize(("adhesion", "root"), [(2.0, 1.705036), (50.0, 12.69809)])
def test_several_terms_grow_at_the_real_root(scheme, adhesion, root):
    """D^1.8 x + 0.25 D^0.8 x = kappa x: the root of s**1.8 + 0.25 s**0.8 = kappa."""
    kappa = 1.998 * adhesion - 1.0
    assert root**1.8 + 0.25 * root**0.8 == pytest.approx(kappa, rel=1e-6)
    equation = hd.Equation(
        [hd.Caputo(1.8), 0.25 * hd.Caputo(0.8)], lambda t, x, p: p[0] * x, [1.0, 0.0], (kappa,)
    )
    steps = [2000, 4000, 8000]
    slopes = [alone(equation, 40.0 / root, n, scheme=scheme).slope[0] for n in steps]
    errors = np.abs(np.array(slopes) / root - 1)
    assert errors[-1] < {1.0: 3e-3, 1.2: 1e-3, 2.0: 3e-5}[round(scheme.order(1.8), 1)]
    assert observed_order(steps, errors) == pytest.approx(scheme.order(1.8), abs=0.15)


def test_a_spiral_grows_at_the_real_part():
    """Eigenvalues mu = 0.5 +- i: the rate is Re mu**(1/alpha), of both exponents."""

    def spiral(t, y):
        return np.array([0.5 * y[0] - y[1], y[0] + 0.5 * y[1]])

    for alpha, rate in ((0.8, 0.2135776), (0.9, 0.3781742)):
        assert ((0.5 + 1j) ** (1 / alpha)).real == pytest.approx(rate, abs=6e-8)
        equation = hd.Equation(hd.Caputo(alpha), spiral, [1.0, 0.0])
        result = hd.lyapunov(equation, 60.0, 6000, 2, scheme=hd.BDF(2))
        assert result.slope == pytest.approx([rate, rate], rel=3e-3)
        assert result.verdicts == ("exponential growth",) * 2


def test_classical_sum_is_minus_the_friction():
    """The difference scheme's own sum is -ln(1 + friction h) / h, of order 1."""
    sums = []
    for n in (100_000, 200_000):
        result = alone(hd.scenes.stick_slip(beta=2.0, gamma=1.0), 100.0, n, 2, scheme=EXPLICIT)
        h = 100.0 / n
        sums.append(result.exponents.sum())
        assert sums[-1] == pytest.approx(-np.log1p(0.25 * h) / h, abs=3e-6)
        assert result.sum_rule_defect == pytest.approx(sums[-1] + 0.25, abs=1e-12)
    assert 2 * sums[1] - sums[0] == pytest.approx(-0.25, abs=1e-6)
    assert abs(sums[0] + 0.25) == pytest.approx(2 * abs(sums[1] + 0.25), rel=0.02)


def test_lorenz_attractor():
    result = alone(
        hd.scenes.lorenz(), 500.0, 350_000, 3, scheme=hd.L2Sigma(), transient=20.0, window=1.0
    )
    errors = 3 * result.slope_stderr + 0.005
    assert np.all(np.abs(result.exponents - [0.9059, 0.0, -14.5724]) < errors)
    assert np.all(errors < [0.1, 0.1, 0.15])
    assert abs(result.sum_rule_defect) < 1e-3
    assert result.kaplan_yorke == pytest.approx(2.062, abs=0.005)
    assert [str(v) for v in result.verdicts] == [
        "exponential growth", "neutral", "exponential decay"
    ]  # fmt: skip


def test_memory_kept_finds_the_equilibrium_that_restarting_misses():
    """Lorenz, rho = 28, alpha = 0.99: the solution converges (convergence/restarting.py)."""
    equation = hd.scenes.lorenz(alpha=0.99)
    kept = hd.lyapunov(equation, 100.0, 20_000, 3, scheme=hd.Adams(), verify=True)
    assert kept.verdict in ("algebraic decay", "neutral")
    assert kept.verified
    assert kept.slope[0] == pytest.approx(-0.069, abs=0.005)
    assert kept.kaplan_yorke is None
    assert kept.sum_rule_defect is None
    assert np.abs(kept.y - [*np.sqrt([72.0, 72.0]) * np.sign(kept.y[0]), 27.0]).max() < 0.1


def test_the_default_is_of_second_order_and_finds_the_equilibrium_too():
    usual = hd.lyapunov(hd.scenes.lorenz(alpha=0.99), 100.0, 10_000)
    assert usual.settings["scheme"] == hd.Adams()
    assert usual.verdict == "algebraic decay"
    assert usual.verified


def test_a_verdict_that_the_default_scheme_does_not_confirm_falls():
    """With an explicit scheme of first order the same run reports chaos."""
    equation = hd.scenes.lorenz(alpha=0.99)
    first = hd.lyapunov(equation, 100.0, 10_000, scheme=EXPLICIT)
    assert first.exponents[0] > 0.5
    assert first.verdict == "undetermined"
    assert first.verified is False
    assert "'algebraic decay' instead of 'exponential growth'" in first.message
    assert first.check.settings["h"] == 2 * first.settings["h"]
    told = alone(equation, 100.0, 10_000, scheme=EXPLICIT)
    assert told.verdict == "exponential growth"
    assert told.verified is told.check is None


def spring(t, x):
    return -x


USUAL = {
    "one term": (lambda: hd.Equation(hd.Caputo(0.9), spring, 1.0), hd.Adams()),
    "components": (lambda: hd.Equation(hd.Caputo([0.5, 1.0]), spring, [1.0, 0.0]), hd.Adams()),
    "low order": (lambda: hd.Equation(hd.Caputo(0.4), spring, 1.0), hd.BDF(2)),
    "above one": (lambda: hd.Equation(hd.Caputo(1.5), spring, [1.0, 0.0]), hd.BDF(2)),
    "several": (lambda: hd.scenes.stick_slip(), hd.BDF(2)),
    "classical": (lambda: hd.scenes.stick_slip(beta=2.0, gamma=1.0), hd.Adams()),
}


def oscillating(of_x, of_t=lambda t: 0.0):
    def rhs(t, x):
        return np.array([x[1], -x[0] - 0.1 * x[1] - of_x(x[0]) + of_t(t)])

    return hd.Equation(hd.Caputo(0.98), rhs, [1.0, 0.0])


@pytest.mark.parametrize(
    "how", [{"n_steps": 4000}, {"rtol": 1e-4}, {"n_steps": 4000, "mode": "pair"}]
)
def test_a_jump_along_the_orbit_leaves_no_verdict(how):
    equation = oscillating(lambda x: 0.5 * np.sign(x))
    for verify in (None, True, False):
        with pytest.warns(RuntimeWarning, match="jumps between states"):
            found = hd.lyapunov(equation, 20.0, **how, verify=verify)
        assert set(map(str, found.verdicts)) == {"undetermined"}
        assert found.verified is False
        assert "tanh(x / eps)" in found.message


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    ("of_x", "of_t", "how"),
    [
        (np.abs, np.sin, {}),
        (lambda x: np.tanh(x / 0.01), np.sin, {}),
        (lambda x: x**3, lambda t: np.sign(np.sin(t)), {}),
        (np.sign, np.sin, {"mode": "pair", "separation": 1e-2}),
    ],
    ids=["kink", "steep", "in time", "wide pair"],
)
def test_what_is_no_jump_for_tangents_warns_of_none(of_x, of_t, how):
    found = hd.lyapunov(oscillating(of_x, of_t), 20.0, 4000, verify=False, **how)
    assert "jumps" not in found.message


@pytest.mark.parametrize(
    ("how", "scheme"),
    [
        ({"rtol": 1e-6}, hd.Collocation()),
        ({}, hd.Collocation()),
        ({"rtol": 1e-6, "n_steps": 50}, hd.Collocation()),
        ({"n_steps": 50}, hd.Adams()),
    ],
)
def test_steps_are_chosen_as_by_solve(how, scheme):
    found = hd.lyapunov(hd.Equation(hd.Caputo(0.9), spring, 1.0), 1.0, verify=False, **how)
    assert found.settings["scheme"] == scheme


@pytest.mark.parametrize("name", USUAL)
def test_the_default_converges_with_second_order(name):
    """Whatever the terms; L1 and the explicit scheme stand at 1.5 at most."""
    scene, scheme = USUAL[name]
    equation = scene()
    steps = [1000, 2000, 4000]
    runs = [alone(equation, 4.0, n, renorm=0.5) for n in steps]
    assert runs[0].settings["scheme"] == scheme
    finest = alone(equation, 4.0, scheme=hd.Collocation(), rtol=1e-10, renorm=0.5)
    errors = [abs(run.exponents[0] - finest.exponents[0]) for run in runs]
    assert observed_order(steps, errors) > 1.5


def test_other_kernels_are_compared_with_the_implicit_scheme():
    """A weakly damped spiral, which the explicit scheme lets grow at both of two steps."""
    memory = 1e-3 * hd.Memory(hd.TemperedPowerLaw(0.5, 1.0), 1)

    def turning(t, y, p):
        return np.array([p[0] * y[0] - p[1] * y[1], p[1] * y[0] + p[0] * y[1]])

    weakly, strongly = (
        hd.Equation([hd.Caputo(1.0), memory], turning, [1.0, 0.0], p)
        for p in ((-0.02, 10.0), (-0.5, 1.0))
    )
    assert [str(alone(weakly, 20.0, n).verdict) for n in (2000, 4000)] == ["exponential growth"] * 2
    result = hd.lyapunov(weakly, 20.0, 4000)
    assert result.settings["scheme"] == EXPLICIT
    assert result.check.settings["scheme"] == hd.L1()
    assert result.verdict == "undetermined"
    told = hd.lyapunov(strongly, 20.0, 4000)
    assert told.verdict == "algebraic decay"
    assert told.verified


def test_a_second_run_that_fails_leaves_the_verdict_open():
    """Beyond a coarser run's stability limit nothing is confirmed; a finer one is."""
    equation = hd.Equation(hd.Caputo(1.0), lambda t, y: -150.0 * y + 1e-3 * y**3, 1.0)
    result = hd.lyapunov(equation, 10.0, 1000, scheme=hd.Adams())
    assert result.success
    assert result.verdict == "undetermined"
    assert "with twice the step" in result.message
    finer = hd.lyapunov(equation, 10.0, 1000, scheme=hd.Adams(), verify=True)
    assert finer.verdict == "exponential decay"
    assert finer.verified


def test_pair_equals_tangent():
    for scheme, scene in ORBITS:
        arguments = (scene(), 20.0, 2000, 2)
        tangent = alone(*arguments, scheme=scheme)
        pair = alone(*arguments, mode="pair", scheme=scheme)
        assert np.abs(tangent.exponents - pair.exponents).max() < 1e-5


def test_orders_tending_to_one_tend_to_the_classical_exponents():
    """On a limit cycle: a chaotic orbit would amplify the difference.

    The decaying direction is followed as far as exp(-5): at exp(-14) the memory's algebraic tail,
    of size 1e-6, takes over, however close to 1 the order is.
    """
    for scheme in FIRST_ORDER:
        for t_end, k in ((20.0, 1), (5.0, 2)):
            near, at = (
                alone(hd.scenes.van_der_pol(a), t_end, 2000, k, scheme=scheme).exponents
                for a in (1 - 1e-6, 1.0)
            )
            assert 0 < np.abs(near - at).max() < 1e-4


def test_seed_and_directions():
    equation = hd.scenes.lorenz(alpha=0.95)
    first, again, other = (alone(equation, 5.0, 500, seed=seed) for seed in (1, 1, 2))
    assert np.array_equal(first.trace, again.trace)
    assert first.exponents[0] != other.exponents[0]
    e = alone(equation, 5.0, 500, directions=[[2.0], [0.0], [0.0]])
    assert e.settings["seed"] == 0
    assert e.exponents[0] != first.exponents[0]


def test_transient_growth_is_not_counted():
    whole = alone(hd.scenes.lorenz(alpha=0.95), 20.0, 2000, 3, renorm=0.5)
    late = alone(hd.scenes.lorenz(alpha=0.95), 20.0, 2000, 3, renorm=0.5, transient=10.0)
    i = np.searchsorted(whole.times, 10.0)
    expected = (whole.log_growth[-1] - whole.log_growth[i]) / 10.0
    assert np.abs(late.exponents - expected).max() < 1e-10
    assert late.times[0] == pytest.approx(10.5)


@pytest.mark.parametrize(
    "scheme", [s for s in FIRST_ORDER if not isinstance(s, (hd.L12, hd.L2))], ids=repr
)
def test_classical_decay_is_followed_for_ever(scheme):
    """x'' = x - 0.5 x' and x'' = x: a tangent has shrunk by 1e-43 in the end."""
    equation = hd.Equation(
        [hd.Caputo(2.0), 0.5 * hd.Caputo(1.0)], lambda t, x: 1.0 * x, [1.0, 0.0], jac=one
    )
    if isinstance(scheme, (hd.Adams, hd.ProductTrapezoid, hd.L2Sigma)):
        equation = hd.Equation(hd.Caputo(2.0), lambda t, x: 1.0 * x, [1.0, 0.0], jac=one)
    friction = 0.5 if len(equation.terms) == 2 else 0.0
    root = np.sqrt(1 + friction**2 / 4)
    result = alone(equation, 100.0, 20_000, 2, scheme=scheme)
    assert result.slope == pytest.approx([root - friction / 2, -root - friction / 2], abs=0.01)
    assert result.y.shape == (1,)
    if scheme.order(1.0) == 2:
        assert abs(result.sum_rule_defect) < 5e-5


def one(t, x):
    return np.array([[1.0]])


def test_too_long_an_interval_warns():
    arguments = (hd.scenes.lorenz(), 12.0, 6000, 3)
    with pytest.warns(RuntimeWarning, match="shorter renorm"):
        result = alone(*arguments, scheme=hd.L2Sigma(), renorm=2.0)
    assert "shorter renorm" in result.message
    assert "renorm" not in alone(*arguments, scheme=hd.L2Sigma()).message


@pytest.mark.parametrize(
    "scene",
    [
        lambda: hd.scenes.lorenz(alpha=0.98),
        lambda: hd.scenes.stick_slip(beta=1.7, gamma=0.6),
        lambda: hd.scenes.brusselator(alpha=(0.9, 0.7)),
        lambda: hd.scenes.duffing(),
    ],
)
def test_adaptive_collocation_agrees_with_given_steps_whatever_the_interval(scene):
    equation, scheme = scene(), hd.Collocation()
    found = [
        alone(equation, 10.0, k=2, scheme=scheme, rtol=1e-11, renorm=renorm).exponents
        for renorm in (0.1, 5.0, None)
    ]
    # the orbit's own steps end at the renormalisations, which changes it within its tolerance
    assert np.ptp(found, axis=0).max() < 1e-8
    n = 10_000
    fine, finest = (alone(equation, 10.0, i * n, k=2, scheme=hd.BDF(2)).exponents for i in (1, 2))
    distance = np.abs(finest - found[-1]).max()
    assert distance < 1e-3
    assert distance < 0.3 * np.abs(fine - found[-1]).max()


@pytest.mark.parametrize("n_steps", [50, 1000])
def test_the_sum_rule_of_collocation_whatever_times_tangents_are_looked_at(n_steps):
    """Also where steps are shorter than the distance of these times, as the first ones are."""
    result = hd.lyapunov(hd.scenes.lorenz(), 20.0, n_steps, k=3, scheme=hd.Collocation())
    assert abs(result.sum_rule_defect) < 1e-8


def test_adaptive_collocation_follows_decays_and_the_sum_rule():
    equation = hd.Equation(hd.Caputo(2.0), lambda t, x: 1.0 * x, [1.0, 0.0])
    result = alone(equation, 100.0, k=2, scheme=hd.Collocation(), rtol=1e-9)
    assert result.slope == pytest.approx([1.0, -1.0], abs=1e-9)
    assert abs(result.exponents.sum()) < 1e-12
    chaos = alone(hd.scenes.lorenz(), 50.0, k=3, scheme=hd.Collocation(), rtol=1e-8)
    assert abs(chaos.sum_rule_defect) < 1e-8
    assert chaos.exponents.sum() == pytest.approx(-41 / 3, abs=1e-8)


@pytest.mark.parametrize("mode", ["tangent", "pair"])
def test_a_diverging_orbit_is_reported_with_its_record(mode):
    blow = hd.Equation(hd.Caputo(0.9), lambda t, y: y * y, 1.0)
    warned = pytest.warns(hd.SolveWarning, match="stopped being finite")
    with np.errstate(over="ignore"), warned:
        result = hd.lyapunov(blow, 5.0, 5000, mode=mode)
    assert result.status is hd.Status.BLOWN_UP
    assert not result.success
    assert result.verdict == "diverged"
    assert result.times.size > 5
    assert np.all(np.isfinite(result.trace))


def test_too_long_an_interval_is_told():
    equation = hd.Equation(hd.Caputo(1.0), lambda t, y: 100.0 * y, 1.0)
    steady = hd.Equation(
        hd.Caputo(1.0), lambda t, y: np.array([0.0 * y[0], 1000.0 * y[1]]), [1.0, 0.0]
    )
    assert alone(equation, 1.0, 1000).success
    with pytest.warns(hd.SolveWarning, match="shorten renorm"):
        result = alone(steady, 1.0, 10_000, renorm=1.0, directions=[[0.0], [1.0]])
    assert result.status is hd.Status.BLOWN_UP
    assert "shorten renorm" in result.message


@pytest.mark.usefixtures("ctrl_c")
def test_interrupted_run_keeps_its_record():
    equation = hd.scenes.stick_slip()
    previous = signal.signal(signal.SIGALRM, lambda *_: signal.raise_signal(signal.SIGINT))
    signal.setitimer(signal.ITIMER_REAL, 0.3)
    try:
        result = alone(equation, 10_000.0, 20_000_000, scheme=EXPLICIT)
    finally:
        signal.signal(signal.SIGALRM, previous)
    assert result.status is hd.Status.INTERRUPTED
    n = result.stats["n_steps"]
    assert 0 < n < 20_000_000
    n_last = round(result.times[-1] / 5e-4)
    whole = alone(equation, n_last * 5e-4, n_last, scheme=EXPLICIT)
    assert result.exponents[0] == pytest.approx(whole.exponents[0], abs=1e-9)


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"mode": "restart"}, ValueError, "one of 'tangent', 'pair', .*restarting.py cuts"),
        ({"resume": 1}, TypeError, "resume must be left out of lyapunov, .*`trace` has the rates"),
    ],
)
def test_bad_arguments_are_refused(arguments, error, message):
    with pytest.raises(error, match=message):
        hd.lyapunov(hd.scenes.stick_slip(), 20.0, 2000, **arguments)


@pytest.mark.parametrize("how", [{"scheme": hd.BDF(2)}, {"scheme": hd.Collocation(), "rtol": 1e-6}])
def test_the_sum_rule_ends_where_growth_is_known(how):
    """At the last renormalisation before the right-hand side fails."""

    def fails(t, y, p):
        return np.array([-y[0] + 0.0 * p[int(t + 0.2)]])

    equation = hd.Equation(hd.Caputo(1.0), fails, 1.0, params=np.ones(5))
    with pytest.warns(hd.SolveWarning):
        result = hd.lyapunov(equation, 10.0, 1000, renorm=1.0, **how)
    assert result.status == "rhs_failed"
    assert abs(result.sum_rule_defect) < 1e-4


def test_a_pair_ends_where_one_of_its_orbits_does():
    """The second orbit raises first; no growth is noted after that."""

    def f(t, y):
        if y[0] > 1.2:
            raise ValueError("beyond 1.2")
        return np.array([0.4, 0.0])

    equation, first = hd.Equation(hd.Caputo(0.9), f, [1.0, 0.5]), [[1.0], [0.0]]
    how = {"mode": "pair", "separation": 1e-2, "directions": first}
    with pytest.warns(hd.SolveWarning, match="beyond 1.2"):
        result = alone(equation, 3.0, 3000, **how)
    assert result.status is hd.Status.RHS_FAILED
    assert np.abs(result.log_growth).max() < 1e-9


def test_a_jump_is_found_by_few_steps():
    equation = oscillating(lambda x: 0.3 * np.sign(x))
    with pytest.warns(RuntimeWarning, match="jumps between states"):
        result = alone(equation, 8.0, 30)
    assert result.verdict == "undetermined"


def relayed(t, y, p):
    """A linear equation whose rate jumps 2 after p[0]."""
    return (0.7 if t - p[0] < 2.0 else -1.5) * y


BROKEN = [
    {"rtol": 1e-10},
    {"n_steps": 2000, "scheme": hd.BDF(2)},
    {"n_steps": 2000, "scheme": EXPLICIT, "mode": "pair", "separation": 1e-3},
]


@pytest.mark.parametrize("how", BROKEN, ids=str)
def test_a_later_start_and_breaks(how):
    """Tangents of a linear equation are its solution; times count from the start."""
    runs, error = [], 1e-8 if "rtol" in how else 1e-9
    for start in (0.0, 3.0):
        equation = hd.Equation(hd.Caputo(0.8), relayed, 1.0, params=[start], t_start=start)
        end, breaks = start + 10.0, [start + 2.0]
        given = {"breaks": breaks, "transient": 1.0, "directions": [[1.0]], **how}
        runs.append(hd.lyapunov(equation, end, **given))
        steps = {
            name: value for name, value in how.items() if name in ("rtol", "n_steps", "scheme")
        }
        sol = hd.solve(equation, end, breaks=breaks, estimate=False, **steps)
        grown = np.log(np.abs(sol.y[-1, 0] / sol(runs[-1].times[0])[0]))
        found = runs[-1].log_growth
        assert found[-1, 0] - found[0, 0] == pytest.approx(grown, abs=error)
    first, later = runs
    assert first.verified
    assert later.verified
    assert later.times - 3.0 == pytest.approx(first.times, abs=1e-12)
    assert later.log_growth == pytest.approx(first.log_growth, abs=1e-7)
    assert later.settings["t_end"] == 13.0
