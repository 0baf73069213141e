"""One record is f: a user's functions, and what stands around them, as named fields.

The record `Functions` gives ``f(t, x) = B x + A g(t + start, D(t, S x))``. The user's function is
g. The matrices B, A and S are those of a map; there may be several maps, each around the last one.
D adds the rows of memory that are delays. With switches, t and x are first moved to one side of
each. `set_force` calls f: directly, if nothing stands around g, and else by `compose`, which is the
same machine code for all equations. So only a user's own functions are compiled for an equation.

Something further that stands around g is a field of `Functions` and a line of `_enter` or `_inner`.
No other file knows the fields.
"""

import ctypes
from collections.abc import Sequence
from functools import lru_cache, reduce
from types import SimpleNamespace
from typing import Annotated, Any, NamedTuple

import numpy as np
from numba import config, types
from numba.core import cgutils
from numba.extending import intrinsic
from numpy.typing import ArrayLike

from .callbacks import PythonRaised, call_at
from .delayed_values import Delays, look_up_all
from .jit import (
    F8,
    RHS_SIG,
    VEC,
    Integers,
    Matrix,
    Vector,
    as_value,
    compiled_type,
    inner,
    plug_in,
)
from .records import zeros
from .reference import FunctionField, Reference

# What g reads: y, or memory too, or nothing, because it is 0.
OF_Y, OF_MEMORY, ZERO = range(3)
# What its Jacobian is: left out, or given, or 0.
BY_DIFFERENCES, GIVEN, CONSTANT = range(3)

# Coefficients of a polynomial, at least as many as a first step has nodes and one more.
_MOST_COEFFICIENTS = 64

# Values of a switch this small, relative to y, may be on either side by rounding.
_SIDE_ROUNDING = 1e-9
# Change of y in difference quotients of a switch, relative to y.
_SWITCH_INCREMENT = 1e-7
# Distance, relative to y, at which a run begins beside the surface of a switch.
_SURFACE_DISTANCE = 1e-12
# Least distance from the surface of a switch at which a run begins.
_MIN_SURFACE_DISTANCE = 1e-300
# Newton iterations towards the surface of a switch that is not linear in y.
_SURFACE_NEWTON_MAXITER = 4


class Maps(NamedTuple):
    """Matrices S, B and A of L maps, the outermost one first.

    A matrix of n rows is n + 1 offsets, followed by pairs of column and value, row by row. An
    offset is the position, from the beginning of the matrix, at which the pairs of a row begin. The
    last offset is the position at which all pairs end. S and A are empty if what is inside reads
    the first components, and gives the last values.
    """

    numbers: Annotated[Vector, "."]  # all matrices
    sizes: Annotated[Integers, "L+1"]  # numbers of components around each map, and inside the last
    starts: Annotated[Integers, "3*L"]  # index at which S, B and A of each map begin


# Columns of `Switches.blends`.
CENTER, WIDTH = range(2)


class Switches(NamedTuple):
    """Functions of which f is evaluated on one side only, or as a blend of both sides.

    A blend has the share (1 + u) / 2 of the side 1, and the rest of the other. Here u is the value
    of the function less the center, over the width.
    """

    functions: Annotated[Integers, "n"]  # addresses of their machine code
    signs: Annotated[Vector, "n"]  # the sides
    blends: Annotated[Matrix, "n 2"]  # center and width; a width of 0 is no blend
    weight: Annotated[Vector, "1"]  # of the present sides in all blends
    n_read: int  # number of components that they read
    n_inside: int  # number of maps inside of them


class Functions(NamedTuple):
    """A user's functions and parameters, and what stands around them.

    What is not called is `_ABSENT`.
    """

    params: Annotated[Vector, "p"]  # the user's parameters
    rhs: Annotated[Any, FunctionField(RHS_SIG)]  # g
    jac: Annotated[Any, FunctionField(RHS_SIG)]  # the Jacobian of g
    jac_memory: Annotated[Any, FunctionField(RHS_SIG)]  # that by memory
    in_python: Annotated[Integers, "3"]  # C functions in their place, which enter Python, or 0
    rows: Annotated[Integers, "k"]  # of entries of a Jacobian of few components; none if dense
    columns: Annotated[Integers, "k"]  # of these entries
    places: Annotated[Integers, "k"]  # their index in the values of the user, -1 for none
    maps: Maps
    delays: Delays
    switches: Switches
    start: float  # time of the user at time 0
    n: int  # number of values of g, in real numbers
    form: int  # what g reads
    jac_form: int  # what its Jacobian is
    jac_size: int  # number of values of the user's Jacobian

    @property
    def bare(self) -> bool:
        """Whether nothing but a start stands around g, which is compiled and reads no memory."""
        layers = self.maps.starts.size + self.delays.rows.size + self.switches.signs.size
        return self.form == OF_Y and not (layers or self.in_python[0])

    @property
    def code(self) -> tuple[Any, ...]:
        """The user's compiled functions."""
        return self.rhs, self.jac, self.jac_memory

    @property
    def has_jac(self) -> bool:
        """Whether there is a Jacobian; otherwise it comes from differences."""
        return self.jac_form != BY_DIFFERENCES

    def without_jac(self) -> "Functions":
        """Return the record whose Jacobian comes from differences."""
        return self._replace(jac_form=BY_DIFFERENCES)

    def for_a_march(self) -> "Functions":
        """Return the record with arrays of its own for what changes during a march."""
        delays, switches = self.delays, self.switches
        if delays.rows.size:
            delays = Delays(*[array.copy() for array in delays])
        arrays = [switches.signs, switches.blends, switches.weight]
        signs, blends, weight = [array.copy() for array in arrays]
        switches = switches._replace(signs=signs, blends=blends, weight=weight)
        return self._replace(switches=switches, delays=delays)


_FUNCTIONS = Reference(compiled_type(Functions))
# Signature of ``compose(functions, t, x, out, params)``, which sets out = f(t, x).
_COMPOSE_SIG = types.void(_FUNCTIONS, F8, VEC, VEC, VEC)


class Force(NamedTuple):
    """f as marches call it; `bare` is 1 if `compose` is not needed."""

    functions: Functions
    compose: Annotated[Any, FunctionField(_COMPOSE_SIG)]
    bare: int


# What stands for functions that are not called.
_ABSENT = SimpleNamespace(address=0, of_signature=RHS_SIG)
_NOT_COMPOSED = SimpleNamespace(address=0, of_signature=_COMPOSE_SIG)


@lru_cache
def no_functions() -> Functions:
    """Return a record without functions, parameters, and whatever stands around functions."""
    none, nothing = np.zeros(0, dtype=np.int64), np.zeros(0)
    return Functions(
        params=nothing,
        rhs=_ABSENT,
        jac=_ABSENT,
        jac_memory=_ABSENT,
        in_python=np.zeros(3, dtype=np.int64),
        rows=none,
        columns=none,
        places=none,
        maps=Maps(nothing, np.zeros(1, dtype=np.int64), none),
        delays=zeros(Delays, k=0, n=0, m=0, d=0),
        switches=zeros(Switches, n=0),
        start=0.0,
        n=0,
        form=ZERO,
        jac_form=CONSTANT,
        jac_size=0,
    )


def of_user(params: np.ndarray, n: int, **fields: Any) -> Functions:
    """Return the record of a user's functions, by the fields of `Functions` that they have.

    What is not given is 0, left out or empty.
    """
    return no_functions()._replace(params=params, n=n, **fields)


def force_of(functions: Functions) -> Force:
    """Return f as marches call it."""
    how = _NOT_COMPOSED if functions.bare else as_value(compose, _COMPOSE_SIG)
    return Force(functions, how, int(functions.bare))


def mapped(
    functions: Functions,
    n: int,
    n_f: int,
    b: ArrayLike = (),
    a: ArrayLike | None = None,
    s: ArrayLike | None = None,
) -> Functions:
    """Return the record of ``B x + A f(t, S x)``, with the Jacobian ``B + A J S``.

    Parameters
    ----------
    functions : Functions
        Those of f, whose Jacobian is J.
    n, n_f : int
        Number of components x. Number of values that f reads, which is that of its results too.
    b, a, s : array_like, shape (k, 3), optional
        Matrices B, A and S as k entries (row, column, value); values of equal row and column add
        up. B is 0 by default. By default f reads the first components, and gives the last values.
    """
    own, ones = np.arange(n_f), np.ones(n_f)
    first, last = np.c_[own, own, ones], np.c_[n - n_f + own, own, ones]
    s, a = first if s is None else s, last if a is None else a
    parts = [_by_rows(s, n_f), _by_rows(b, n), _by_rows(a, n)]
    if np.array_equal(s, first) and np.array_equal(a, last):
        parts[0] = parts[2] = np.zeros(0)
    inside = functions.maps
    begins = inside.numbers.size + np.cumsum([0, parts[0].size, parts[1].size])
    maps = Maps(
        np.concatenate([inside.numbers, *parts]),
        np.concatenate([[n, n_f], inside.sizes[1:]]),
        np.concatenate([begins, inside.starts]),
    )
    return functions._replace(maps=maps)


def _by_rows(triples: ArrayLike, n: int) -> np.ndarray:
    """Return a matrix of n rows as offsets and pairs, from its entries (row, column, value)."""
    triples = np.reshape(triples, (-1, 3))
    triples = triples[np.argsort(triples[:, 0], kind="stable")]
    begins = n + 1 + 2 * np.searchsorted(triples[:, 0], np.arange(n + 1))
    return np.concatenate([begins, triples[:, 1:].ravel()])


def with_delays(functions: Functions, rows: Sequence[int], firsts: np.ndarray) -> Functions:
    """Return the record with rows of memory that are delays, whose values are constant at first.

    `rows` (k,) has the number of a delay for each row of memory, or -1. `firsts` (., d) are the
    values of each delay.
    """
    n, d = firsts.shape
    delays = zeros(Delays, k=len(rows), n=n, m=n, d=d)
    delays.rows[:], delays.widths[:], delays.factors[:] = rows, 1, 1.0
    delays.ranges[2::4], delays.ranges[3::4] = np.arange(n), np.arange(1, n + 1)
    delays.windows[:] = -1.0
    delays.counts[:] = n, firsts.size, n
    numbers, work = firsts.ravel().copy(), np.zeros(_MOST_COEFFICIENTS)
    return functions._replace(
        delays=delays._replace(numbers=numbers, places=d * np.arange(n), polynomials=work)
    )


def with_switches(
    functions: Functions, switches: Sequence[Any], sides: Sequence[float], n_read: int
) -> Functions:
    """Return the record of an f that is evaluated on one side of each switch, 1 or -1.

    The switches are compiled functions that read `n_read` components. The caller keeps them alive.
    """
    places = np.array([place_of(switch) for switch in switches], dtype=np.int64)
    blends, inside = np.zeros((places.size, 2)), functions.maps.sizes.size - 1
    found = Switches(places, np.array(sides), blends, np.ones(1), n_read, inside)
    return functions._replace(switches=found)


if config.DISABLE_JIT:  # type: ignore[attr-defined]

    def place_of(fun: Any) -> int:
        """Return the number by which `function_at` finds a function."""
        return id(fun)

    def function_at(place: int) -> Any:
        """Return the function of a number of `place_of`."""
        return ctypes.cast(int(place), ctypes.py_object).value

else:

    def place_of(fun: Any) -> int:
        """Return the number by which `function_at` finds a function, its address."""
        return int(fun.address)

    @intrinsic
    def function_at(typing_context, place):
        """Return the function of a number of `place_of`."""

        def codegen(context, builder, signature, arguments):
            return builder.inttoptr(arguments[0], context.get_value_type(signature.return_type))

        return FunctionField(RHS_SIG)(types.int64), codegen


def _views_of(typing_context, z, n, unit):
    """Return the first of n rows of z, the others, and all of them, with numbers like `unit`.

    Compiled code keeps z alive, and counts no references to the views. With NumPy's slices and
    shapes they would take as long to compile as a user's function.
    """
    kinds = types.Tuple([types.Array(unit, axes, "C") for axes in (1, 2, 2)])

    def codegen(context, builder, signature, values):
        source, n = context.make_array(z)(context, builder, values[0]), values[1]
        number, word = context.get_data_type(unit), n.type
        size = word(context.get_abi_sizeof(number))
        width = builder.udiv(builder.mul(source.nitems, source.itemsize), builder.mul(n, size))
        data = builder.bitcast(source.data, number.as_pointer())
        places = data, builder.gep(data, [width]), data
        shapes, arrays = ([width], [builder.sub(n, word(1)), width], [n, width]), []
        for kind, place, shape in zip(kinds, places, shapes, strict=True):
            array = context.make_array(kind)(context, builder)
            strides = [builder.mul(width, size), size][-len(shape) :]
            array.data, array.itemsize, array.nitems = place, size, reduce(builder.mul, shape)
            array.shape, array.strides = (cgutils.pack_array(builder, a) for a in (shape, strides))
            arrays.append(array._getvalue())
        return context.make_tuple(builder, kinds, arrays)

    return kinds(z, types.intp, unit), codegen


views_of: Any = intrinsic(_views_of)


@inner
def set_force(force, t, x, out):
    """Set out = f(t, x), both (n,)."""
    set_force_with(force, t, x, out, force.functions.params)


@inner
def set_force_with(force, t, x, out, params):
    """Set out = f(t, x), with other parameters (p,) than those of the record."""
    functions = force.functions
    if force.bare == 1:
        functions.rhs(t + functions.start, x, out, params)
    else:
        force.compose(functions, t, x, out, params)


@plug_in
def compose(functions, t, x, out, params):
    """Set out = f(t, x), where something stands around the user's function."""
    switches, corners = functions.switches, 1 << n_blends(functions)
    if corners == 1:
        _compose(functions, t, x, out, params)
        return
    part = np.empty(out.shape[0])
    for i in range(out.shape[0]):
        out[i] = 0.0
    for corner in range(corners):
        switches.weight[0], sides = 1.0, corner
        for number in range(switches.signs.shape[0]):
            if switches.blends[number, WIDTH] > 0.0:
                switches.signs[number], sides = 1.0 - 2.0 * (sides % 2), sides // 2
        _compose(functions, t, x, part, params)
        for i in range(out.shape[0]):
            out[i] += switches.weight[0] * part[i]


@inner
def n_blends(functions):
    """Return the number of switches of which f is a blend of both sides."""
    blends, found = functions.switches.blends, 0
    for number in range(blends.shape[0]):
        found += int(blends[number, WIDTH] > 0.0)
    return found


@inner(allocates=True)
def _compose(functions, t, x, out, params):
    """Set out = f(t, x) on the present side of each switch."""
    maps = functions.maps
    n_maps = maps.sizes.shape[0] - 1
    if _are_outside(functions):
        x = _copied(x)
        t = _to_the_side(functions, t, x)
    if n_maps == 0:
        _inner(functions, t, x, out, params)
        return
    if n_maps == 1 and functions.form == ZERO and _in_place(maps, 0):
        _combine(maps, 0, x, out[:0], out)
        return
    moved_inside = functions.switches.signs.shape[0] > 0 and not _are_outside(functions)
    if n_maps == 1 and _in_place(maps, 0) and not moved_inside:
        n_f = maps.sizes[1]
        force = out[out.shape[0] - n_f :]
        _inner(functions, t, x[:n_f], force, params)
        _combine(maps, 0, x, force, out)
        return
    t, arguments = _arguments(functions, t, x)
    values = np.empty(arguments.shape[0])
    end = arguments.shape[0]
    begin = end - maps.sizes[n_maps]
    _inner(functions, t, arguments[begin:], values[begin:], params)
    for number in range(n_maps - 1, 0, -1):
        n = maps.sizes[number]
        above, force = arguments[begin - n : begin], values[begin:end]
        _combine(maps, number, above, force, values[begin - n : begin])
        begin, end = begin - n, begin
    _combine(maps, 0, x, values[:end], out)


@inner(allocates=True)
def set_slopes(functions, t, x, out):
    """Set out = df / dx by the user's Jacobian, (n, n)."""
    maps = functions.maps
    n_maps = maps.sizes.shape[0] - 1
    if _are_outside(functions):
        x = _copied(x)
        t = _to_the_side(functions, t, x)
    if n_maps == 0:
        _inner_slopes(functions, t, x, out)
        return
    t, arguments = _arguments(functions, t, x)
    n = maps.sizes[n_maps]
    slopes = np.empty((n, n))
    _inner_slopes(functions, t, arguments[arguments.shape[0] - n :], slopes)
    for number in range(n_maps - 1, 0, -1):
        n = maps.sizes[number]
        around = np.empty((n, n))
        _combine_slopes(maps, number, slopes, around)
        slopes = around
    _combine_slopes(maps, 0, slopes, out)


@inner(allocates=True)
def slopes_of_user(functions, t, x):
    """Return the values of the user's Jacobian, (jac_size,)."""
    if functions.switches.signs.shape[0] > 0:
        x = _copied(x)
        t = _to_the_side(functions, t, x)
    values = np.zeros(functions.jac_size)
    _own_slopes(functions, t + functions.start, x, values)
    return values


@inner(allocates=True)
def _copied(x):
    """Return a copy of x (n,)."""
    found = np.empty(x.shape[0])
    for i in range(x.shape[0]):
        found[i] = x[i]
    return found


@inner
def _in_place(maps, number):
    """Return whether f reads the first components of a map, and gives its last values."""
    return maps.starts[3 * number] == maps.starts[3 * number + 1]


@inner
def _are_outside(functions):
    """Return whether there are switches, and no maps outside of them."""
    switches = functions.switches
    return switches.signs.shape[0] > 0 and switches.n_inside == functions.maps.sizes.shape[0] - 1


@inner(allocates=True)
def _arguments(functions, t, x):
    """Return t, and the components inside all maps, one map after another.

    Between two maps both may be moved to the sides of switches.
    """
    maps, switches = functions.maps, functions.switches
    n_maps, total = maps.sizes.shape[0] - 1, 0
    for number in range(n_maps):
        total += maps.sizes[number + 1]
    found, begin = np.zeros(total), 0
    for number in range(n_maps):
        end = begin + maps.sizes[number + 1]
        z = found[begin:end]
        if _in_place(maps, number):
            for i in range(z.shape[0]):
                z[i] = x[i]
        else:
            _add_product(maps.numbers[maps.starts[3 * number] :], x, z)
        if switches.signs.shape[0] > 0 and switches.n_inside == n_maps - 1 - number:
            t = _to_the_side(functions, t, z)
        x, begin = z, end
    return t, found


@inner
def _combine(maps, number, x, force, out):
    """Set out = B x + A f, where f is the vector `force`."""
    in_place = _in_place(maps, number)
    for i in range(out.shape[0] - force.shape[0] if in_place else out.shape[0]):
        out[i] = 0.0
    if in_place and force.shape[0] > 0:
        first = out.shape[0] - force.shape[0]
        for i in range(force.shape[0]):
            out[first + i] = force[i]
    _add_product(maps.numbers[maps.starts[3 * number + 1] :], x, out)
    if not in_place:
        _add_product(maps.numbers[maps.starts[3 * number + 2] :], force, out)


@inner
def _combine_slopes(maps, number, block, out):
    """Set out = B + A J S, where J is the matrix `block`."""
    n, n_f, in_place = out.shape[0], block.shape[0], _in_place(maps, number)
    read = maps.numbers[maps.starts[3 * number] :]
    own = maps.numbers[maps.starts[3 * number + 1] :]
    before = maps.numbers[maps.starts[3 * number + 2] :]
    for i in range(n):
        for j in range(n):
            copied = in_place and i >= n - n_f and j < n_f
            out[i, j] = block[i - n + n_f, j] if copied else 0.0
        for p in range(int(own[i]), int(own[i + 1]), 2):
            out[i, int(own[p])] += own[p + 1]
        if in_place:
            continue
        for p in range(int(before[i]), int(before[i + 1]), 2):
            for k in range(n_f):
                change = before[p + 1] * block[int(before[p]), k]
                for q in range(int(read[k]), int(read[k + 1]), 2):
                    out[i, int(read[q])] += change * read[q + 1]


@inner
def _add_product(matrix, x, out):
    """Add the product of a matrix, stored as offsets and pairs, with x to `out`."""
    for i in range(out.shape[0]):
        total = 0.0
        for p in range(int(matrix[i]), int(matrix[i + 1]), 2):
            total += matrix[p + 1] * x[int(matrix[p])]
        out[i] += total


@inner(allocates=True)
def _inner(functions, t, x, out, params):
    """Set out to the values of g, followed by 0 for the memory among the components x (n,)."""
    n, z = functions.n, _all_rows(functions, t, x)
    if functions.in_python[0] != 0:
        call_at_place(functions.in_python[0], t + functions.start, z, out[:n])
    elif functions.form != ZERO:
        functions.rhs(t + functions.start, z, out[:n], params)
    for i in range(0 if functions.form == ZERO else n, out.shape[0]):
        out[i] = 0.0


@inner(allocates=True)
def _inner_slopes(functions, t, x, out):
    """Set out to the Jacobian of `_inner` with respect to the components x, (n, n)."""
    n, delays = functions.n, functions.delays
    z = _all_rows(functions, t, x)
    t += functions.start
    by_y, by_memory = np.zeros((n, n)), np.empty((n, z.shape[0] - n))
    if functions.places.shape[0] > 0:
        values = np.zeros(functions.jac_size)
        _own_slopes(functions, t, z, values)
        for k in range(functions.places.shape[0]):
            value = values[functions.places[k]] if functions.places[k] >= 0 else 0.0
            by_y[functions.rows[k], functions.columns[k]] = value
    else:
        _own_slopes(functions, t, z, by_y.reshape(n * n))
    if by_memory.size > 0 and functions.in_python[2] != 0:
        call_at_place(functions.in_python[2], t, z, by_memory)
    elif by_memory.size > 0:
        functions.jac_memory(t, z, by_memory.reshape(by_memory.size), functions.params)
    for i in range(out.shape[0]):
        column = 0
        for j in range(z.shape[0]):
            if j >= n and delays.rows.shape[0] > 0 and delays.rows[j // n - 1] >= 0:
                continue
            if i >= n:
                out[i, column] = 0.0
            else:
                out[i, column] = by_y[i, j] if j < n else by_memory[i, j - n]
            column += 1


@inner(allocates=True)
def _own_slopes(functions, t, z, out):
    """Set out to dg / dy, as the user's function fills it, (jac_size,); z is y and then memory."""
    if functions.jac_form == GIVEN and functions.in_python[1] != 0:
        call_at_place(functions.in_python[1], t, z, out)
    elif functions.jac_form == GIVEN:
        functions.jac(t, z, out, functions.params)


@inner(allocates=True)
def call_at_place(address, t, z, out):
    """Fill `out` from z by the C function at `address`, which enters Python."""
    if call_at(address, t, z.ctypes.data, out.ctypes.data) != 0:  # type: ignore[call-arg]
        raise PythonRaised


@inner(allocates=True)
def _all_rows(functions, t, x):
    """Return y and all rows of memory, ((1 + k) n,); x has only the rows that are no delays."""
    n, delays = functions.n, functions.delays
    rows = delays.rows
    if rows.shape[0] == 0:
        return x
    look_up_all(delays, t)
    z, column = np.empty((1 + rows.shape[0]) * n), n
    for c in range(n):
        z[c] = x[c]
    for row in range(rows.shape[0]):
        first = (1 + row) * n
        if rows[row] < 0:
            for c in range(n):
                z[first + c] = x[column + c]
            column += n
        else:
            for c in range(n):
                z[first + c] = delays.latest[rows[row], c]
    return z


@inner(allocates=True)
def _to_the_side(functions, t, x):
    """Move x (n,) to one side of each switch; return t, moved for switches of the time alone.

    Beyond a switch f has the value of the nearest point on the side of the march. The weight of
    this side in blends is that of x before.
    """
    switches, value = functions.switches, np.empty(1)
    for number in range(switches.signs.shape[0] if n_blends(functions) > 0 else 0):
        center, width = switches.blends[number, CENTER], switches.blends[number, WIDTH]
        if width > 0.0:
            switch = function_at(switches.functions[number])
            switch(t + functions.start, x[: switches.n_read], value, functions.params[:0])
            share = switches.signs[number] * (value[0] - center) / width
            switches.weight[0] *= 0.5 * (1.0 + share)
    for number in range(functions.switches.signs.shape[0] - 1, -1, -1):
        t = _to_one_side(functions, number, t, x)
    return t


@inner(allocates=True)
def _to_one_side(functions, number, t, x):
    """Move x (n,) to one side of a switch, by Newton's method; return t, moved if x cannot be."""
    switches, start, none = functions.switches, functions.start, functions.params[:0]
    sign, n = switches.signs[number], switches.n_read
    switch = function_at(switches.functions[number])
    value, beside, slope, square = np.empty(1), np.empty(1), np.empty(n), 0.0
    switch(t + start, x[:n], value, none)
    largest = 0.0
    for i in range(n):
        largest = max(largest, abs(x[i]))
    if sign * value[0] > _SIDE_ROUNDING * largest or value[0] != value[0]:
        return t
    for _ in range(_SURFACE_NEWTON_MAXITER):
        square, size = 0.0, 0.0
        for i in range(n):
            before = x[i]
            x[i] += _SWITCH_INCREMENT * (largest if largest > 0.0 else 1.0)
            switch(t + start, x[:n], beside, none)
            slope[i] = (beside[0] - value[0]) / (x[i] - before)
            x[i] = before
            square += slope[i] * slope[i]
            size += abs(slope[i] * before)
        margin = _SURFACE_DISTANCE * size + _MIN_SURFACE_DISTANCE
        if square == 0.0 or sign * value[0] >= margin:
            break
        for i in range(n):
            x[i] += (2.0 * sign * margin - value[0]) * slope[i] / square
        switch(t + start, x[:n], value, none)
    if square == 0.0:  # a switch of the time alone
        for _ in range(_SURFACE_NEWTON_MAXITER):
            now = t + start
            step = _SWITCH_INCREMENT * (abs(now) if now != 0.0 else 1.0)
            switch(now + step, x[:n], beside, none)
            slope_t = (beside[0] - value[0]) / step
            margin = _SURFACE_DISTANCE * abs(slope_t * now) + _MIN_SURFACE_DISTANCE
            if slope_t == 0.0 or sign * value[0] >= margin:
                break
            t += (2.0 * sign * margin - value[0]) / slope_t
            switch(t + start, x[:n], value, none)
    return t
