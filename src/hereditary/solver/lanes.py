"""Members of an ensemble that are marched in compiled code, one after the other."""

from __future__ import annotations

import numpy as np

from .._differences import units_of
from .._jit import loop_value
from ..compiled.block import BLOWN_UP, NOT_SOLVED, RUNNING
from ..compiled.march import MARCHES
from ..compiled.members import RAISED, Found, Starts, keep, march_members
from ..compiled.signatures import COUNTS, MARCH_SIG
from ..system import System, displaced
from ..terms import SystemTerm
from .march_arrays import columns
from .status import Status, failed
from .stepper import Stepper

_ENDS = {BLOWN_UP: Status.BLOWN_UP, NOT_SOLVED: Status.NOT_SOLVED}


class Lane(Stepper):
    """A march on uniform steps that takes members of an ensemble one after the other."""

    def whole(self, n_steps):
        """Make ready for a run; return whether compiled code gets to its end without leaving."""
        if self.equation.enlarged.varies:
            return False
        self.prepare(n_steps)
        return self.memory.reach(0) >= n_steps

    def rows(self, starts, kept):
        """Return room for y and its slopes in rows of the steps `kept` (k,), (E, k, d) each.

        NaN but for those of step 0.
        """
        d, above = self.equation.d, self.equation.highest_orders() > 1
        rows, slopes = np.full((2, len(starts.x), kept.size, d), np.nan)
        if kept[0] == 0:
            rows[:, 0] = starts.x[:, :d]
            slopes[:, 0, above] = starts.increment[:, :d][:, above] / self.h
        return rows, slopes

    def starts(self, params, y0):
        """Return the `Starts` of members, of parameters and initial values.

        params (E, p) and y0 (E, m, d), one of which may be None for those of the equation.
        """
        n = len(y0 if params is None else params)
        own, params = params, np.tile(self._system.compiled_params, (n, 1))
        if own is not None:  # others, which the system needs itself, stand behind them
            params[:, : own.shape[1]] = own
        values = self._initial_values(n, y0)
        size = 1 if self.scheme.solves_first_steps else len(params)
        parts = [slice(k, k + size) for k in range(0, len(params), size)]
        plans = [self._planned(self._beside(values[part], params[part])) for part in parts]
        d, found, fields = self._system.d, [columns(plan) for plan in plans], {}
        for name in found[0]:
            joined = np.concatenate([begun[name] for begun in found])
            fields[name] = joined.reshape(n, d, *joined.shape[1:])
        monitor = self._march.monitor.copy()
        monitor[:] = 0
        monitor["turns"][: self.equation.d] = -1.0 * (self.equation.highest_orders() == 2)
        units = np.ones((n, d))
        if not self._system.has_jac:
            for row, x, own in zip(units, fields["x"], params, strict=True):
                found_units = units_of(self._system.compiled_rhs, own, x[:d])
                row[:] = np.where(found_units > 0, found_units, 1.0)
        return Starts(params=params, units=units, monitor=monitor, **fields)

    def _initial_values(self, size, y0):
        """Return y(0), and y'(0), of the systems that are marched, (E, m, d)."""
        inside = self._system
        if y0 is None:
            return np.broadcast_to(inside.y0, (size, *inside.y0.shape))
        if inside is self.equation:
            return y0
        systems = (displaced(self.equation, np.ascontiguousarray(row)) for row in y0)
        return np.array([(self.scheme.reduction(s) or s.enlarged).y0 for s in systems])

    def _beside(self, y0, params):
        """Return members side by side as one system, for the scheme's plan of their starts."""
        system, size = self._system, len(y0)
        d = system.d

        def rhs(t, y, dy, _):
            for m in range(size):
                own = slice(m * d, (m + 1) * d)
                system.compiled_rhs(t, np.ascontiguousarray(y[own]), dy[own], params[m])

        left = [SystemTerm(operator, np.tile(c, size)) for operator, c in system.left]
        sources = (system.sources + d * np.arange(size)[:, None]).ravel()
        start = np.ascontiguousarray(np.moveaxis(y0, 0, 1)).reshape(system.m, -1)
        return System(left, start, params[0], rhs, sources=sources)

    def run(self, starts, n_steps, kept, rows, slopes):
        """March members to step `n_steps`, and fill the rows (E, k, d) of the steps `kept` (k,).

        Returns status, detail, and the numbers of steps and of calls of the right-hand side of
        each.
        """
        size, d = len(starts.params), self.equation.d
        jacobians = self._watch.room(0, n_steps)
        jacobians = np.tile(jacobians, (size, 1, 1, 1))
        counts = np.zeros(size, COUNTS).view(np.recarray)
        found = Found(kept, rows, slopes, jacobians, counts, np.full(size, RAISED))
        every_row, room = np.empty((2, n_steps, d)), self._room
        raised = {}
        system, first = self._system, 0
        loop = loop_value(MARCHES[self.scheme.solve, False], MARCH_SIG)
        while first < size:
            try:
                march_members(
                    loop, *system.compiled[:3], self.memory.exchange,
                    self.memory.tables, self.memory.arrays, self._newton.solver,
                    self._newton.tables, self._table, self._rows, self._march, starts,
                    *every_row, room, found, first, n_steps,
                )  # fmt: skip
                first = size
            except Exception as error:
                first += int(np.argmax(found.status[first:] == RAISED))
                keep(first, self.n, *every_row, found)
                counts[first] = self._march.counts
                raised[first] = failed(error)
                first += 1
        return self._ends(found, raised)

    def _ends(self, found, raised):
        """Return how members ended, those that raised as told."""
        counts, n_steps = found.counts, found.counts["step"].tolist()
        ratios = self._watch.of_members(found.jacobians, counts["step"])
        grew, zigzag = counts["growth"] >= 0, counts["zigzag"] >= 0
        ended = [_ENDS.get(end, Status.COMPLETED) for end in found.status.tolist()]
        beyond = (found.status == RUNNING) & ((ratios > 1) | grew | zigzag)
        for m in np.flatnonzero(beyond).tolist():
            ended[m] = Status.ZIGZAG if zigzag[m] else Status.STEP_TOO_LARGE
        details = [""] * len(ended)
        for m, end in enumerate(ended):
            if m in raised:
                ended[m], details[m] = raised[m]
            elif end is not Status.COMPLETED:
                details[m] = self._detail(end, n_steps[m], ratios[m])
            elif self.misfit:
                ended[m], details[m] = Status.KERNEL_INACCURATE, self.misfit
        return list(zip(ended, details, n_steps, counts["rhs"].tolist(), strict=True))

    def _detail(self, end, n, ratio):
        """Say where a member ended, and what is wrong with its step."""
        found = f"t = {self.equation.frame.start + self.steps.time(n):g} of step {n}"
        if end is Status.NOT_SOLVED and self.scheme.solve == "imex":
            found = f"the matrix of a step is singular, {found}"
        if ratio > 1:
            found += f"; d rhs/d y reached {ratio:.4g} times its limit at h = {self.h:g}"
        return found
