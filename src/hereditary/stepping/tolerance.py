"""Tolerances: what is asked of a scheme that chooses its steps, from the call to the march."""

from __future__ import annotations

from typing import Annotated, Any, NamedTuple, get_type_hints

import numpy as np

from ..compiled.jit import F8, I8, VEC
from ..equation.frame import Frame
from ..equation.system import System
from ..support.checks import count, positive, real_array, refuse, shown, whole, within

# Smallest relative tolerance. Below it, rounding in double precision decides the error.
TOLERANCE_FLOOR = 1e-12
# Tolerance relative to the size of a component, as fraction of rtol, if no atol is given.
OF_SIZE = 0.01


def _relative(name: str, rtol: Any) -> float:
    """Return the checked relative tolerance."""
    interval = f"[{TOLERANCE_FLOOR:g}, 0.1]"
    remedy = "write a number such as rtol=1e-6; below 1e-12 rounding decides"
    return within(name, rtol, TOLERANCE_FLOOR, 0.1, interval, remedy)


def _absolute(name: str, atol: Any) -> float | tuple[float, ...]:
    """Return the absolute tolerance: a checked number, or a tuple of numbers."""
    if not isinstance(atol, list | tuple) and np.ndim(atol) == 0:
        return positive(name, atol)
    return tuple(real_array(name, atol).tolist())


def _step_count(name: str, value: Any) -> int:
    """Return the checked number of steps, as compiled code can count them."""
    return min(count(name, whole(value)), int(np.iinfo(np.int64).max))


class Tolerance(NamedTuple):
    """Allowed errors of a run and limits of its steps: arguments of `solve`, and their checks.

    A march reads what `of_march` returns. A component y may err by ``atol + rtol |y| + by_size
    size``, where its size is the largest |y| so far.
    """

    rtol: Annotated[float, F8, _relative] = 1e-6
    # a number or one for each component, of a march (d,); None: relative to sizes
    atol: Annotated[float | tuple[float, ...] | np.ndarray | None, VEC, _absolute] = None
    modes: Annotated[float, F8, positive] = np.inf  # relative error of the modes, if below others
    max_step: Annotated[float, F8, positive] = np.inf  # [time]
    max_steps: Annotated[int, I8, _step_count] = 1_000_000
    by_size: float = 0.0  # of a march

    def asked(self, n: int, **given: Any) -> Tolerance:
        """Return this tolerance with checked values for all that is given, unless it is None."""
        # n: number of components of y
        given = {name: value for name, value in given.items() if value is not None}
        found = {name: _CHECKS[name](name, value) for name, value in given.items()}
        atol = found.get("atol")
        if isinstance(atol, tuple) and not (np.shape(atol) == (n,) and min(atol) > 0):
            required = f"be a positive number, or one for each of the {n} components of y"
            refuse("atol", required, shown(atol))
        return self._replace(**found)

    def of_march(self, system: System, frame: Frame) -> Tolerance:
        """Return the tolerance of the d components of a system that is marched."""
        # frame: of the user's components
        if self.atol is None:
            return self._replace(atol=np.zeros(system.d), by_size=OF_SIZE * self.rtol)
        return self._replace(atol=system.spread(frame.doubled(np.asarray(self.atol))))

    def times(self, factor: float) -> Tolerance:
        """Return the tolerance of a march with allowed errors multiplied by a factor."""
        rtol, by_size = factor * self.rtol, factor * self.by_size
        return self._replace(rtol=rtol, atol=factor * np.asarray(self.atol), by_size=by_size)

    @property
    def least(self) -> float:
        """Return the allowed error at y = 0 of the component with the smallest one."""
        return float(np.asarray(self.atol).min()) + self.by_size

    def at(self, y: np.ndarray, sizes: np.ndarray) -> np.ndarray:
        """Return the allowed errors at y (d,) of components with these sizes (d,)."""
        return self.rtol * np.abs(y) + np.asarray(self.atol) + self.by_size * sizes

    def sizes_of(self, sizes: np.ndarray) -> np.ndarray:
        """Return the sizes (d,) that the errors refer to: those given, or atol / rtol."""
        return sizes if self.by_size > 0 else np.asarray(self.atol) / (OF_SIZE * self.rtol)


# Check of each field that is an argument, ``check(name, value)``.
_CHECKS: dict[str, Any] = {
    name: getattr(hint, "__metadata__", (None,))[-1]
    for name, hint in get_type_hints(Tolerance, include_extras=True).items()
}
