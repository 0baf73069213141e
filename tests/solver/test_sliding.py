"""Sliding along switches: the right-hand side is a blend of both sides there."""

import warnings

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.special import gamma
from solver.runs import completed, event, warned

import hereditary as hd

C = hd.Caputo
BELT = 0.2


def block(t, y, p):
    """A block on a belt: x' = v, v' = -x + friction; p: factor of weakening, 1 if it weakens."""
    relative = BELT - y[1]
    size = 1.0 / (1.0 + p[0] * abs(relative))
    return np.array([y[1], -y[0] + (size if relative > 0 else -size)])


def slips(t, y):
    return BELT - y[1]


def by_pieces(weakening, t_end):
    """Times at which the block of order 1 sticks and slips, and its end, by SciPy."""
    y, t, sticks, times = np.array([0.0, BELT]), 0.0, True, []
    while t < t_end:
        if sticks:
            wait = min((1.0 - y[0]) / BELT, t_end - t)
            y, t = np.array([y[0] + BELT * wait, BELT]), t + wait
        else:
            stops = lambda t, y: BELT - y[1]  # noqa: E731
            stops.terminal, stops.direction = True, -1
            slip = lambda t, y: np.array(  # noqa: E731
                [y[1], -y[0] + 1.0 / (1.0 + weakening * (BELT - y[1]))]
            )
            start = y - [0.0, 1e-11]  # it begins at rest
            sol = solve_ivp(slip, (t, t_end), start, "DOP853", events=stops, rtol=1e-12, atol=1e-13)
            y, t = sol.y[:, -1], sol.t[-1]
        sticks = not sticks
        times.append(t)
    return np.array(times[:-1]), y


@pytest.mark.parametrize("rtol", [1e-4, 1e-6, 1e-7])
@pytest.mark.parametrize("weakening", [0.0, 1.5])
def test_a_block_on_a_belt_is_that_of_pieces(weakening, rtol):
    equation = hd.Equation(C([1.0, 1.0]), block, [0.0, BELT], params=[weakening])
    sol = completed(equation, 30.0, rtol=rtol, switches=slips)
    times, end = by_pieces(weakening, 30.0)
    assert np.abs(sol.y[-1] - end).max() < 20 * rtol
    if weakening:
        found = np.array([slide[1:] for slide in sol.stats["slides"]]).ravel()[1:]
        assert found[: times.size] == pytest.approx(times, abs=2 * rtol**0.5)


def set_valued(force, order, mu, t_end, n):
    """D^order y = force(t) - mu Sign(y), y(0) = 0, by L1 whose last value is in the set."""
    h = t_end / n
    k = np.arange(n + 1.0)
    b = (k[1:] ** (1 - order) - k[:-1] ** (1 - order)) / gamma(2 - order) * h**-order
    y = np.zeros(n + 1)
    for m in range(1, n + 1):
        past = b[1:m][::-1] @ np.diff(y[:m]) if m > 1 else 0.0
        free = (force(m * h) - past) / b[0] + y[m - 1]
        y[m] = np.sign(free) * max(abs(free) - mu / b[0], 0.0)
    return y


def pushed(t, y, p):
    return 1.5 * np.sin(t) - p[0] * np.sign(y)


@pytest.mark.parametrize("order", [0.5, 0.8])
def test_a_fractional_relay_is_that_of_a_set_valued_scheme(order):
    equation = hd.Equation(C(order), pushed, 0.0, params=[0.7])
    sol = completed(equation, 12.0, rtol=1e-6, switches=lambda t, y: y[0])
    assert len(sol.stats["slides"]) >= 3
    errors = []
    for n in (1000, 4000):
        y = set_valued(lambda t: 1.5 * np.sin(t), order, 0.7, 12.0, n)
        errors.append(np.abs(sol(np.linspace(0.0, 12.0, n + 1))[:, 0] - y).max())
    assert errors[1] < 1e-3
    assert errors[1] < errors[0] / 2.5


@pytest.mark.parametrize("order", [0.6, 0.9, 1.0])
def test_a_controller_keeps_its_plant_on_the_surface(order):
    """On y[1] = -2 y[0] the plant is D^order y[0] = -2 y[0], whatever disturbs it."""

    def plant(t, y):
        disturbed = np.sin(3 * y[0]) + 0.5 * np.cos(2 * t)
        return np.array([y[1], disturbed - 4.0 * np.sign(y[1] + 2.0 * y[0])])

    equation = hd.Equation(C([order, order]), plant, [1.0, -2.0])
    sol = completed(equation, 5.0, rtol=1e-6, switches=lambda t, y: y[1] + 2.0 * y[0])
    t = np.linspace(0.1, 5.0, 20)
    exact = hd.exact.relaxation(order, 2.0)(t)[:, 0]
    assert np.abs(sol(t)[:, 0] - exact).max() < 3e-6
    assert sol.stats["slides"] == [(0, 0.0, 5.0)]


def test_a_thermostat_that_chatters_is_kept_at_its_level():
    room = hd.Equation(C(0.9), lambda t, y: (3.0 if y[0] < 1.0 else 0.0) - y + 0.5 * np.sin(t), 0.0)
    sol = completed(room, 20.0, rtol=1e-6, switches=lambda t, y: y[0] - 1.0)
    ((_, begin, end),) = sol.stats["slides"]
    assert end == 20.0
    assert np.abs(sol.y[sol.t >= begin] - 1.0).max() < 2e-6


def test_a_mass_between_two_surfaces():
    """Coulomb friction of either plate; it is carried by the plates where both hold it."""

    def between(t, y):
        one = 1.0 if y[1] < 0.3 else -1.0
        other = 0.6 if y[1] < -0.1 else -0.6
        return np.array([y[1], 1.3 * np.sin(t) + one + other])

    equation = hd.Equation(C(1), between, [0.0, 0.0])
    switches = [lambda t, y: y[1] - 0.3, lambda t, y: y[1] + 0.1]
    loose, tight = (completed(equation, 20.0, rtol=r, switches=switches) for r in (1e-5, 1e-7))
    assert [slide[0] for slide in tight.stats["slides"]] == [0, 1, 0, 1, 0, 1, 0]
    t = np.linspace(0.0, 20.0, 100)
    assert np.abs(loose(t) - tight(t)).max() < 3e-5


def test_friction_that_depends_on_the_past():
    """The friction is stronger, the longer ago it slipped."""

    def late_friction(t, y, late):
        size = 0.4 + 0.2 * late[0, 0] ** 2
        return np.array([y[1], -y[0] + np.cos(0.7 * t) - size * np.sign(y[1])])

    equation = hd.Equation(C([1.0, 0.8]), late_friction, [1.0, 0.3], memory=hd.Delay(0.5))
    switches = lambda t, y: y[1]  # noqa: E731
    loose, tight = (completed(equation, 20.0, rtol=r, switches=switches) for r in (1e-5, 1e-7))
    assert len(tight.stats["slides"]) >= 3
    t = np.linspace(0.0, 20.0, 100)
    assert np.abs(loose(t) - tight(t)).max() < 2e-5


def two_blocks(t, y, p):
    pull = 0.5 * (y[1] - y[0])
    force = np.array([-y[0] + pull, -y[1] - pull])
    relative = BELT - y[2:]
    return np.concatenate((y[2:], force + p * np.sign(relative) / (1 + np.abs(relative))))


def test_two_blocks_stick_together_and_alone():
    equation = hd.Equation(
        C([1.0, 1.0, 0.9, 0.9]), two_blocks, [0.0, 0.1, 0.0, 0.0], params=[0.6, 0.9]
    )
    switches = [lambda t, y: BELT - y[2], lambda t, y: BELT - y[3]]
    loose, tight = (completed(equation, 20.0, rtol=r, switches=switches) for r in (1e-5, 1e-7))
    assert {slide[0] for slide in tight.stats["slides"]} == {0, 1}
    t = np.linspace(0.0, 20.0, 100)
    assert np.abs(loose(t) - tight(t)).max() < 5e-5


def test_seven_slides_at_once_are_told():
    """f would be called for each of 128 combinations of sides."""
    equation = hd.Equation(C([1.0] * 7), lambda t, y: -np.sign(y), 1.0 + 0.1 * np.arange(7))
    level = [event(lambda t, y, k=k: y[k]) for k in range(7)]
    sol = warned("slides along a switch.*and 6 others", equation, 3.0, rtol=1e-6, switches=level)
    assert sol.t[-1] == pytest.approx(1.6, abs=1e-6)


def test_members_of_an_ensemble_slide_too():
    equation = hd.Equation(C([1.0, 0.9]), block, [0.0, BELT], params=[1.5])
    members = hd.ensemble(equation, 10.0, params=[[0.5], [1.5]], rtol=1e-6, switches=slips)
    for k, weakening in enumerate((0.5, 1.5)):
        alone = completed(equation.replace(params=[weakening]), 10.0, rtol=1e-6, switches=slips)
        np.testing.assert_allclose(members.y[k, -1], alone.y[-1], atol=1e-9)


def test_a_slide_goes_on_from_a_state_and_ends_by_a_change():
    equation = hd.Equation(C([1.0, 0.9]), block, [0.0, BELT], params=[1.5])
    whole = completed(equation, 12.0, rtol=1e-7, switches=slips)
    half = completed(equation, 3.0, rtol=1e-7, switches=slips)
    rest = completed(equation, 12.0, resume=half.state, switches=slips)
    assert np.abs(rest.y[-1] - whole.y[-1]).max() < 2e-6
    kicked = completed(
        equation, 12.0, rtol=1e-7, switches=slips, changes={2.0: lambda t, y: y - [0.0, 0.5]}
    )
    assert kicked.stats["slides"][0] == pytest.approx((0, 0.0, 2.0), abs=1e-9)


def test_two_surfaces_that_meet_end_as_sliding_or_stay():
    """The twisting controller reaches 0 at t = 3.95."""

    def twisted(t, y):
        return np.array([y[1], -2 * np.sign(y[0]) - 1.2 * np.sign(y[1])])

    switches = [lambda t, y: y[0], lambda t, y: y[1]]
    equation = hd.Equation(C(1), twisted, [1.0, 0.0])
    for rtol in (1e-3, 1e-5, 1e-7):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", hd.SolveWarning)
            sol = hd.solve(equation, 20.0, rtol=rtol, switches=switches)
        assert sol.status in (hd.Status.COMPLETED, hd.Status.SLIDING)
        assert sol.t[-1] > 3.9
        assert np.abs(sol.y[-1]).max() < 100 * rtol


def test_a_block_among_ten_components_sticks_and_slips_as_alone():
    def among(t, y):
        relative, out = BELT - y[1], -y.copy()
        out[0] = y[1]
        out[1] = -y[0] + np.sign(relative) / (1 + 1.5 * abs(relative))
        return out

    alone = hd.Equation(C(1), block, [0.0, BELT], params=[1.5])
    one = completed(alone, 30.0, rtol=1e-6, switches=slips)
    ten = completed(hd.Equation(C(1), among, BELT * np.eye(10)[1]), 30.0, switches=slips)
    assert np.abs(ten.y[-1, :2] - one.y[-1]).max() < 5e-6
    assert one.check().largest.max() < 2e-5
    band = hd.Equation(C(1), among, BELT * np.eye(10)[1], bandwidth=(1, 1))
    warned("followed without bandwidth=", band, 5.0, rtol=1e-6, switches=slips)
