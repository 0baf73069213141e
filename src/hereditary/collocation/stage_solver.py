"""Choice of a solver for the linear systems of collocation steps, and allocation of its arrays.

A step has s stages (nodes), an equation d components. `structure` is the sparsity of the Jacobian,
or None for a dense one. Components of one kind have the same terms.
"""

from functools import partial
from typing import Any, NamedTuple

import numpy as np

from ..compiled.callbacks import lapack_address
from ..compiled.jacobian import FEW
from ..compiled.jit import as_value, checked
from ..compiled.linalg import address_of_factors
from ..compiled.records import zeros
from ..compiled.sparse_solvers import SparseFactors
from ..equation.jacobian_structure import Structure
from .equations import Form
from .stages import (
    banded_stages,
    dense_stages,
    joint_banded,
    joint_dense,
    joint_sparse,
    no_stages,
    sparse_stages,
)
from .structures import N_CONTROL, STAGES_SIG, Stages

# Number of steps for which a slightly longer step is postponed, to reuse the factors of a dense
# Jacobian.
_HOLD = 1


class StageSolver(NamedTuple):
    """Solver of the linear systems of all stages, and its arrays."""

    solver: Any  # compiled function with the signature `STAGES_SIG`
    stages: Stages
    held: Any = None  # a Python object that compiled code calls by its address, kept alive


def has_stages(form: Form) -> bool:
    """Return whether steps reuse the factors of one Jacobian for all stages."""
    # for many components: for few a factorisation takes no longer than a solution
    return form.above_one.size > FEW


def stage_solver(
    structure: Structure | None, form: Form, s: int, at_edge: bool = False
) -> StageSolver:
    """Return the `StageSolver` of steps with s nodes, for the equations `form`."""
    # at_edge: a dense Jacobian at each node, structure None
    few = at_edge or not has_stages(form)
    eigenvectors = 0 if few or form.kinds.any() else lapack_address("dgeev")
    if eigenvectors == 0:
        return _joint_solver(structure, form, s, few)
    d = form.above_one.size
    solver = partial(_solver, form=form, s=s, lapack_values=eigenvectors)
    if structure is None:
        return solver(
            dense_stages,
            order=np.arange(d),
            jacobians=np.zeros((1, d, d)),
            factors=np.empty((s, 1, d), complex),
            dense=np.empty((2 + 2 * s, d, d)),
            lapack=lapack_address("dgehrd"),
            lapack_solve=lapack_address("dorghr"),
            lapack_balance=lapack_address("dgebal"),
            # varying orders change the factors in each step: a longer step is not postponed
            hold=0 if form.varying else _HOLD,
        )
    jacobians, band = structure.entries[None].copy(), structure.band
    if band is None:
        held = SparseFactors(structure, complex)
        return solver(
            sparse_stages, held=held, order=np.arange(d), jacobians=jacobians, python=held.address
        )
    return solver(
        banded_stages,
        order=band.order,
        jacobians=jacobians,
        factors=np.empty((s, d, 2 * band.lower + band.upper + 2), complex),
        lapack=lapack_address("zgbtrf"),
        lower=band.lower,
        upper=band.upper,
    )


def _joint_solver(structure: Structure | None, form: Form, s: int, few: bool) -> StageSolver:
    """Return the `StageSolver` for few components, or for components with different terms."""
    # one system of all d s unknowns; few components have a Jacobian at each node
    d, n = form.above_one.size, form.above_one.size * s
    if structure is None:
        return _solver(
            no_stages if few else joint_dense,
            form,
            s,
            order=np.arange(n),
            jacobians=np.zeros((s if few else 1, d, d)),
            joint=np.empty((n, n)),
            dense=np.empty((1, 2, n)),
            lapack=address_of_factors(n),
            hold=0 if few else _HOLD,
        )
    joint, band = structure.by_blocks(s), structure.band
    jacobians, entries = structure.entries[None].copy(), joint.entries.copy()
    if band is None:
        held = SparseFactors(joint, float)
        return _solver(
            joint_sparse,
            form,
            s,
            held,
            order=np.arange(n),
            jacobians=jacobians,
            joint=entries,
            python=held.address,
        )
    lower, upper = ((width + 1) * s - 1 for width in (band.lower, band.upper))
    return _solver(
        joint_banded,
        form,
        s,
        order=(band.order[:, None] * s + np.arange(s)).ravel(),
        jacobians=jacobians,
        joint=entries,
        dense=np.empty((1, n, 2 * lower + upper + 2)),
        lapack=lapack_address("dgbtrf"),
        lower=lower,
        upper=upper,
    )


def _solver(
    function: Any, form: Form, s: int, held: Any = None, *, order: np.ndarray, **given: Any
) -> StageSolver:
    """Return a `StageSolver` of a compiled function, whose other `Stages` fields are empty or 0."""
    n, d = int(form.kinds.max()) + 1, form.kinds.size
    stages = zeros(Stages, n=n, d=d, s=s, n_c=N_CONTROL)
    stages.above_one[form.kinds] = form.above_one
    stages.scales[:] = 1.0
    stages = stages._replace(order=order.astype(np.int64), kinds=form.kinds, **given)
    return StageSolver(as_value(function, STAGES_SIG), checked(stages), held)
