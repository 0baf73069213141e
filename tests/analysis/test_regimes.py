"""Regimes: right on orbits that are known, and not surer than what was seen allows."""

import dataclasses
import math

import numpy as np
import pytest

import hereditary as hd
from hereditary import Regime, classify

PERIOD = 2 * math.pi


def run(t_end, n_steps, *, exponent=True, **parameters):
    """Verdict on a stick-slip orbit, by collocation or with given steps."""
    equation = hd.scenes.stick_slip(**parameters)
    with_steps = {"n_steps": n_steps} if n_steps else {"rtol": 1e-8}
    solution = hd.solve(equation, t_end, **with_steps, save_every=10 if n_steps else 1)
    scheme = None if n_steps else hd.Collocation()
    exponents = hd.lyapunov(equation, t_end, **with_steps, scheme=scheme) if exponent else None
    speed = parameters.get("spring_speed", 1.0)
    return classify(solution, exponents, period=PERIOD / speed if speed else math.inf)


CLASSICAL = {"beta": 2.0, "gamma": 1.0}


class Places:
    """A solution with the load at given places."""

    def __new__(cls, t, x):
        base = hd.solve(hd.Equation(hd.Caputo(2.0), lambda t, x: 0.0, [0.0, 1.0]), 1.0, 4)
        y = np.asarray(x, dtype=float).reshape(-1, 1)
        return dataclasses.replace(base, t=np.asarray(t), y=y, ydot=np.zeros_like(y))


T = np.linspace(0.0, 60 * PERIOD, 20_001)


def stairs(rests):
    """A load that rests in wells for the given times and leaves each of them in a tenth."""
    t, x = [0.0], [0.1]
    for rest in rests:
        t += [t[-1] + rest, t[-1] + rest + 0.1]
        x += [x[-1], x[-1] + 2 * math.pi]
    return Places(T, np.interp(T, t, x))


def test_a_weakly_pulled_load_is_stuck():
    found = run(100.0, 20_000, **CLASSICAL, spring_speed=0.25)
    assert found.regime == "stuck"
    assert found.certainty == 1
    assert found.n_wells == 0
    still = run(20.0, 4_000, **CLASSICAL, spring_speed=0.0)
    assert still.regime is Regime.STUCK


def test_a_run_shorter_than_the_pull_through_one_well_tells_nothing():
    found = run(10.0, 2_000, exponent=False, spring_speed=0.25)
    assert found.regime is Regime.UNDETERMINED
    assert found.certainty == 0


def test_a_run_that_failed_has_no_regime():
    torn = Places(T, np.append(T[:-1], np.inf))
    early = ["blown_up", "not_solved", "step_too_small", "max_steps", "rhs_failed", "kernel_failed"]
    failed = [dataclasses.replace(Places(T, T), status=hd.Status(name)) for name in early]
    for orbit in (torn, *failed):
        found = classify(orbit, period=PERIOD)
        assert (found.regime, found.certainty) == (Regime.UNDETERMINED, 0.0)


def test_a_barrier_passed_in_a_run_shorter_than_a_quarter_period():
    t = np.linspace(0.0, 1.0, 50)
    assert classify(Places(t, 6.0 + t), period=PERIOD).regime is Regime.SLIDING


@pytest.mark.parametrize("orders", [CLASSICAL, {"beta": 1.5, "gamma": 0.5}])
def test_shallow_wells_do_not_stop_the_load(orders):
    found = run(100.0, 20_000, **orders, spring_speed=3.0, adhesion=1.0)
    assert found.regime == "sliding"
    assert found.certainty > 0.6
    assert math.isnan(found.irregular)


def test_classical_stick_slip_that_repeats_every_three_wells():
    found = run(200.0, None, **CLASSICAL, adhesion=10.0)
    assert found.regime == "stick-slip, periodic"
    assert found.cycle == 3
    assert found.recurrence < 1e-3
    assert found.certainty > 0.95


def test_classical_stick_slip_without_repetition():
    found = run(500.0, None, **CLASSICAL, adhesion=7.0)
    assert found.regime == "stick-slip, irregular"
    assert found.cycle == 0
    assert found.certainty > 0.95


def test_memory_makes_the_same_load_repeat_itself():
    found = run(300.0, 30_000, adhesion=7.0)
    assert found.regime is Regime.PERIODIC
    assert found.certainty > 0.8


@pytest.mark.parametrize("exponent", [False, True])
def test_few_stays_leave_the_order_open(exponent):
    """Two stays in the run: neither repetition nor the lack of it was seen."""
    found = run(100.0, 20_000, exponent=exponent, **CLASSICAL)
    assert found.regime in (Regime.PERIODIC, Regime.IRREGULAR)
    assert found.irregular == 0.5
    assert found.n_stays == 2


def test_stairs_regular_and_not():
    even = classify(stairs([PERIOD - 0.1] * 70), period=PERIOD)
    assert (even.regime, even.cycle) == (Regime.PERIODIC, 1)
    twofold = classify(stairs([9.0, 3.0] * 35), period=PERIOD)
    assert (twofold.regime, twofold.cycle) == (Regime.PERIODIC, 2)
    rests = np.random.default_rng(1).uniform(3.0, 9.5, 80)
    uneven = classify(stairs(rests), period=PERIOD)
    assert (uneven.regime, uneven.cycle) == (Regime.IRREGULAR, 0)
    assert even.certainty == twofold.certainty == uneven.certainty == pytest.approx(13 / 14)
    assert even.longest_stay == pytest.approx(PERIOD - 0.1, abs=0.3)


def test_a_pull_backwards_is_the_same():
    forth = stairs([9.0, 3.0] * 35)
    back = Places(T, -forth.y)
    one, other = classify(forth, period=PERIOD), classify(back, period=PERIOD)
    assert (one.regime, one.cycle, one.n_wells) == (other.regime, other.cycle, other.n_wells)


def test_a_check_that_disagrees_takes_certainty():
    even, sliding = stairs([PERIOD - 0.1] * 70), Places(T, T + 0.1)
    assert classify(sliding, period=PERIOD).certainty == 1
    torn = classify(sliding, period=PERIOD, check=even)
    assert torn.certainty <= 0.5
    assert torn.agreement == 0.5


def test_exponents_count_as_a_witness_of_their_own():
    exponent = hd.lyapunov(hd.scenes.stick_slip(), 20.0, 2_000)
    rests = np.random.default_rng(1).uniform(3.0, 9.5, 80)
    for orbit, repeats in ((stairs(rests), False), (stairs([PERIOD - 0.1] * 70), True)):
        found = [
            classify(orbit, dataclasses.replace(
                exponent, slope=np.array([slope]), slope_stderr=np.array([0.1])
            ), period=PERIOD)
            for slope in (-0.2, 0.0, 0.2, np.nan)
        ]  # fmt: skip
        alone = classify(orbit, period=PERIOD).irregular
        assert found[0].irregular < found[1].irregular < found[2].irregular
        assert found[1].irregular == found[3].irregular == alone
        assert (alone < 0.5) == repeats
