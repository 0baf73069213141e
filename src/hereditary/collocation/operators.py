"""Matrices of a collocation step, from nodal values to the rows of its equations.

Row c < d is p of component c, row d + c the terms subtracted from its right-hand side f. The
primary unknown p is y, or y' for orders above 1. Components of one kind have the same terms and
share their matrices. Letters of shapes: d components, s nodes, R = d or 2 d rows, k tangents.
"""

from ..compiled.jit import inner
from ..compiled.linalg import clear_matrix

# Numbers of the integrands f, p, y and p', of convolution terms and of arrays of nodal values.
FORCE = 0  # f
PRIMARY = 1  # p
POSITION = 2  # y
SLOPE = 3  # p', if a term has it
# Index, in place of that of an order or kernel, of a term that is the integrand itself.
ITSELF = -1


@inner
def assemble_operators(h, equations, rule, local, operators):
    """Assemble the matrices from nodal values to all rows for a step of length h."""
    # local (n_k, s, s): convolutions with n_k general kernels and varying orders over it. p' is the
    # derivative of the polynomial through p at the start and at the nodes.
    # integrals (n_a, s, s): of n_a fractional orders; inverse (s, s): of the integrals of order 1
    integrals, inverse, implicit = rule.integrals, rule.inverse, equations.implicit
    matrices, start_weights, constant = (
        operators.matrices, operators.start_weights, operators.constant
    )  # fmt: skip
    terms, orders, offsets = equations.terms, equations.orders, equations.offsets
    for kind in range(matrices.shape[0]):
        for q in range(matrices.shape[1]):
            clear_matrix(matrices[kind, q])
    clear_matrix(start_weights)
    for column in range(constant.shape[0]):
        clear_matrix(constant[column])
    s, d, kinds = constant.shape[2], equations.above_one.shape[0], equations.kinds
    n_kinds = number_of(kinds)
    for n in range(terms.shape[0]):
        c, q, k = terms[n].row, terms[n].integrand, terms[n].index
        kind = kinds[c % d]
        fresh, row = first_of_kind(kinds, kind) == c % d, c // d * n_kinds + kind
        if not fresh and not any_offset(offsets, n):
            continue
        factor = terms[n].coefficient
        convolution = integrals[0]
        if k >= orders.shape[0]:
            convolution = local[k - orders.shape[0]]
        elif k >= 0:
            convolution = integrals[k]
            factor *= h ** orders[k]
        for i in range(s):
            for j in range(s):
                weight = factor * convolution[i, j]
                if k == ITSELF:
                    weight = factor if i == j else 0.0
                if q == SLOPE:
                    for e in range(s if fresh else 0):
                        matrices[row, PRIMARY, i, e] += weight * inverse[j, e] / h
                        start_weights[row, i] -= weight * inverse[j, e] / h
                    continue
                if fresh:
                    matrices[row, q, i, j] += weight
                for column in range(offsets.shape[0]):
                    constant[column, c, i] -= weight * offsets[column, n]
    for kind in range(n_kinds):
        c = first_of_kind(kinds, kind)
        if implicit[c] != 0:
            set_implicit_row(n_kinds, kind, equations.divisors[c], matrices)
    eliminate_operators(n_kinds, matrices)
    set_columns(operators)


@inner
def set_columns(operators):
    """Set the fields of `Operators` that follow from its matrices: columns, alone and sums."""
    # products with the transposed matrices, columns, are vectorised
    matrices, columns, alone, sums = (
        operators.matrices, operators.columns, operators.alone, operators.sums
    )  # fmt: skip
    alone[:], sums[:], s = 1, 0.0, matrices.shape[2]
    for k in range(matrices.shape[0]):
        for q in range(3):
            for i in range(s):
                for j in range(s):
                    value = matrices[k, q, i, j]
                    columns[k, q, j, i] = value
                    if q == FORCE:
                        sums[k, i] += value
                    elif value != 0.0:
                        alone[k] = 0


@inner
def first_of_kind(kinds, kind):
    """Return the number of the first component of a kind; kinds (d,)."""
    c = 0
    while kinds[c] != kind:
        c += 1
    return c


@inner
def any_offset(offsets, n):
    """Return whether term n has a nonzero constant in `offsets`, for the orbit or a tangent."""
    found = False
    for column in range(offsets.shape[0]):
        found = found or offsets[column, n] != 0.0
    return found


@inner
def number_of(kinds):
    """Return how many kinds of components there are; kinds (d,) has that of each component."""
    most = 0
    for c in range(kinds.shape[0]):
        most = max(most, kinds[c])
    return most + 1


@inner
def set_implicit_row(n_kinds, c, divisor, matrices):
    """Set the row of p for an implicit kind c: p plus right-hand side minus terms."""
    # the difference is over the coefficient of p in the terms at the last node, at least divisor
    s = matrices.shape[2]
    size = max(abs(matrices[n_kinds + c, PRIMARY, s - 1, s - 1]), divisor)
    for i in range(s):
        matrices[c, PRIMARY, i, i] = 1.0
        matrices[c, FORCE, i, i] = 1.0 / size if size > 0.0 else 1.0


@inner
def subtract_matvec(matrix, vector, out):
    """Compute out -= matrix @ vector."""
    for i in range(matrix.shape[0]):
        for j in range(matrix.shape[1]):
            out[i] -= matrix[i, j] * vector[j]


@inner
def subtract_matmul(left, right, out):
    """Compute out -= left @ right."""
    for i in range(left.shape[0]):
        for k in range(left.shape[1]):
            for j in range(right.shape[1]):
                out[i, j] -= left[i, k] * right[k, j]


@inner
def eliminate_operators(n_kinds, matrices):
    """Insert the terms of rows d + c, which are subtracted from f, into the matrices of rows c."""
    for c in range(matrices.shape[0] - n_kinds):
        for q in (PRIMARY, POSITION):
            subtract_matmul(matrices[c, FORCE], matrices[n_kinds + c, q], matrices[c, q])


@inner
def eliminate_known(kinds, matrices, known):
    """Insert the known parts of rows d + c into the known parts of rows c; known (1 + k, R, s)."""
    d = kinds.shape[0]
    for column in range(known.shape[0]):
        for c in range(known.shape[1] - d):
            subtract_matvec(matrices[kinds[c], FORCE], known[column, d + c], known[column, c])


@inner
def subtract_from_forces(kinds, matrices, known, values):
    """Subtract the terms of rows d + c from f at the nodes, for the orbit and tangents."""
    # values (n_columns, n_q, d, s): integrands at the nodes, f of which is changed; known
    # (n_columns, R, s): known part of the rows
    d, n_kinds = kinds.shape[0], number_of(kinds)
    for column in range(values.shape[0]):
        for c in range(known.shape[1] - d):
            force = values[column, FORCE, c]
            for i in range(force.shape[0]):
                force[i] -= known[column, d + c, i]
            for q in (PRIMARY, POSITION):
                subtract_matvec(matrices[n_kinds + kinds[c], q], values[column, q, c], force)
