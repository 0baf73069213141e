"""Room for the stages of collocation steps of many components."""

from typing import Any, NamedTuple

import numpy as np
from numba.extending import get_cython_function_address

from .._jit import as_value
from ..compiled.newton import KEPT_FROM
from ..compiled.stages import banded_stages, dense_stages, no_stages, sparse_stages
from ..compiled.structures import N_CONTROL, STAGES_SIG, Stages
from ..superlu import SparseFactors

# Steps of one length with a dense Jacobian before a longer one is worth new factors.
_HOLD = 1


class StageSolver(NamedTuple):
    """Solver of the systems of all stages and its room; `held` keeps alive what enters Python."""

    solver: Any
    stages: Stages
    held: Any = None

    @property
    def many(self):
        """Whether steps are solved stage by stage, and not as one system."""
        return self.stages.order.size > 0


def has_stages(form):
    """Whether steps of these equations are solved stage by stage.

    That asks for many components that share their terms: of few, one system takes no longer.
    """
    return form.second.size > KEPT_FROM and not form.kinds.any()


def stage_solver(structure, d, s, many):
    """Return the `StageSolver` of steps with s nodes for d components, or one for no stages."""
    if not many:
        return _solver(no_stages, (0, 0, 0), np.arange(0), s, np.zeros((0, 0)))
    if structure is None:
        places = _lapack("dgehrd", "dorghr")
        how = {"lapack": places[0], "lapack_solve": places[1], "hold": _HOLD}
        dense = np.empty((2 + 2 * s, d, d))
        return _solver(
            dense_stages, (s, 1, d), np.arange(d), s, np.zeros((d, d)), dense=dense, **how
        )
    jacobian, band = structure.entries.copy(), structure.band
    if band is None:
        held = SparseFactors(structure, complex)
        how = {"python": held.address}
        found = _solver(sparse_stages, (0, 0, 0), np.arange(d), s, jacobian, **how)
        return found._replace(held=held)
    how = {"lapack": _lapack("zgbtrf")[0]}
    shape = (s, d, 2 * band.lower + band.upper + 2)
    widths = {"lower": band.lower, "upper": band.upper}
    return _solver(banded_stages, shape, band.order, s, jacobian, **how, **widths)


def _lapack(*names):
    """Return the addresses of functions of LAPACK."""
    return [get_cython_function_address("scipy.linalg.cython_lapack", name) for name in names]


def _solver(function, shape, order, s, jacobian, **numbers):
    """Return a `StageSolver` with room for s systems."""
    numbers.setdefault("dense", np.zeros((0, 0, 0)))
    complex_room = [np.zeros(size, complex) for size in (s, (s, s), (s, s))]
    defaults = {"lower": 0, "upper": 0, "lapack": 0, "lapack_solve": 0, "python": 0, "hold": 0}
    shifts, back, forth = complex_room
    stages = Stages(
        factors=np.empty(shape, complex),
        order=order.astype(np.int64),
        pencil=np.zeros((2, s, s)),
        shifts=shifts,
        back=back,
        forth=forth,
        jacobian=jacobian,
        control=np.zeros(N_CONTROL),
        **(defaults | numbers),
    )
    return StageSolver(as_value(function, STAGES_SIG), stages)
