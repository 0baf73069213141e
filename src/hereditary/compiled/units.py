"""Units of components: the least sizes that steps of difference quotients take them to have."""

import numpy as np

from .functions import set_force
from .jacobian import FEW, LEAST
from .jit import F8, VEC, entry, inner
from .linalg import all_finite
from .signatures import RIGHT_SIDE

# Times at which f is evaluated until it moves a component at 0, as fractions of the run.
_LATER = (0.0, 1e-3, 1e-2, 0.1, 1.0)
# First trial of a step of a component at 0: what f makes of it in this fraction of the run.
_FIRST_STEP = 1e-3
# Largest number of evaluations in search of components that others move.
_MOST_SEARCHES = 100
# Decades between which the size of an unknown of an algebraic row is sought.
_DECADES = -300.0, 300.0
# Relative change of the other components that shows what they make of such a row.
_CHANGE_OF_OTHERS = 0.01
# Number of halvings of the interval of decades.
_HALVINGS = 12
# Ratio of one trial step to the next one.
_STEP_RATIO = 1024.0
# Largest number of trial steps of a component.
_MOST_STEPS_TRIED = 12
# Least change of f, as fraction of f, that counts as more than rounding errors.
_CLEAR = 1e-5


@entry(RIGHT_SIDE, VEC, F8, VEC, VEC)
def units_of(right, y0, t_end, rates, out):
    """Do what `set_units_of` does; this is the entry for Python."""
    set_units_of(right.force, y0, t_end, rates, out)


@inner(allocates=True)
def set_units_of(force, y0, t_end, rates, out):
    """Set `out` (d,) to the units of components, for the steps of differences where y is small."""
    # The size in y0. For a component at 0 the change by f in a thousandth of the run to t_end,
    # others at their units. Up to FEW components take a step near that, which changes f clearly and
    # proportionally. 0 if f moves it at none of five times. rates (d,): f over the y that it makes
    # in the run, if constant; 0 for algebraic rows, of which the change counts that changes the row
    # by its size.
    d, y, f, made, later = y0.shape[0], y0.copy(), np.empty_like(y0), np.empty_like(y0), 0
    missing = False
    for c in range(d):
        out[c] = abs(y0[c])
        missing = missing or out[c] == 0.0
    for _ in range(_MOST_SEARCHES if missing else 0):
        t = _LATER[later] * t_end
        move(force, y, 0, 0.0, t, f)
        for c in range(d):
            made[c] = 0.0
            if out[c] == 0.0 and rates[c] == 0.0:
                made[c] = balancing_step(force, y, t, c)
            elif out[c] == 0.0:
                made[c] = _FIRST_STEP * f[c] / rates[c]
        seen, missing = False, False
        for c in range(d):
            if LEAST < abs(made[c]) < np.inf:
                out[c], y[c], seen = abs(made[c]), made[c], True
            missing = missing or out[c] == 0.0
        later += 0 if seen else 1
        if not missing or later == len(_LATER):
            break
    for c in range(d if d <= FEW else 0):
        if y0[c] == 0.0:
            out[c] = visible_step(force, y0, c, out[c])
    for c in range(d):
        out[c] = out[c] if LEAST < out[c] < np.inf else 0.0


@inner(allocates=True)
def balancing_step(force, y, t, c):
    """Return a size of component c that changes its row of f by about what others make of it."""
    # a power of 10, by bisection; 0 if none does
    f, beside, (low, high) = np.empty_like(y), np.empty_like(y), _DECADES
    move(force, y, 0, 0.0, t, f)
    row = f[c]
    for k in range(y.shape[0]):
        beside[k] = y[k] * (1.0 + _CHANGE_OF_OTHERS / np.sqrt(2.0 + k))
    move(force, beside, 0, 0.0, t, f)
    made = abs(row) + abs(f[c] - row) / _CHANGE_OF_OTHERS
    for _ in range(_HALVINGS if made > 0.0 else 0):
        middle = 0.5 * (low + high)
        move(force, y, c, 10.0**middle, t, f)
        if abs(f[c] - row) < made:
            low = middle
        else:
            high = middle
    return 0.0 if high == _DECADES[1] else 10.0**high


@inner(allocates=True)
def visible_step(force, y0, c, step):
    """Return a step of component c near a first one that changes f clearly, or 0."""
    # the step changes f proportionally too
    d, found, shrunk = y0.shape[0], 0.0, False
    f, once, twice = np.empty(d), np.empty(d), np.empty(d)
    move(force, y0, 0, 0.0, 0.0, f)
    for trial in range(_MOST_STEPS_TRIED if 0.0 < step < np.inf else 0):
        move(force, y0, c, step, 0.0, once)
        if trial == 0 and not np.any(once != f):  # perhaps f does not read the component at all
            move(force, y0, c, step * _STEP_RATIO ** (_MOST_STEPS_TRIED - 1), 0.0, twice)
            if not np.any(twice != f):
                return step
        move(force, y0, c, 2.0 * step, 0.0, twice)
        # test row c of f if component c occurs there: other rows may contain its square only
        of_row, linear, clear, seen = once[c] != f[c], True, True, True
        for k in range(d):
            change, double = once[k] - f[k], twice[k] - f[k]
            bend = abs(double - 2.0 * change)
            is_linear = bend <= 0.1 * abs(double) + 1e-13 * abs(f[k])
            is_clear = abs(change) >= _CLEAR * abs(f[k])
            linear, clear = linear and is_linear, clear and is_clear
            seen = seen and (is_clear or change == 0.0)
            if k == c:
                own_linear, own_seen = is_linear, is_clear or change == 0.0
        if not (own_linear if of_row else linear):
            if found > 0.0:
                return found
            step, shrunk = step / _STEP_RATIO, True
            continue
        if own_seen if of_row else seen:
            found = found if found > 0.0 else step
            if shrunk or clear:
                return step if linear and np.any(once != f) else found
        step *= _STEP_RATIO  # rounding of f may hide the change
    return found


@inner(allocates=True)
def move(force, y, c, step, t, out):
    """Set out = f at y with component c changed by `step`, or by -step if infinite, or NaN."""
    point = y.copy()
    for sign in (1.0, -1.0):
        point[c] = y[c] + sign * step
        out[:] = np.nan
        if tried(force, t, point, out) and all_finite(out):
            return


@inner
def tried(force, t, y, out):
    """Set out = f(t, y), and return whether f raised nothing."""
    try:
        set_force(force, t, y, out)
    except Exception:
        return False
    return True
