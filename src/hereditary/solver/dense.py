"""Dense output: the solution of a run at any time, from its pieces.

Between given steps pieces are parabolas. In the first two steps of a run solutions start like a
power of t. There a component is ``x(0) + t x'(0) + a t**alpha`` with its highest order alpha and a
from the equation at 0. Powers that interpolate the values of the scheme are added. These are t**r
in the first step, and t**r and t**(r+1) in the second. Here r = min(1, 2 alpha) below order 1 and r
= 2 from order 1 on.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from scipy.special import rgamma

from ..equation.frame import Frame
from ..support.checks import complaint, real_array, shown

# A curve's chords miss it by at most this share of its size, half a pixel of 1,000; of a curve that
# never gets smooth, e.g. rounding errors of a constant, so many points.
_CHORD, _MOST = 5e-4, 100_000
# Long steps are halved so many times before chords are compared with the curve: an oscillation over
# a step has chords whose middles lie on it.
_HALVINGS = 3
# The slope at 0 is taken here, and called infinite beyond this size.
_NEXT_TO_0, _STEEP = 1e-200, 1e12


class Piece:
    """Dense output on one step, or on several consecutive ones."""

    starting: FirstSteps | None = None

    def edges(self):
        """Return the start of each step."""
        raise NotImplementedError

    def evaluate(self, t, second, derivative):
        """Return y, or y' for ``derivative=1``, at times t inside the steps, (k, d).

        `second` (d,) tells the components whose first derivative was an unknown.
        """
        raise NotImplementedError

    def evaluate_both(self, t, second, slopes):
        """Return y and y' at times t inside the steps, (k, d) each; NaN for y' without `slopes`."""
        y = self.evaluate(t, second, 0)
        return y, self.evaluate(t, second, 1) if slopes else np.full_like(y, np.nan)

    def at_ends(self, ends, chosen, second, slopes=True):
        """Evaluate as `evaluate_both` at the chosen ends of steps."""
        return self.evaluate_both(ends[chosen], second, slopes)


class Dense:
    """The solution at any time of a run, from the steps that made it.

    Parameters
    ----------
    second : ndarray of bool, shape (d,)
        Components whose first derivative was the unknown.
    resolved : bool
        Whether steps are so short that their ends show whatever happens.
    frame : Frame
        How the user sees times and components.
    """

    def __init__(self, second, resolved=False, frame=Frame()):  # noqa: B008
        self._second, self.resolved = np.asarray(second, dtype=bool), resolved
        self._frame = frame
        self._pieces: list = []
        self._starts: list[float] = []

    def add(self, piece, start):
        """Take in what follows from `start` on."""
        self._pieces.append(piece)
        self._starts.append(start)

    def __call__(self, t, derivative, end):
        """Return y, or y' for ``derivative=1``, at times t up to `end`; shape (d,) or (k, d)."""
        times = np.atleast_1d(real_array("t", t))
        if times.ndim > 1:
            required, remedy = "be a number or of shape (k,)", "pass t.ravel()"
            raise ValueError(complaint("t", required, f"shape {times.shape}", remedy))
        if not self._pieces:
            raise ValueError(complaint("t", "wait for a run that made a step", shown(times)))
        start = self._starts[0] + self._frame.start
        if not ((times >= start) & (times <= end)).all():
            required = f"lie in [{start}, {end}]"
            raise ValueError(complaint("t", required, shown(times)))
        times = np.maximum(times - self._frame.start, self._starts[0])
        out = self._evaluate(times, derivative)
        if derivative:
            inside = self._evaluate(times, 0) if self._frame.speeds else out
            out = self._frame.slopes(inside, out)
        else:
            out = self._frame.values(out)
        return out if np.ndim(t) else out[0]

    def _evaluate(self, times, derivative):
        """Return the components inside, or their slopes, at times inside, (k, d)."""
        where = last_start(np.array(self._starts), times)
        if times.size and (where == where[0]).all():
            return self._pieces[where[0]].evaluate(times, self._second, derivative)
        out = np.empty((times.size, self._second.size))
        for k in np.unique(where):
            chosen = where == k
            out[chosen] = self._pieces[k].evaluate(times[chosen], self._second, derivative)
        return out


def last_start(starts, t):
    """Return the last that starts by each time, or the first of several that start then.

    Steps next to a singular start may be too short for its time to change.
    """
    last = starts.searchsorted(t, side="right") - 1
    first = starts.searchsorted(t, side="left")
    return np.where(first <= last, first, last)


class StepPieces(Piece):
    """Consecutive steps, each a parabola through its ends with the slope at its end.

    Parameters
    ----------
    times : ndarray, shape (k+1,)
        Ends of the steps, the start in front [time].
    rows, slopes : ndarray, shape (k+1, d)
        Solution and first derivative there.
    starting : FirstSteps, optional
        The solution inside the first two steps of a run, where it is known there.
    n : int
        Number of the step that the start is.
    """

    def __init__(self, times, rows, slopes, starting: FirstSteps | None = None, n=0):
        self.times, self.rows, self.slopes = times, rows, slopes
        self.starting, self._n = starting, n
        if starting is not None:
            for number in range(max(1, n), min(3, n + times.size)):
                if times[number - n] >= starting.ends[number - 1]:  # no event before it
                    starting.end(number, rows[number - n])

    def edges(self):
        """Return the start of each step."""
        return self.times[:-1]

    def at_ends(self, ends, chosen, second, slopes=True):
        """Return y and y' at the chosen ones of the steps' ends, (k, d) each."""
        return self.rows[1:][chosen], self.slopes[1:][chosen]

    def evaluate(self, t, second, derivative):
        """Return y or y' at times t inside the steps, shape (k, d)."""
        last = self.times.size - 1
        i = np.clip(np.searchsorted(self.times, t), 1, last)
        # where a change of y gives a time two rows, the second one counts
        i = np.where((self.times[np.minimum(i + 1, last)] == t) & (i + 2 <= last), i + 2, i)
        h = (self.times[i] - self.times[i - 1])[:, None]
        back = (t - self.times[i])[:, None] / h
        with np.errstate(over="ignore", invalid="ignore"):  # the last step may overflow
            increment = self.rows[i] - self.rows[i - 1]
            change = 2.0 * (h * self.slopes[i] - increment)
            if derivative:
                found = (increment + (0.5 + back) * change) / h
            else:
                found = self.rows[i] + back * (increment + 0.5 * (1.0 + back) * change)
        if self.starting is not None:
            for number in (1, 2):
                inside = (i + self._n == number) & (t < self.times[i])
                if inside.any():
                    found[inside] = _near_start(self.starting, number, t[inside], derivative)
        return found


def _near_start(starting, n, t, derivative):
    """Return y or y' inside step n, 1 or 2; powers below 1 are infinitely steep at 0."""
    y, slope = starting.inside(n, np.maximum(t, _NEXT_TO_0))
    steep = (t[:, None] == 0.0) & (np.abs(slope) > _STEEP)
    return np.where(steep, np.copysign(np.inf, slope), slope) if derivative else y


def starting_steps(stepper):
    """Return `FirstSteps` of a stepper that made at most one step; otherwise None."""
    system = stepper.equation.enlarged
    # Riemann-Liouville terms begin with lower ones, which the values of the first steps miss
    if stepper.n > 1 or not system.constant or any(op.from_zero for op, _ in system.left):
        return None
    return FirstSteps(stepper.equation, stepper.steps.times(np.array([1.0, 2.0])))


class FirstSteps:
    """Rows inside the first two steps of a march that begins at 0.

    Parameters
    ----------
    equation : System
        With constant orders alone.
    ends : array_like, shape (2,)
        Times at which the two steps end.
    """

    def __init__(self, equation, ends):
        self._equation = equation
        self.ends, self._values = np.asarray(ends, dtype=float), np.zeros((2, equation.d))

    @cached_property
    def _powers(self):
        """Highest order, its factor, and r for each component, (d,); asked for by few runs."""
        alpha = self._equation.highest_orders()
        more = np.where(alpha >= 1, 2.0, np.minimum(1.0, 2 * alpha))
        return alpha, _leading(self._equation, alpha), more

    def end(self, n, y):
        """Note that step n, 1 or 2, ends at y."""
        self._values[n - 1] = y

    def inside(self, n, times):
        """Return the solution and slope at times inside step n, shapes (k, d)."""
        t, ends = times[:, None], self.ends[:n, None]
        unit = ends[-1]
        missed = (self._values[:n] - self._known(ends)[0]).T  # (d, n)
        _, _, more = self._powers
        powers = more[:, None] + np.arange(n)  # (d, n)
        matrix = (ends.T / unit)[..., None] ** powers[:, None]  # (d, n, n)
        factors = np.linalg.solve(matrix, missed[..., None])[..., 0]
        y, slope = self._known(t)
        for k in range(n):
            y = y + factors[:, k] * (t / unit) ** powers[:, k]
            slope = slope + factors[:, k] * powers[:, k] / unit * (t / unit) ** (powers[:, k] - 1)
        return y, slope

    def _known(self, t):
        """Return x(0) + t x'(0) + a t**alpha, and its slope."""
        y0, (alpha, lead, _) = self._equation.y0, self._powers
        speed = y0[1] if y0.shape[0] == 2 else 0.0
        y = y0[0] + t * speed + lead * t**alpha
        return y, speed + lead * alpha * t ** (alpha - 1)


def _leading(equation, alpha):
    """Return the a above, or 0 if the right-hand side has no value at 0."""
    f = np.full(equation.d, np.nan)
    try:
        system = equation.enlarged
        f[:] = system.force(0.0, system.at_start)[: equation.d]
    except Exception:  # the march meets it again, or never looks there
        f[:] = np.nan
    if equation.m == 2:
        f -= np.where(alpha > 1, equation.coefficient(1.0), 0.0) * equation.y0[1]
    lead = f * rgamma(1 + alpha) / equation.coefficient(alpha)
    return np.where(np.isfinite(lead), lead, 0.0)


def curve(solution, components, derivatives=(0,)):
    """Return times (k,) and values (k, m) that straight lines may join.

    They are the rows and, where the steps are long, points of the dense output between them. The
    columns are the chosen components of y, of y', or of both one after the other.
    """
    t = solution.t
    values = np.hstack([(solution.y, solution.ydot)[k][:, components] for k in derivatives])
    if not solution.coarse:
        return t, values
    with np.errstate(invalid="ignore", over="ignore"):  # of runs that blew up
        allowed = _CHORD * np.fmax.reduce(np.abs(values - values[-1]))
        chords, halvings = np.arange(t.size - 1), 0
        while chords.size and t.size < _MOST:
            middle = (t[chords] + t[chords + 1]) / 2
            inside = (t[chords] < middle) & (middle < t[chords + 1])
            chords, middle = chords[inside], middle[inside]
            found = np.hstack([solution(middle, k)[:, components] for k in derivatives])
            missed = np.abs(found - (values[chords] + values[chords + 1]) / 2) > allowed
            bent = missed.any(axis=1) | (halvings < _HALVINGS)
            chords, halvings = chords[bent], halvings + 1
            t = np.insert(t, chords + 1, middle[bent])
            values = np.insert(values, chords + 1, found[bent], axis=0)
            chords = chords + np.arange(chords.size)
            chords = np.sort(np.concatenate([chords, chords + 1]))
    return t, values
