"""The L2 scheme: piecewise quadratic solutions."""

import importlib
from dataclasses import dataclass
from functools import partial
from typing import ClassVar

import numpy as np

from ..compiled.mesh_sums import is_parabola, moments
from ..equation.system import System
from ..kernels.special import gauss_unit
from ..support.checks import complaint, shown, within
from .derivative_form import derivative_plan
from .mesh_plan import mesh_plan
from .scheme import Plan, Scheme, check_smoothness
from .weights import parabola_start, weighed_parabolas

# Changes of increments that stay this small, in comparison with the solution, are rounding.
_ROUNDING = 1e-9


@dataclass(frozen=True)
class L2(Scheme):
    """The L2 scheme of order 3 - alpha, for orders in (0, 1].

    On every step but the last the solution is the parabola through its ends and the next value, on
    the last one that through its ends and the value before; the equation holds at t_n. At alpha = 1
    this is the second backward difference formula. The first two values are found together, from
    the parabola through x_0, x_1, x_2, so that the first step has the scheme's own order. Implicit:
    Newton's method with the equation's Jacobian or differences. Any number of terms and components.

    Error
    -----
    O(h**(3-alpha)) for smooth solutions; O(h) at a fixed time for solutions like t**alpha on
    uniform steps, O(n**-min(r alpha, 3-alpha)) at all times on the mesh ``graded(n, r)``; a step
    more than thirty times as long as the one before it gets a line instead of a parabola, which
    would amplify what lies before
    (convergence/orders.py, convergence/graded_meshes.py).

    Stability
    ---------
    No step limit was found.

    Source
    ------
    [LvXu2016], section 2.

    Examples
    --------
    >>> import hereditary as hd
    >>> sol = hd.solve(hd.scenes.relaxation(0.5), 1.0, n_steps=1000, scheme=hd.L2())
    >>> round(float(sol.y[-1, 0]), 4)
    0.4276
    """

    solve: ClassVar[str] = "newton"
    orders = (0.0, 1.0)
    takes_meshes: ClassVar[bool] = True
    solves_first_steps: ClassVar[bool] = True

    def order(self, alpha: float, smoothness: str = "smooth") -> float:
        """Proven order of convergence at a fixed time, on uniform steps.

        Parameters
        ----------
        alpha : float
            Highest order of the equation, 0 < alpha <= 1 [-].
        smoothness : {"smooth", "singular"}
            Whether the solution is smooth at 0 or behaves like t**alpha there.
        """
        alpha = within("alpha", alpha, 5e-324, 1.0, "(0, 1]", "use L1 for orders above 1")
        check_smoothness(smoothness)
        return 3 - alpha if smoothness == "smooth" else 1.0

    def plan(self, equation: System, h: float) -> Plan:
        """Tables and convolution for `equation` with step h."""
        weighed = partial(weighed_parabolas, h=h, theta=1.0, closing=True)
        first = _first_increment(equation, np.array([0.0, h, 2 * h]))
        return derivative_plan(equation, h, 1.0, weighed, parabola_start(1.0), first)

    def mesh_plan(self, equation: System, times: np.ndarray) -> Plan:
        """Plan on a mesh of any steps, for orders in (0, 1]."""
        steps = np.diff(times[:3])
        bent = times.size > 2 and is_parabola(steps[1], steps[0], 2)
        first = _first_increment(equation, times[:3]) if bent else None
        return mesh_plan(self, equation, times, 1.0, 2, first)


def _first_increment(equation, times):
    """x_1 - x_0 from the equation at t_1 and t_2 with one parabola through x_0, x_1, x_2."""
    solved, sources = ~equation.read, equation.sources
    d = int(solved.sum())
    weights = _start_weights(equation, times)

    def widened(u):  # memory has the increments of its sources
        whole = np.zeros((2, equation.d))
        whole[:, solved] = u.reshape(2, d)
        return whole[:, sources]

    def excess(u):
        u, values = widened(u), np.empty((2, equation.d))
        left = np.einsum("rcj,cj->rj", weights, u)
        for row, x in ((0, equation.y0[0] + u[0]), (1, equation.y0[0] + u[0] + u[1])):
            point = np.where(solved, x, left[row])
            values[row] = equation.force(times[row + 1], point)
        return (left - values)[:, solved].ravel()

    def differences(u):
        jacobian = np.empty((2 * d, 2 * d))
        for k in range(2 * d):
            e = np.zeros(2 * d)
            e[k] = 6e-6 * max(units[k % d], abs(initial[k % d]))
            jacobian[:, k] = (excess(u + e) - excess(u - e)) / (2 * e[k])
        return jacobian

    u = np.zeros(2 * d)
    initial, units, before = equation.y0[0, solved], equation.steps[solved], np.inf
    scale = np.abs(initial).max()
    for _ in range(50):
        if equation.structure is None:
            change = np.linalg.solve(differences(u), excess(u))
        else:
            change = _sparse_change(equation, times, weights, u, excess(u))
        u -= change
        size, goal = np.abs(change).max(), scale + np.abs(u).max()
        if size <= 1e-14 * goal or before / 2 < size <= _ROUNDING * goal:
            return widened(u)[0]
        before = size
    required = "let Newton's method find the first two values"
    raise ValueError(complaint("steps", required, f"increments {shown(u)}", "take smaller ones"))


def _sparse_change(equation, times, weights, u, excess):
    """Newton's change of both increments, (2 d,), where entries of the Jacobian are known."""
    sparse = importlib.import_module("scipy.sparse")  # whose imports take long
    linalg = importlib.import_module("scipy.sparse.linalg")
    first, second = equation.y0[0] + np.cumsum(u.reshape(2, -1), axis=0)
    at_first, at_second = (
        equation.derivative(t, y) for t, y in zip(times[1:3], (first, second), strict=True)
    )
    diagonals = [[sparse.diags_array(w) for w in row] for row in weights]
    blocks = [
        [diagonals[0][0] - at_first, diagonals[0][1]],
        [diagonals[1][0] - at_second, diagonals[1][1] - at_second],
    ]
    return linalg.spsolve(sparse.block_array(blocks, format="csc"), excess)


def _start_weights(equation, times):
    """Weights of the first two increments (second axis) in the derivatives at t_1, t_2 (first).

    The parabola's slope is ``mean + lean (s - middle)`` on either step, with the means u_0/tau_0
    and u_1/tau_1 and the common lean ``2 (u_1/tau_1 - u_0/tau_0) / (tau_0 + tau_1)``.
    """
    steps = np.diff(times)
    rule = gauss_unit(16)
    weights = np.zeros((2, 2, equation.d))
    for operator, c in equation.left:
        factor = c * operator.factor(1.0)
        for row, t in enumerate(times[1:]):
            for k in range(row + 1):
                m_0, m_1 = moments(t - times[k + 1], steps[k], operator.power, *rule)
                lean = 2 * m_1 / steps.sum() / steps
                weights[row] += factor * np.array([[-lean[0]], [lean[1]]])
                weights[row, k] += factor * m_0 / steps[k]
    return weights
