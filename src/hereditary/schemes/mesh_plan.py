"""Plans on meshes of any steps, for orders in (0, 1]."""

from __future__ import annotations

import numpy as np

from ..compiled.mesh_sums import fill_mesh
from ..compiled.signatures import StepRows
from ..kernels.special import gauss_unit
from ..support.checks import complaint
from .scheme import Plan, distinct_components
from .uniform_plan import drift_of_speed


class MeshSums:
    """Sums over pieces of the solution on a mesh, which are lines or parabolas.

    Parameters
    ----------
    system : System
    times : ndarray, shape (n+1,)
        The mesh.
    theta : float or ndarray, shape (n,)
        Where in each step the equation holds.
    parabolas : int
        0 for lines, 1 for parabolas on all steps but the newest, 2 on that too.

    Attributes
    ----------
    groups : ndarray of int64, shape (d,)
        Group of each component, of the same terms.
    factors, powers, derivatives : ndarray, shape (C, T)
        ``coefficient / Gamma(p + 1)``, p = m - alpha and m of each group's terms; 0 for none.
    rows : StepRows
    """

    def __init__(self, system, times, theta, parabolas):
        distinct, self.groups = distinct_components(system)
        shape = (len(distinct), max(map(len, distinct)))
        self.factors, self.powers, self.derivatives = np.zeros((3, *shape))
        for i, key in enumerate(distinct):
            for j, (c, operator) in enumerate(key):
                self.factors[i, j], self.powers[i, j] = c * operator.factor(1.0), operator.power
                self.derivatives[i, j] = operator.derivative
        steps, self.parabolas = np.diff(times), parabolas
        self.times, self.rule = times, np.array(gauss_unit(16))
        self.theta = np.broadcast_to(theta, steps.size) * 1.0
        lead, near = np.zeros((2, len(distinct), steps.size))
        terms = self.factors, self.powers, self.derivatives
        fill_mesh(times, self.theta, parabolas, *terms, self.rule, lead, near)
        none = np.zeros((len(distinct), 0))
        ratio = np.ones(steps.size)
        ratio[1:] = steps[1:] / steps[:-1]
        self.rows = StepRows(
            first=0,
            last=steps.size - 1,
            times=times[:-1].copy(),
            theta=self.theta,
            unit=steps,
            length=steps,
            ratio=ratio,
            lead=lead,
            near=near,
            scale=np.ones_like(lead),
            drift=none,
        )

    def prepare(self, n_end: int) -> None:
        """Nothing is left to prepare."""

    def reach(self, n: int) -> tuple[int, int]:
        """All steps are worked out; see `Schedule.reach`."""
        return self.times.size - 1, 0

    def open(self, history, n_columns, n_block, span):
        """Open a fresh memory of a history for these sums; see `Past.open`."""
        return history.open_mesh(self, n_columns, span)


def mesh_plan(scheme, equation, times, theta, parabolas):
    """Plan of a scheme on a mesh of any steps."""
    name, up_to = type(scheme).__name__, scheme.meshes_up_to
    if not equation.constant:
        required = f"be Caputo operators of constant order for {name} on a mesh"
        raise ValueError(complaint("terms", required, "another", "take uniform steps"))
    highest = float(equation.highest_orders().max())
    if highest > up_to:
        required = f"lie in (0, {up_to:g}] for {name} on a mesh"
        raise ValueError(complaint("order", required, highest, "take uniform steps"))
    sums = MeshSums(equation, times, theta, parabolas)
    shift = equation.y0[1] if equation.m == 2 else np.zeros(equation.d)
    amplitudes, powers = drift_of_speed(equation)
    return Plan(
        past=sums,
        rows=sums.rows,
        groups=sums.groups,
        initial=equation.at_start,
        increments=shift * (times[1] - times[0]),
        shift=shift,
        powers=powers,
        drift=amplitudes,
    )
