"""The stepper of an ensemble, which marches one member after the other.

Members differ in parameters and initial values. They share weights, modes and stability limits,
which are computed once.
"""

from __future__ import annotations

from contextlib import suppress

import numpy as np

from ..equation.system import System, displaced, side_by_side
from ..stepping.scheme import Scheme
from .block import RUNNING
from .fixed_stepper import FixedStepper
from .history.history import History
from .plan import Plan
from .steps import MeshSteps, UniformSteps


class MemberStepper(FixedStepper):
    """A march that `begin` sets to the start of any member of an ensemble; it has no tangents."""

    def __init__(
        self,
        system: System,
        scheme: Scheme,
        history: History,
        steps: UniformSteps | MeshSteps,
        n_steps: int,
        params: np.ndarray,
        y0: np.ndarray,
        plan: Plan | None = None,
    ) -> None:
        # params (E, p) and y0 (E, m, d) of the E members; m is 2 if initial derivatives exist, else
        # 1. plan: the scheme's plan for the components of all members, joined to one system, from
        # another stepper of the ensemble; None if each member needs a plan of its own.
        super().__init__(system, scheme, history, steps, n_steps)
        self._params, self._y0, self.plan = params, y0, plan
        if plan is None and self._block > 1:
            with suppress(Exception):  # the right-hand side of a member may raise
                self.plan = self._plan_of_all()

    def _plan_of_all(self) -> Plan:
        """Return the scheme's plan for the components of all members, joined to one system."""
        members = zip(self._y0, self._params, strict=True)
        systems = [self._inside(displaced(self.system, y0, params)) for y0, params in members]
        return self._planned(side_by_side(systems))

    def begin(self, m: int) -> None:
        """Set the march to the start of member m."""
        self.system = displaced(self.system, self._y0[m], self._params[m])
        self._marched = self._inside(self.system)
        if self.plan is None:
            plan, columns = self._planned(self._marched), slice(None)
        else:
            d = self._marched.d
            plan, columns = self.plan, slice(m * d, (m + 1) * d)
        if self._block == 1:  # blocks of one step have weights that the march may still compute
            self._begin(plan)
        self._stand_at_start(plan, columns)
        self._status, self._error = RUNNING, None
