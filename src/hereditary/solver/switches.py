"""Right-hand sides that jump where functions of t and y change their signs.

A march takes such a right-hand side from one side until the run has located the change. Beyond the
switch, where trial points of a step may lie, it is continued by its value at the nearest point that
is still on that side: steps see no jump, and their polynomials cross the switch where the solution
does.
"""

from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from .._callables import switch_of
from .._checks import complaint
from .._jit import derived
from ..system import System

# Numbers that each switch adds to the parameters.
_ADDED = 3
# Values of a switch this small, relative to y, may be on either side by rounding.
_NEAR = 1e-9
# Change of y for differences, and distance kept from the switch, relative to y.
_DIFFERENCE, _MARGIN, _LEAST = 1e-7, 1e-12, 1e-300
# Iterations, for switches that are not linear in y.
_ITERATIONS = 4


class Switched(NamedTuple):
    """A system that is taken from one side of each switch.

    signs: the number of the parameter that is the sign of each switch.
    """

    system: Any
    signs: list[int]


def switched(equation, functions, scheme):
    """Return the system of an equation whose right-hand side jumps at switches, as `Switched`."""
    if not scheme.takes_switches:
        required = f"be left out with {type(scheme).__name__}"
        raise ValueError(complaint("switches", required, f"{len(functions)}", "use L1 or BDF(2)"))
    inner, frame = equation.enlarged, equation.frame
    params, rhs, jac = inner._params, inner._rhs, inner._jac if inner.has_jac else None
    n_user = len(frame.speeds) or equation.d
    y0 = frame.values(equation.at_start[: equation.d])
    signs = []
    for function in functions:
        value = switch_of(function, y0, frame.start)
        signs.append(params.size)
        params = np.append(params, [1.0, frame.start, n_user])
        rhs, jac = _one_sided(rhs, value), jac and _one_sided(jac, value)
    found = System(inner.left, inner.y0, params, rhs, jac, inner.sources, inner.structure)
    if inner is not equation:
        seen = System(equation.left, equation.y0, params, None)
        seen._enlarged, found = found, seen
    found.frame, found.rhs_digest = frame, equation.rhs_digest
    found.terms_digest, found._n_params = equation.terms_digest, equation._n_params
    return Switched(found, signs)


@lru_cache(maxsize=64)
def _one_sided(fun, switch):
    """A right-hand side or Jacobian, continued from the side whose sign stands in params.

    Behind the parameters of `fun` stand that sign, the user's time at the start, and how many
    components `switch` reads.
    """

    def one_sided(t, y, out, params):
        own = params.shape[0] - _ADDED
        sign, n = params[own], int(params[own + 2])
        none, value = params[:0], np.empty(1)
        switch(t + params[own + 1], y[:n], value, none)
        largest = 0.0
        for i in range(n):
            largest = max(largest, abs(y[i]))
        if sign * value[0] > _NEAR * largest or value[0] != value[0]:
            fun(t, y, out, params[:own])
            return
        point, slope = y.copy(), np.empty(n)
        beside, square = np.empty(1), 0.0
        for _ in range(_ITERATIONS):
            square, size = 0.0, 0.0
            for i in range(n):
                before = point[i]
                point[i] += _DIFFERENCE * (largest if largest > 0.0 else 1.0)
                switch(t + params[own + 1], point[:n], beside, none)
                slope[i] = (beside[0] - value[0]) / (point[i] - before)
                point[i] = before
                square += slope[i] * slope[i]
                size += abs(slope[i] * before)
            margin = _MARGIN * size + _LEAST
            if square == 0.0 or sign * value[0] >= margin:
                break
            for i in range(n):
                point[i] += (2.0 * sign * margin - value[0]) * slope[i] / square
            switch(t + params[own + 1], point[:n], value, none)
        if square == 0.0:  # a switch of the time alone
            for _ in range(_ITERATIONS):
                now = t + params[own + 1]
                step = _DIFFERENCE * (abs(now) if now != 0.0 else 1.0)
                switch(now + step, point[:n], beside, none)
                slope_t = (beside[0] - value[0]) / step
                margin = _MARGIN * abs(slope_t * now) + _LEAST
                if slope_t == 0.0 or sign * value[0] >= margin:
                    break
                t += (2.0 * sign * margin - value[0]) / slope_t
                switch(t + params[own + 1], point[:n], value, none)
        fun(t, point, out, params[:own])

    return derived(one_sided)
