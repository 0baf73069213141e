"""Reasons why a march on given steps cannot go on, and remedies for steps that are unstable."""

from __future__ import annotations

import numpy as np

from ..compiled.jacobian import FEW
from ..equation.system import System
from ..stepping.scheme import Scheme
from ..stepping.status import NOT_FINITE, Ending, Status
from .block import BLOWN_UP, NOT_SOLVED

# Remedy if not even the first step is solved.
_FROM_EDGE = "where y begins at an edge of the domain of the right-hand side, use rtol="


def ending(status: int, scheme: Scheme, n: int, tried: np.ndarray, f: np.ndarray) -> Ending | None:
    """Return why a march with this status cannot go on after n steps; None if it can."""
    # it took the right-hand side last at y = tried (d,), where it is f (d,)
    statuses = {BLOWN_UP: Status.BLOWN_UP, NOT_SOLVED: Status.NOT_SOLVED}
    if status not in statuses:
        return None
    found, unsolved, newton = [], status == NOT_SOLVED, scheme.solve == "newton"
    if newton and np.isfinite(tried).all() and not np.isfinite(f).all():
        found.append(NOT_FINITE)
    if newton and unsolved and n == 0:
        found.append(_FROM_EDGE)
    if scheme.solve == "imex" and unsolved:
        found.append("the matrix of a step is singular")
    return Ending(statuses[status], "; ".join(found))


def remedy_of(
    system: System, scheme: Scheme, h: float, zigzag: int, growth: int, diverged: int
) -> str:
    """Return a clause of a message: how steps h showed instability, and what to use instead."""
    # zigzag, growth, diverged: steps at which given/watch.py noted each, or -1
    found, start = [], system.frame.start
    if zigzag >= 0:
        found.append(f"a step-to-step zigzag had lasted at t = {start + zigzag * h:g}")
    if growth >= 0:
        at = f"by t = {start + growth * h:g}"
        found.append(f"increments that turn within a few steps had grown {at}")
    if diverged >= 0:
        at = f"at t = {start + diverged * h:g}"
        found.append(f"corrections had grown from each sweep to the next for steps {at}")
    seen = " and ".join(found) + f" at h = {h:g}; take smaller steps"
    if scheme.solve == "newton":
        return seen
    implicit = "BDF(2)" if system.constant else "L1()"
    if system.n_solved > FEW and system.structure is None:
        implicit += f", with linear= or bandwidth= for {system.n_solved} components"
    return f"{seen}, or Collocation() with rtol=1e-6, or {implicit}"
