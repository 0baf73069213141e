"""Arrays that one call of the compiled march works on, kept between calls if components are few."""

from typing import Any, NamedTuple

import numpy as np

from ..compiled.jit import checked
from ..compiled.records import zeros
from ..support.pool import Pool
from .equations import Form
from .stage_solver import StageSolver, stage_solver
from .structures import ModeWeights, Operators, StageWorkspace

# Number of workspaces that remain in storage. One of nine components has 0.5 MB for the 24 nodes of
# a first step.
_WORKSPACES_MAX = 8


class Workspace(NamedTuple):
    """A solver of the stages, matrices and work arrays, which a march overwrites."""

    solver: StageSolver
    operators: Operators
    weights: ModeWeights
    workspace: StageWorkspace


# Workspaces that no march uses at present.
spare_workspaces = Pool(_WORKSPACES_MAX)


def take_workspace(
    form: Form, modes: np.ndarray, s: int, offsets: bool, solver: StageSolver | None = None
) -> tuple[Any, Workspace]:
    """Return a pair of a key and a `Workspace`; the pair is the argument of `give_back`."""
    # modes (1 + k, R, M); offsets: whether any differs from 0. A solver that keeps factors between
    # steps has a new workspace, and the key None.

    def make() -> Workspace:
        own = solver or stage_solver(None, form, s)
        d, jacobians, n_kinds = form.kinds.size, own.stages.jacobians, int(form.kinds.max()) + 1
        sizes = {"R": form.n_rows, "K": form.n_rows // d * n_kinds, "m": 2, "d": d, "s": s}
        sizes |= {"k": len(modes) - 1, "M": modes.shape[2]}
        sizes |= {"n_q": form.n_integrands, "K_m": modes.shape[1] // d * n_kinds}
        work = zeros(StageWorkspace, **sizes)
        if len(jacobians) == 1:  # the stages of many components share one Jacobian
            jacobians = np.zeros((s if len(modes) > 1 else 0, *jacobians.shape[1:]))
        work = work._replace(nodal_change=work.change.reshape(d, s), jacobians=jacobians)
        weights = zeros(ModeWeights, R_o=modes.shape[1] if offsets else 0, **sizes)
        operators = zeros(Operators, **sizes)
        return Workspace(own, checked(operators), checked(weights), checked(work))

    if solver is not None:
        return None, make()
    taken = spare_workspaces.acquire((form.layout, *modes.shape, s, offsets), make)
    taken[1].solver.stages.control[:] = 0.0
    return taken


def give_back(taken: tuple[Any, Workspace]) -> None:
    """Keep a workspace for later marches."""
    if taken[0] is not None:
        spare_workspaces.release(taken)
