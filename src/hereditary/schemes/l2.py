"""The L2 scheme (floor 2): piecewise quadratic solutions."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from .._checks import complaint, shown, within
from ..equation import Equation
from ..kernels.implicit import march_implicit
from ..special import power_differences
from .derivative_form import derivative_plan, leading_weight
from .scheme import Plan, Scheme, check_smoothness, refuse_orders_above_one
from .weights import last_moment, parabola_start, parabola_weights


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
    uniform steps (convergence/orders.py).

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

    march: ClassVar[Callable] = staticmethod(march_implicit)

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

    def plan(self, equation: Equation, h: float) -> Plan:
        """Tables and convolution for `equation` with step h."""
        refuse_orders_above_one("L2", equation)
        rule = parabola_weights(1.0, closing=True)
        first = _first_increment(equation, h)
        return derivative_plan(equation, h, 1.0, lambda _: rule, parabola_start(1.0), first)


def _first_increment(equation, h):
    """w_0 = x_1 - x_0 from the equation at t_1 and t_2 with one parabola through x_0, x_1, x_2.

    On that parabola D^alpha x(t_1) = A (a_0 w_0 + m_0 (w_1 - w_0)) and D^alpha x(t_2) =
    A (a_1 w_0 + a_0 w_1 + (m_0 + m_1) (w_1 - w_0)).
    """
    d = equation.d
    near = np.zeros((2, 2, d))  # weight of increment [column] in the equation at time [row]
    for c, alpha in zip(equation.coefficients, equation.orders, strict=True):
        for j in range(d):
            p = 1 - alpha[j]
            a_1 = power_differences(p, 2)[1]
            lean = last_moment(p)
            more = -parabola_start(1.0).exact(p, 1)[0]  # m_1
            weights = np.array([[1 - lean, lean], [a_1 - lean - more, 1 + lean + more]])
            near[:, :, j] += leading_weight(c[j], alpha[j], h) * weights

    def excess(w):
        w = w.reshape(2, d)
        values = np.empty((2, d))
        for row, x in ((0, equation.y0[0] + w[0]), (1, equation.y0[0] + w[0] + w[1])):
            equation._rhs((row + 1) * h, x, values[row], equation.params)
        return (np.einsum("rcj,cj->rj", near, w) - values).ravel()

    w = np.zeros(2 * d)
    for _ in range(50):
        residual = excess(w)
        jacobian = np.empty((2 * d, 2 * d))
        for k in range(2 * d):
            step = 6e-6 * max(1.0, abs(equation.y0[0, k % d]))
            e = np.zeros(2 * d)
            e[k] = step
            jacobian[:, k] = (excess(w + e) - excess(w - e)) / (2 * step)
        change = np.linalg.solve(jacobian, residual)
        w -= change
        if np.abs(change).max() <= 1e-14 * (np.abs(equation.y0[0]).max() + np.abs(w).max()):
            return w[:d]
    required = "let Newton's method find the first two steps"
    raise ValueError(complaint("n_steps", required, f"w = {shown(w)}", "take smaller steps"))
