"""A stepper of twenty lines keeps the contract, and everything that drives steppers drives it."""

from math import exp

import numpy as np
import pytest

import hereditary as hd
from hereditary.compiled.records import record
from hereditary.compiled.schedule import SCHEDULE
from hereditary.hybrid import Hybrid
from hereditary.solver.events import Events
from hereditary.solver.opening import how_to_step, open_stepper
from hereditary.solver.output import Kept, Output
from hereditary.solver.run import Drive, go_back, run
from hereditary.stepping.dense import StepPieces
from hereditary.stepping.state import State
from hereditary.stepping.stepper import (
    JumpingStepper,
    ResumableStepper,
    Stepper,
    Stop,
    TangentStepper,
)

H, RATE = 0.01, 2.0
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

    def set_parameter(self, number, value):
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
    def half(t, y):
        return y[0] - 0.5

    half.terminal = terminal
    found = ran(events=[half])
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
