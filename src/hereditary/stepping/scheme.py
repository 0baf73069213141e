"""The base class of schemes: their order, their plan, and the equations that they solve."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, ClassVar

import numpy as np

from ..equation.system import System
from ..support.checks import one_of, refuse


def check_smoothness(smoothness: str) -> None:
    """Refuse anything but "smooth" and "singular": proven orders differ for these two solutions."""
    one_of("smoothness", smoothness, ("smooth", "singular"), 'be "smooth" or "singular"')


class Scheme(ABC):
    """A scheme that advances the solution by one step; each subclass is a final frozen dataclass.

    A subclass declares its proven order, its plan and the equations that it accepts. `solve` is the
    method that solves a step, a key of `MARCHES` in given/march.py. The study
    convergence/capabilities.py makes a table of the equations that each scheme accepts.

    Attributes
    ----------
    several_terms : bool
        Whether a component may have several terms, up to the highest order `several_up_to`.
    components_differ : bool
        Whether components may have different terms.
    takes_kernels, takes_varying, takes_memory : bool
        Whether terms may have kernels other than Caputo's, may have orders that vary, and may be
        memory that f reads.
    takes_algebraic : bool
        Whether components may have no term, so that their equations are algebraic, 0 = f.
    takes_meshes, takes_tangents : bool
        Whether steps may differ in length, for orders up to `meshes_up_to`. Whether the scheme also
        solves for tangents.
    takes_switches : bool
        Whether f may jump where a switch function changes its sign.
    plans_by_terms : bool
        Whether a plan on uniform steps depends on terms, initial values and step alone, and not on
        the right-hand side. Then equations that differ in the rest share it.
    """

    solve: ClassVar[str] = "newton"
    # whether the history of a term of order above 1 contains the part t x'(0) of the solution
    whole: ClassVar[bool] = False
    several_terms: ClassVar[bool] = True
    several_up_to: ClassVar[float] = 2.0
    components_differ: ClassVar[bool] = True
    takes_kernels: ClassVar[bool] = False
    takes_varying: ClassVar[bool] = False
    takes_memory: ClassVar[bool] = True
    takes_algebraic: ClassVar[bool] = False
    takes_tangents: ClassVar[bool] = True
    takes_switches: ClassVar[bool] = True
    takes_meshes: ClassVar[bool] = False
    meshes_up_to: ClassVar[float] = 1.0
    plans_by_terms: ClassVar[bool] = False

    @property
    def orders(self) -> tuple[float, float]:
        """Interval (low, high] of the highest order of equations that the scheme solves."""
        return 0.0, 2.0

    @property
    def is_map(self) -> bool:
        """Whether the equation is a map, so that steps have no error and no stability limit."""
        return False

    def check_terms(self, system: System) -> None:
        """Refuse a system with orders or terms that the scheme does not accept."""
        remedy = "use ExplicitCaputo, L1 or Collocation"
        name = type(self).__name__
        if system.reads:
            if not self.takes_memory:
                required = f"need no memory that the right-hand side reads with {name}"
                of_memory = [op for op, c in system.left if np.any(c[system.is_memory])]
                got = " and ".join(map(str, of_memory))
                refuse("terms", required, got, remedy)
            remedy = "use ExplicitCaputo or L1"
        if system.has_algebraic and not self.takes_algebraic:
            required = f"leave every component at least one nonzero term with {name}"
            got = f"none for component {np.flatnonzero(system.algebraic)[0]}"
            refuse("terms", required, got, "solve algebraic rows with rtol=")
        for operator, _ in () if system.constant else system.left:
            if operator.kernel is not None and not self.takes_kernels:
                refuse("terms", f"be Caputo operators with {name}", f"{operator}", remedy)
            if operator.varies and not self.takes_varying:
                refuse("terms", f"have constant orders with {name}", f"{operator}", remedy)
        highest = system.highest_order
        if highest > self.orders[1]:
            required = f"be at most {self.orders[1]:g} for {self!r}"
            refuse("order", required, highest, "use BDF(2) or L1")
        terms = 1 if self.several_terms else max(map(len, system.distinct[0]))
        if terms > 1:
            refuse("terms", f"hold one term for each component with {name}", f"{terms}", remedy)

    @abstractmethod
    def order(self, alpha: float, smoothness: str = "smooth") -> float:
        """Return the proven order of convergence at a fixed time for an equation of order alpha."""

    @abstractmethod
    def plan(self, system: System, h: float) -> Any:
        """Make the `Plan` (given/plan.py) for `system` with step h."""

    def reduction(self, system: System) -> System | None:
        """Return a system to solve instead of `system`, or None; its first d components are y."""
        return None

    def mesh_plan(self, system: System, times: np.ndarray) -> Any:
        """Make the `Plan` for `system` on a mesh, whose steps may differ in length."""
        if self.takes_meshes:
            raise NotImplementedError(f"{type(self).__name__}.mesh_plan")
        required = f"be left out with {type(self).__name__}, which takes uniform steps"
        refuse("mesh", required, f"{times.size - 1} steps", "or use L1 or L2")
