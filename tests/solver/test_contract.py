"""The contract of steppers: one of twenty lines keeps it, and whatever drives steppers drives it.

Behind it are the laws of tangents, which both engines and steppers of users keep.
"""

from math import exp

import numpy as np
import pytest
from cases import (
    FIRST_ORDER,
    HISTORIES,
    LONG,
    N_STEPS,
    ORBITS,
    T_END,
    TANGENTS,
    assert_close,
    chosen,
    over,
)
from solver.runs import event

import hereditary as hd
from hereditary.compiled.records import record
from hereditary.compiled.schedule import SCHEDULE
from hereditary.given.fixed_stepper import FixedStepper
from hereditary.given.steps import UniformSteps, mesh_steps
from hereditary.solver.events import Events
from hereditary.solver.hybrid import Hybrid
from hereditary.solver.opening import how_to_step, open_stepper
from hereditary.solver.output import Kept, Output
from hereditary.solver.run import Drive, go_back, run
from hereditary.stepping.dense import StepPieces
from hereditary.stepping.state import State
from hereditary.stepping.status import Ending
from hereditary.stepping.stepper import (
    JumpingStepper,
    ResumableStepper,
    Stepper,
    Stop,
    TangentStepper,
)

pytestmark = pytest.mark.rounding

H, RATE = 0.01, 2.0
# Rounding errors of 2,000 steps, each at most 2.2e-16, which add up like their square root.
ROUNDING_OF_STEPS = 1e-14
FACTOR = 1 - H * RATE


class Euler(Stepper):
    """Euler steps of y' = -2 y and its tangent."""

    def __init__(self, system):
        self.system, self._now = system, (0, system.y0[0].copy(), np.eye(1))

    position = property(lambda self: self._now[0])
    t = property(lambda self: H * self.position)
    y = property(lambda self: self._now[1].copy())
    ydot = property(lambda self: -RATE * self.y)

    def stop_at(self, t):
        n = int(np.ceil(t / H - 1e-9))
        return Stop(n, H * n)

    def advance(self, stop, keep=True):
        n, before, tangent = self.position, (self.y, self.ydot), self._now[2]
        self._now = n + 1, FACTOR * self.y, FACTOR * tangent
        rows, slopes = np.stack([before, (self.y, self.ydot)], axis=1)
        return StepPieces(self.t + np.array([-H, 0.0]), rows, slopes, n=n)

    def checkpoint(self):
        return self._now

    def come_back(self, checkpoint):
        self._now = checkpoint


class AbleEuler(Euler, ResumableStepper, TangentStepper, JumpingStepper):
    """The same with the abilities of both engines."""

    tangent = property(lambda self: self._now[2])
    uncertainty = np.zeros(1)

    def transform_tangent(self, matrix):
        self._now = self.position, self.y, self.tangent @ matrix

    def state(self):
        return State(
            t=self.t, y=self.y, scheme=None, how=None, identity={}, checkpoint=self.checkpoint()
        )

    def restore(self, state, allow_change=False):
        self.come_back(state.checkpoint)

    def expect_jumps(self, of_y):
        pass

    def set_y(self, y):
        self._now = self.position, y, self.tangent

    def set_side(self, number, sign):
        pass


def equation():
    return hd.Equation(hd.Caputo(1), lambda t, y: -RATE * y, 1.0)


def ran(t_end=1.0, events=(), changes=None):
    """The solution of a run over the stepper."""
    hybrid = Hybrid(equation().system, hd.ExplicitCaputo(), (), (), changes) if changes else None
    stepper = AbleEuler(hybrid.system if hybrid else equation().system)
    stop, inside = stepper.stop_at(t_end).position, stepper.system.frame.event
    if hybrid:
        found = hybrid.open(stepper, t_end, np.zeros(0), {})
    else:
        found = Events(map(inside, events), stepper, {})
    output = Output(stepper, stop, Kept(1), found)
    march = (lambda drive, end: hybrid.march(output, drive, end)) if hybrid else Drive.to
    return run(stepper, stop, t_end, output, False, 0.0, march)


def test_a_run_has_the_rows_and_dense_output_of_the_steps():
    found = ran()
    assert found.success
    assert found.y[:, 0] == pytest.approx(FACTOR ** np.arange(101), rel=1e-12)
    assert found(0.505)[0] == pytest.approx(exp(-1.01), rel=0.02)
    assert found(0.505, 1)[0] == pytest.approx(-2 * exp(-1.01), rel=0.03)


@pytest.mark.parametrize("terminal", [False, True])
def test_events_are_located_and_end_the_run(terminal):
    found = ran(events=[event(lambda t, y: y[0] - 0.5, terminal=terminal)])
    assert found.status == ("event" if terminal else "completed")
    assert found.t_events[0] == pytest.approx([np.log(0.5) / np.log(FACTOR) * H], abs=1e-4)
    assert found.y_events[0][0, 0] == pytest.approx(0.5, abs=1e-9)
    if terminal:
        assert found.t[-1] == found.t_events[0][0]


def test_changes_of_y_act_at_their_step():
    found = ran(changes={0.5: lambda t, y: y + 1.0})
    assert found.success
    before, after = found.y[found.t == 0.5][:, 0]
    assert after - before == pytest.approx(1.0)
    assert found.y[-1, 0] == pytest.approx(after * FACTOR**50, rel=1e-12)


def test_exponents_are_those_of_the_steps():
    stepper, logs = AbleEuler(equation().system), []
    schedule = record(SCHEDULE, interval=10, longest=10, end=100, unit=1.0)
    while stepper.position < 100:
        logs.append(stepper.grow(100, schedule).logs)
    logs = np.vstack(logs)
    assert logs[:, 0].tolist() == list(range(10, 101, 10))
    assert np.sum(logs[:, 1]) == pytest.approx(100 * np.log(FACTOR), rel=1e-12)


def test_breaks_are_refused_where_steps_do_not_see_them():
    with pytest.raises(ValueError, match=r"breaks must be left out with Euler, got \[0\.5\]"):
        Euler(equation().system).set_breaks(np.array([0.5]), 1.0)


@pytest.mark.parametrize("how", [None, {"n_steps": 100}, {"rtol": 1e-6}], ids=str)
def test_a_checkpoint_can_be_come_back_to_more_than_once(how):
    """The law that all three steppers keep: going back and on again gives the same numbers."""
    scheme = hd.ExplicitCaputo() if how and "n_steps" in how else hd.Collocation()
    system = equation().system
    if how is None:
        stepper = Euler(system)
    else:
        steps = how_to_step(system, scheme, 1.0, **how)
        stepper, _ = open_stepper(system, scheme, None, steps, 1.0)

    def to(t):
        stop = stepper.stop_at(t).position
        while stepper.position < stop:
            stepper.advance(stop, keep=False)
        return stepper.t, stepper.y.tolist()

    reached = to(0.3)
    assert reached[0] == pytest.approx(0.3)
    kept = stepper.checkpoint()
    ends = [to(0.7)]
    for _ in range(2):
        go_back(stepper, kept, 0.7)
        ends.append((stepper.t, stepper.y.tolist()))
    assert ends[0] == ends[1] == ends[2]
    stepper.come_back(kept)
    assert (stepper.t, stepper.y.tolist()) == reached


class Damped(TangentStepper):
    """Euler steps of x'' + 2.5 x' + x = 0, or by another matrix, up to the one that fails."""

    t = y = position = tangent = None

    def __init__(self, last=np.inf, step=((1.0, 0.01), (-0.01, 0.975))):
        self.last, self.step = last, np.array(step)
        self.position, self.y, self.tangent = 0, np.array([1.0, 0.0]), np.eye(2)

    @property
    def failure(self):
        return Ending(hd.Status.RHS_FAILED, "as asked") if self.position >= self.last else None

    def advance(self, stop, keep=True):
        self.y, self.tangent = self.step @ self.y, self.step @ self.tangent
        self.position += 1

    def checkpoint(self):
        return ()

    def come_back(self, checkpoint):
        pass

    def transform_tangent(self, matrix):
        self.tangent = self.tangent @ matrix


def growth(stepper, schedule):
    """Marks and logarithms by the loop that is read, and whether tangents were lost."""
    logs, lost, end = [], False, int(schedule["end"])
    while stepper.position < end and not (stepper.failure or lost):
        _, found, lost = TangentStepper.grow(stepper, end, schedule)
        logs.append(found)
    return np.vstack(logs), lost


def every_50():
    return record(SCHEDULE, interval=50, longest=50, end=4000, unit=1.0)


def test_the_loop_takes_a_stepper_of_the_user():
    """Eigenvalues -1/2 and -2, whose Euler steps multiply by 0.995 and 0.98."""
    logs, lost = growth(Damped(), every_50())
    assert logs[:, 0].tolist() == list(range(50, 4001, 50))
    assert not lost
    assert logs[-1, 1:] == pytest.approx(50 * np.log([0.995, 0.98]), rel=1e-9)


def test_the_loop_keeps_the_growth_before_a_failure():
    logs, lost = growth(Damped(120), every_50())
    assert logs[:, 0].tolist() == [50, 100]
    assert not lost


@pytest.mark.parametrize("value", [0.0, np.nan])
def test_the_loop_says_that_tangents_are_lost(value):
    assert growth(Damped(step=np.full((2, 2), value)), every_50())[1]


@pytest.mark.parametrize(
    ("scheme", "scene"), ORBITS, ids=lambda v: repr(v) if v in FIRST_ORDER else ""
)
def test_the_compiled_loop_is_the_loop_that_is_read(scheme, scene):
    """They agree as well as the problem lets them, whose tangents amplify rounding errors."""
    equation, history, h = scene(), hd.SumOfExponentials(), 0.01
    directions = np.eye(equation.y0.size)[:, :2]
    how = {"scheme": scheme, "directions": directions, "transient": 0.5, "renorm": 0.3}
    result = hd.lyapunov(equation, 20.0, 2000, 2, **how, verify=False)
    run = scheme, history, UniformSteps(h, 2000), 20.0
    stepper, _ = open_stepper(equation.system, *run, directions=directions)
    schedule = record(SCHEDULE, transient=50, end=2000, interval=30, longest=30, unit=1.0)
    logs, _ = growth(stepper, schedule)
    # the growth moves so far if y0 moves as far as the rounding errors of 2,000 steps add up to
    moved = 0.0
    for share in (-ROUNDING_OF_STEPS, ROUNDING_OF_STEPS):
        near = equation.replace(y0=equation.y0 * (1 + share) + share)
        other = hd.lyapunov(near, 20.0, 2000, 2, **how, verify=False)
        moved = max(moved, np.abs(other.log_growth - result.log_growth).max())
    assert moved < 1e-4
    found = np.cumsum(logs[2:, 1:], axis=0)
    # ten times: rounding also acts on tangents, and in each step
    assert np.abs(found - result.log_growth).max() < 10 * max(moved, 1e-13)
    assert np.allclose(h * logs[2:, 0], result.times, rtol=1e-12)


def marched(case, equation, n=N_STEPS, stops=(), **more):
    """March over n given steps; tangents are combined by each matrix of `stops`, {step: matrix}."""
    steps = UniformSteps(T_END / n)
    if case.steps == "mesh":
        steps = mesh_steps(hd.graded(n, 2.0), T_END)
    stepper = FixedStepper(equation.system, case.scheme, case.history, steps, n, **more)
    for stop in (*stops, n):
        while stepper.n < stop:
            stepper.advance(stop, keep=False)
        if stop in stops:
            stepper.transform_tangent(stops[stop])
    return stepper


def values(stepper):
    """Return y, and y' of components of order above 1: what tangents are derivatives of."""
    return np.append(stepper.y, stepper.ydot[stepper.system.above_one])


def random_directions(equation, k=2):
    n = equation.d + np.sum(equation.system.above_one)
    return np.random.default_rng(1).normal(size=(n, k))


@over([case for case in chosen(steps="uniform") if "varying" not in case.family.tags])
def test_the_length_of_blocks_does_not_matter(case):
    ends = [marched(case, case.equation(), block=block).y for block in (2, 7, 32, 100)]
    assert_close(np.array(ends), ends[0], case, 1e-11)


def late_relay(t, y, late, p):
    return -1.3 * late[0] * (1.0 + p[0] * np.sign(y[0] - 0.6)) + 0.4 * np.cos(t)


# A delay that is no multiple of the step of 1/50: it is read inside the first steps.
LATE = hd.Caputo(1.4), late_relay, [1.0, -0.5]
OF_EACH_KIND = [
    hd.ExplicitCaputo(),
    hd.GrunwaldLetnikov(),
    hd.L1(),
    hd.L2Sigma(),
    hd.BDF(2),
    hd.Adams(),
    hd.ProductTrapezoid(),
]


@pytest.mark.parametrize("scheme", OF_EACH_KIND, ids=repr)
@pytest.mark.parametrize("jump", [0.0, 0.5])
def test_the_steps_of_one_call_do_not_matter(scheme, jump, monkeypatch):
    """Bit for bit, also with a delay and a switch: measured times say how many steps they are."""
    equation = hd.Equation(*LATE, [jump], memory=hd.Delay(0.413))
    times, found = np.linspace(0.0, 1.0, 97), []
    how = {"switches": lambda t, y: y[0] - 0.6} if jump else {}
    for n in (50, 17, 3, 1):
        monkeypatch.setattr(FixedStepper, "_steps_at_once", lambda self, n=n: n)
        sol = hd.solve(equation, 1.0, 50, scheme=scheme, estimate=False, **how)
        found.append([sol.y, sol.ydot, sol(times), sol(times, 1)])
    for others in found[1:]:
        assert all(map(np.array_equal, others, found[0]))


@over([case for case in TANGENTS if case.given and case.history in (None, HISTORIES[2])])
def test_tangents_are_difference_quotients(case):
    """Of the discrete solution with given steps."""
    equation = case.equation()
    d, above = equation.d, equation.system.above_one
    directions = random_directions(equation)
    tangent = marched(case, equation, directions=directions).tangent
    for k in range(2):
        ends = []
        for by in (1e-5, -1e-5):
            y0 = equation.y0.copy()
            y0[0] += by * directions[:d, k]
            y0[1:, above] += by * directions[d:, k]
            moved = equation.replace(y0=y0 if len(y0) > 1 else y0[0])
            ends.append(values(marched(case, moved)))
        quotient = (ends[0] - ends[1]) / 2e-5
        assert_close(tangent[:, k], quotient, case, 1e-6)


@over([case for case in TANGENTS if case.given])
def test_combined_tangents_go_on_as_the_combination(case):
    """Linear in all they hold; combined before, in and at the ends of blocks and of FFT's parts."""
    n, at = (LONG, (1, 33, 1024, 2051)) if case.history == HISTORIES[1] else (N_STEPS, (1, 5, 32))
    equation, stops = case.equation(), {k: np.array([[0.7, -1.3], [0.4, 2 + 1 / k]]) for k in at}
    directions = random_directions(equation)
    plain = marched(case, equation, n, directions=directions)
    mixed = marched(case, equation, n, stops, directions=directions)
    expected = plain.tangent @ np.linalg.multi_dot([np.eye(2), *stops.values()])
    assert_close(mixed.tangent, expected, case, 1e-9)
    assert np.array_equal(mixed.y, plain.y)
    one = marched(case, equation, n, directions=directions[:, :1])
    assert_close(one.y, plain.y, case, 1e-13)
    assert_close(one.tangent, plain.tangent[:, :1], case, 1e-10)
