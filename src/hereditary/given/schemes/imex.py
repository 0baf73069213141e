"""Implicit-explicit steps of the implicit schemes."""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from ...compiled.functions import CONSTANT
from ...compiled.jacobian import FEW
from ...equation.jacobian_structure import Structure
from ...equation.system import System
from ...stepping.scheme import Scheme
from ...support.checks import refuse
from ..plan import Plan
from ..watch import SLOWEST
from .bdf import BDF
from .l1 import L1


@dataclass(frozen=True)
class IMEX(Scheme):
    """Take the constant matrix `linear` of an equation implicitly, its `rhs` explicitly.

    The equation is ``terms = A y + f(t, y)``, with a stiff matrix A and a mild or expensive f, such
    as diffusion and reaction. A step of `scheme` uses ``f_n + theta (f_n - f_(n-1))`` instead of
    f(t_n + theta h, y), and f_n after breaks. On meshes the difference is scaled by the ratio of
    the step sizes. A step therefore calls f once, and solves one linear system. All steps of one
    length share its factors. Neither Newton's method nor derivatives of f are needed.

    Parameters
    ----------
    scheme : L1 or BDF
        `L1`, ``BDF(1)`` or ``BDF(2)``.

    Error
    -----
    If f(t, y(t)) is smooth in t, the order is that of `scheme`. If y starts like t**alpha, so does
    f, and its extrapolation has an error of O(h**(1 + alpha)). `L1` and ``BDF(1)`` then keep
    order 1, and ``BDF(2)`` has min(2, 1 + alpha) (convergence/imex.py).

    Stability
    ---------
    A does not limit the step. f limits it about as in an explicit scheme. If increments zigzag, or
    grow while they turn within a few steps, the status of the run is `zigzag`.

    Source
    ------
    [CaoZengZhangKarniadakis2016], second-order extrapolation.

    Examples
    --------
    >>> import hereditary as hd
    >>> eq = hd.Equation(hd.Caputo(0.5), lambda t, y: -(y**3), [1.0], linear=[[-1.0]])
    >>> sol = hd.solve(eq, 1.0, 1000, scheme=hd.IMEX(hd.BDF(2)))
    >>> sol.stats["n_rhs"], sol.stats["n_factorised"]
    (1000, 1)
    """

    scheme: L1 | BDF
    solve: ClassVar[str] = "imex"
    takes_memory: ClassVar[bool] = False
    takes_tangents: ClassVar[bool] = False
    takes_switches: ClassVar[bool] = False

    def __post_init__(self) -> None:
        inner = self.scheme
        if not isinstance(inner, (L1, BDF)) or inner.order(0.5) > 2:
            refuse("scheme", "be hereditary.L1(), BDF(1) or BDF(2)", repr(inner))
        for name in ("takes_kernels", "takes_meshes", "meshes_up_to"):
            object.__setattr__(self, name, getattr(inner, name))

    @property
    def orders(self) -> tuple[float, float]:
        """Orders of the equations that `scheme` solves."""
        return self.scheme.orders

    def check_terms(self, system: System) -> None:
        """Refuse terms that `scheme` cannot solve, and equations without `linear`."""
        super().check_terms(system)
        if system.matrix is None:
            remedy = "Equation(terms, rhs, y0, linear=A), or take the scheme by itself"
            refuse("linear", "be given with IMEX", "None", remedy)

    def order(self, alpha: float, smoothness: str = "smooth") -> float:
        """Return the proven order of convergence at a fixed time; see Error.

        Parameters
        ----------
        alpha : float
            Highest order of the equation [-].
        smoothness : {"smooth", "singular"}
            Whether the solution is smooth at 0 or behaves like t**alpha there.
        """
        order = self.scheme.order(alpha, smoothness)
        return order if smoothness == "smooth" else min(order, 1 + alpha)

    def reduction(self, system: System) -> System | None:
        """Return the system whose Jacobian is the constant matrix alone."""
        matrix, structure = system.matrix, None
        if system.d > FEW and 2 * matrix.nnz < system.d**2:
            none = np.zeros(0, dtype=np.int64)
            structure = Structure.of(system.d, none, none, none, matrix)
        functions = system.functions._replace(jac_form=CONSTANT, jac_size=0)
        return replace(system, functions=functions, structure=structure, linear_alone=False)

    def plan(self, system: System, h: float) -> Plan:
        """Return tables and convolution for `system` with step h."""
        return replace(self.scheme.plan(system, h), slowest=SLOWEST)

    def mesh_plan(self, system: System, times: np.ndarray) -> Plan:
        """Return the plan on any mesh."""
        if not self.takes_meshes:
            return super().mesh_plan(system, times)
        return self.scheme.mesh_plan(system, times)
