"""Adaptive collocation as a scheme: its parameters, order and capabilities."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from ..equation.system import System
from ..stepping.scheme import Scheme, check_smoothness
from ..support.checks import count, positive, refuse, within


@dataclass(frozen=True)
class Collocation(Scheme):
    """Spectral collocation at Radau points, with steps that keep the tolerance.

    The scheme solves every `Equation`: any number of terms and components, with orders in (0, 2]
    that may differ between components, and classical terms. On every step the right-hand side is a
    polynomial through its values at s nodes. The unknown is a polynomial too if lower terms need
    it. The fractional integrals of these polynomials over the step are exact. The history is a sum
    of exponential modes, advanced by exact moments. On the first step after t = 0 and after a jump,
    the polynomials are in a power of t.

    If terms with general kernels or varying orders contain a component's highest derivative, a step
    solves the equation itself and not its integral. For such equations, and if any order varies, a
    run begins with very short ordinary steps, at 0 and at jumps. The orders of such equations must
    exceed the integer below by at least 0.05.

    Parameters
    ----------
    nodes : int, optional
        Number s of nodes in a step, 2 to 12.
    horizon : float, optional
        Time up to which a run may be resumed, if later than ten times the first run's end [time].

    Error
    -----
    Within `rtol` and `atol` of `solve` (convergence/collocation.py). O(h**(s + a)) for smooth
    solutions, with a the smaller of 1 and the order of integration.

    Stability
    ---------
    The scheme is implicit. No step limit was found for orders up to 2 (docs/stability.md).

    Cost
    ----
    A step takes one to three Newton iterations, each with s evaluations of the right-hand side. It
    also takes (modes) x s multiplications. If orders vary, a step takes 0.2 ms of Python as well.

    Source
    ------
    Collocation with graded meshes [Brunner2004]; this combination docs/theory.md.

    Examples
    --------
    >>> import hereditary as hd
    >>> sol = hd.solve(hd.scenes.relaxation(0.5), 1.0, rtol=1e-10, scheme=hd.Collocation())
    >>> round(float(sol.y[-1, 0]), 10)
    0.4275835762
    """

    nodes: int = 8
    horizon: float | None = None
    solve: ClassVar[str] = "collocation"
    whole: ClassVar[bool] = True
    takes_kernels: ClassVar[bool] = True
    takes_varying: ClassVar[bool] = True
    takes_algebraic: ClassVar[bool] = True

    def __post_init__(self) -> None:
        if not 2 <= count("nodes", self.nodes) <= 12:
            refuse("nodes", "lie in 2..12", self.nodes)
        if self.horizon is not None:
            positive("horizon", self.horizon)

    def order(self, alpha: float, smoothness: str = "smooth") -> float:
        """Return the order of convergence: the number of nodes + the order of integration.

        Parameters
        ----------
        alpha : float
            Highest order of the equation, 0 < alpha <= 2 [-].
        smoothness : {"smooth", "singular"}
            Whether the solution is smooth at t = 0, or behaves as t**alpha there. The order is the
            same, because the first step resolves such powers.
        """
        alpha = within("alpha", alpha, 5e-324, 2.0, "(0, 2]")
        check_smoothness(smoothness)
        return self.nodes + (alpha if alpha <= 1 else alpha - 1)

    def plan(self, equation: System, h: float) -> Any:
        """Refuse: this scheme has no plan for uniform steps."""
        required = "be left out with Collocation, which chooses its steps"
        refuse("n_steps", required, f"h = {h}", "pass rtol instead")
