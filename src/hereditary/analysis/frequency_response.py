"""Steady response to a periodic force, by harmonic balance."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from .._checks import complaint, count, instance, real_array, shown
from ..equation import Equation
from .harmonic_balance import Balance

# Newton iterations at a frequency, their tolerance, and that where rounding ends them.
_ITERATIONS, _TOLERANCE, _STALLED = 30, 1e-12, 1e-7
# Longest step across a turning point, and fewest frequencies above the width of a peak.
_TURN, _LEAST_ABOVE = 1e-3, 8
# Shortest and longest step along the curve, as shares of the range of frequencies and of the size
# of responses, the growth of steps after few iterations, and the most points of a curve.
_SHORTEST, _LONGEST, _GROW, _FEW, _MOST_POINTS = 1e-7, 0.03, 1.5, 3, 20_000
# Cosine of the largest bend between two points, iterations to the next one and how near they come.
_STRAIGHT, _TRIES, _NEAR = 0.9, 8, 1e-7
# Least unit of responses, as a share of the largest so far.
_LEAST = 1e-6


@dataclass(frozen=True, eq=False)
class FrequencyResponse:
    """Steady responses along a curve of frequencies, or of another parameter.

    Attributes
    ----------
    omega : ndarray, shape (n,)
        Angular frequencies of the force, in the order of the curve: a frequency with several
        responses occurs several times [1/time].
    values : ndarray, shape (n,)
        The parameter that the curve follows: `omega` itself, or another one.
    coefficients : ndarray of complex, shape (n, d, H + 1)
        ``y_c(t) = Re sum_k coefficients[c, k] exp(i k omega t)``.
    branch : ndarray of int, shape (n,)
        Turning points passed before: the odd ones are what a slow sweep jumps over.
    turning : ndarray, shape (m,)
        Values of that parameter at the turning points.
    complete : bool
        Whether the curve was followed to the last value.
    message : str
    """

    omega: np.ndarray
    values: np.ndarray = field(repr=False)
    coefficients: np.ndarray = field(repr=False)
    branch: np.ndarray = field(repr=False)
    turning: np.ndarray
    complete: bool
    message: str

    @property
    def amplitude(self) -> np.ndarray:
        """Amplitude of the first harmonic, shape (n, d)."""
        return np.abs(self.coefficients[..., 1])

    @property
    def phase(self) -> np.ndarray:
        """Phase of the first harmonic, in (-pi, pi], shape (n, d)."""
        return np.angle(self.coefficients[..., 1])

    def period(self, n_times: int = 256) -> np.ndarray:
        """Return the responses over one period, at equal times, shape (n, d, n_times)."""
        k = np.arange(self.coefficients.shape[2])
        turns = np.exp(2j * np.pi * np.outer(k, np.arange(n_times)) / n_times)
        return np.real(self.coefficients @ turns)

    def peak(self, component: int = 0) -> tuple[float, float]:
        """Return frequency and amplitude of the highest response, between the ones asked for.

        By a parabola through it and its two neighbours on the curve; the highest one itself at an
        end. Peaks of curves for several forces make up the backbone.
        """
        a = self.amplitude[:, component]
        top = int(np.argmax(a))
        if not 0 < top < a.size - 1:
            return float(self.omega[top]), float(a[top])
        near = slice(top - 1, top + 2)
        x = self.omega[near] - self.omega[top]
        bend, slope, height = np.polyfit(x, a[near], 2)
        at = np.clip(-slope / (2 * bend), x.min(), x.max()) if bend < 0 else 0.0
        return float(self.omega[top] + at), float(height + at * (slope + at * bend))

    def quality(self, component: int = 0) -> float:
        """Return the quality factor: peak frequency over the width at 1 / sqrt(2) of the peak.

        From the frequencies asked for; NaN where fewer than eight of them lie above that height, or
        the curve does not fall so far on both sides, or does not follow the frequency.
        """
        a = self.amplitude[:, component]
        if not np.array_equal(self.values, self.omega):
            return float("nan")
        level, ends = a.max(initial=0.0) / np.sqrt(2), []
        if np.sum(a > level) < _LEAST_ABOVE:
            return float("nan")
        top = int(np.argmax(a))
        for side in (np.arange(top, -1, -1), np.arange(top, a.size)):
            below = np.flatnonzero(a[side] < level)
            if below.size == 0:
                return float("nan")
            i, j = side[below[0]], side[below[0] - 1]
            share = (level - a[i]) / (a[j] - a[i])
            ends.append(self.omega[i] + share * (self.omega[j] - self.omega[i]))
        return float(self.omega[top] / abs(ends[1] - ends[0]))


def frequency_response(
    equation: Equation,
    omegas: ArrayLike,
    *,
    frequency: int = 0,
    along: int | None = None,
    harmonics: int = 7,
) -> FrequencyResponse:
    """Steady response of an equation with memory to a periodic force, against its frequency.

    The equation is taken from time minus infinity on, where it has periodic solutions: an operator
    of order alpha multiplies the k-th harmonic by ``(i k omega)**alpha``, and a memory kernel with
    m derivatives by ``(i k omega)**m`` times its Laplace transform. Coefficients of the harmonics
    are found by Newton's method, with the right-hand side evaluated over a period, and the curve of
    solutions is followed by its length, around turning points as well. Frequencies within some 1e-6
    of the range of a turning point may be passed over.

    Parameters
    ----------
    equation : Equation
        Of constant orders, and kernels whose Laplace transform is known, whose right-hand side has
        period 2 pi / omega in t, omega being one of its parameters. It may read memory.
    omegas : array_like, shape (n,)
        Angular frequencies, all increasing or all decreasing, above 0; responses are found at each,
        beginning with the first [1/time]. With `along`, values of that parameter.
    frequency : int, optional
        Number of the parameter that is omega.
    along : int, optional
        Number of another parameter, which the curve follows at the equation's own frequency: the
        force, say.
    harmonics : int, optional
        Highest harmonic H.

    Returns
    -------
    FrequencyResponse
        Also where the curve could not be followed to its end.

    Notes
    -----
    From a finite time on no equation with memory has an exact periodic solution: the response of a
    march tends to the one here like a power of t. Stability is not told, beyond turning points:
    where the curve turns back, a pair of responses meets, of which one is unstable.

    Error
    -----
    Harmonics beyond H are left out, and the right-hand side is sampled 8 H times a period, 129 at
    least: errors fall with H as the harmonics of response and force do. Linear equations are solved
    to rounding where the force has no harmonics beyond; a pulse or a jump has, and needs a larger
    H. Turning points are found to about 1e-6 of the range.

    Cost
    ----
    Some ten systems of d (2 H + 1) unknowns for each frequency: 2 to 3 ms for one component.

    Examples
    --------
    >>> import numpy as np
    >>> import hereditary as hd
    >>> def force(t, x, p):
    ...     return np.cos(p[0] * t) - x
    >>> terms = hd.Caputo(1.8) + 0.2 * hd.Caputo(0.8)
    >>> eq = hd.Equation(terms, force, [0.0, 0.0], params=[1.0])
    >>> found = hd.frequency_response(eq, [0.5, 1.0, 2.0])
    >>> s = 1j * found.omega
    >>> np.allclose(found.coefficients[:, 0, 1], 1 / (s**1.8 + 0.2 * s**0.8 + 1), atol=1e-13)
    True
    """
    instance("equation", equation, Equation, "hereditary.Equation(terms, rhs, y0)")
    _check(equation, frequency, along)
    followed = frequency if along is None else int(along)
    wanted = _followed(omegas, followed == frequency)
    balance = Balance(equation, frequency, followed, count("harmonics", harmonics))
    balance.check_period({float(wanted[0]), float(wanted[-1])})
    curve = _Curve(balance, wanted, followed == frequency)
    trouble = curve.follow()
    points = curve.found
    x = np.array([point.x for point in points]).reshape(-1, balance.size)
    values = np.array([point.value for point in points])
    return FrequencyResponse(
        omega=balance.omegas(values),
        values=values,
        coefficients=balance.coefficients(x),
        branch=np.array([point.branch for point in points], dtype=np.int64),
        turning=np.array(curve.turning),
        complete=not trouble,
        message=trouble or "the curve was followed to the last value",
    )


def _followed(omegas, positive):
    """Return frequencies, or values of another parameter, or say why they are none."""
    wanted = np.atleast_1d(real_array("omegas", omegas))
    steps = np.diff(wanted)
    monotone = np.all(steps > 0) or np.all(steps < 0)
    bad = positive and np.any(wanted <= 0)
    if wanted.ndim != 1 or wanted.size == 0 or not monotone or bad:
        kind = "frequencies above 0" if positive else "values"
        required = f"be {kind}, all increasing or all decreasing"
        raise ValueError(complaint("omegas", required, shown(wanted)))
    return wanted


def _check(equation, frequency, along):
    """Refuse equations whose operators have no symbol here, and parameters that are none."""
    if equation.t_start != 0:
        remedy = "steady responses know no start"
        raise ValueError(complaint("t_start", "be 0", equation.t_start, remedy))
    bare = not (equation.frame.paired or equation.frame.speeds)
    if not bare or equation.enlarged.varies or equation._callbacks:
        required = "be real and compiled, of constant orders up to 2"
        raise ValueError(complaint("equation", required, repr(equation)))
    p = equation.params.size
    for name, number in (("frequency", frequency), ("along", along)):
        whole = isinstance(number, (int, np.integer)) and not isinstance(number, bool)
        if name == "along" and number is None:
            continue
        if not whole or not 0 <= number < p:
            required = f"be the number of a parameter, 0 .. {p - 1}" if p else "name a parameter"
            raise ValueError(complaint(name, required, repr(number)))
    if along is not None and along != frequency and not equation.params[frequency] > 0:
        required = f"have a frequency above 0, params[{frequency}]"
        raise ValueError(complaint("equation", required, equation.params[frequency]))


class _Point(NamedTuple):
    """A response: unknowns, value of the parameter followed, and turning points passed before."""

    x: np.ndarray
    value: float
    branch: int


class _Curve:
    """Responses along a curve through a range of frequencies, or of another parameter."""

    def __init__(self, balance, wanted, positive):
        self._balance, self._wanted, self._positive = balance, wanted, positive
        self.found: list[_Point] = []
        self.turning: list[float] = []
        self._missed = ""
        self._sign = 1.0 if wanted[-1] >= wanted[0] else -1.0
        self._range = abs(wanted[-1] - wanted[0]) or abs(wanted[0]) or 1.0
        self._unit = 0.0 if positive else self._range

    def follow(self):
        """Follow the curve to the last value; return why it could not be, or nothing."""
        value = float(self._wanted[0])
        x, _ = self._at(np.zeros(self._balance.size), value)
        if x is None:
            remedy = "begin elsewhere, or give jac and write y in units of its size"
            return f"no response was found at the first value, {value:g}: {remedy}"
        self.found.append(_Point(x, value, 0))
        if self._wanted.size == 1:
            return ""
        peak = self._scale = float(np.linalg.norm(x)) or 1.0
        tangent, step = self._tangent(x, value, np.append(np.zeros(x.size), self._sign)), _LONGEST
        if tangent is None:
            return f"the curve has no direction at the first value, {value:g}"
        for _ in range(_MOST_POINTS):
            # steps are short beside a narrow peak: in units of the response here
            self._scale = max(float(np.linalg.norm(x)), _LEAST * peak)
            tangent = tangent / np.sqrt(self._product(tangent, tangent))
            ahead, taken = self._corrected(x, value, tangent, step)
            turned = None if ahead is None else self._tangent(ahead[0], ahead[1], tangent)
            if turned is None or self._product(turned, tangent) < _STRAIGHT:
                step *= 0.5
                if step < _SHORTEST:
                    return f"the curve could not be followed beyond {value:g}"
                continue
            before, after = tangent[-1], turned[-1]
            if before * after < 0 and step > _TURN:
                step = _TURN
                continue
            if before * after < 0:  # it is a parabola of the length there
                share = before / (before - after)
                self.turning.append(value + 0.5 * share * before * step)
            self._note(x, value, ahead[0], ahead[1], len(self.turning))
            (x, value), tangent = ahead, turned
            peak = max(peak, float(np.linalg.norm(x)))
            if (value - self._wanted[-1]) * self._sign >= 0:
                return self._missed
            if (value - self._wanted[0]) * self._sign < -_LONGEST * self._range:
                return "the curve turns back beyond the first value"
            step = min(_LONGEST, step * _GROW) if taken <= _FEW else step
        return f"the curve has more than {_MOST_POINTS} points"

    def _product(self, one, other):
        """Product of two directions (size + 1,), unknowns and value in their units."""
        inside = one[:-1] @ other[:-1] / self._scale**2
        return float(inside + one[-1] * other[-1] / self._range**2)

    def _row(self, direction):
        """Return what multiplies a change to give the product with a direction."""
        return np.append(direction[:-1] / self._scale**2, direction[-1] / self._range**2)

    def _bordered(self, x, value, direction):
        """Return the residual, and its derivative with the product with a direction below."""
        residual, matrix = self._balance.residual(x, value)
        beside = self._balance.by_value(x, value, self._unit)[:, None]
        return residual, np.vstack([np.hstack([matrix, beside]), self._row(direction)])

    def _tangent(self, x, value, previous):
        """Return the direction of the curve, of length 1, going on as the previous one.

        None where there is no single one.
        """
        _, matrix = self._bordered(x, value, previous)
        try:
            found = np.linalg.solve(matrix, np.append(np.zeros(x.size), 1.0))
        except np.linalg.LinAlgError:
            return None
        return found / np.sqrt(self._product(found, found))

    def _corrected(self, x, value, tangent, step):
        """Return a point of the curve at a distance, or None, and iterations."""
        length = step / np.sqrt(self._product(tangent, tangent))
        start = np.append(x, value) + length * tangent
        place = start.copy()
        for iteration in range(_TRIES):
            if self._positive and not place[-1] > 0:
                return None, iteration
            residual, matrix = self._bordered(place[:-1], place[-1], tangent)
            off = self._product(place - start, tangent)
            if not np.all(np.isfinite(residual)) or not np.all(np.isfinite(matrix)):
                return None, iteration
            try:
                change = np.linalg.solve(matrix, np.append(residual, off))
            except np.linalg.LinAlgError:
                return None, iteration
            place -= change
            if self._product(change, change) <= _NEAR**2:
                return (place[:-1], float(place[-1])), iteration
        return None, _TRIES

    def _note(self, x, value, new_x, new_value, branch):
        """Find responses at the values asked for between two points."""
        low, high = min(value, new_value), max(value, new_value)
        between = np.sort(self._wanted[(self._wanted >= low) & (self._wanted <= high)])
        for wanted in between if new_value > value else between[::-1]:
            if wanted == value:  # found with the point before
                continue
            guess = x + (wanted - value) / (new_value - value) * (new_x - x)
            found, _ = self._at(guess, float(wanted))
            near = 2 * float(np.linalg.norm(new_x - x)) + 1e-6 * float(np.linalg.norm(x))
            if found is None or np.linalg.norm(found - guess) > near:
                self._missed = f"no response was found at {wanted:g}, which the curve passes"
            else:
                self.found.append(_Point(found, float(wanted), branch))

    def _at(self, x, value):
        """Solve at a value from a first guess; return unknowns or None, and iterations."""
        before = np.inf
        for iteration in range(_ITERATIONS):
            residual, matrix = self._balance.residual(x, value)
            if not np.all(np.isfinite(residual)) or not np.all(np.isfinite(matrix)):
                return None, iteration
            try:
                change = np.linalg.solve(matrix, residual)
            except np.linalg.LinAlgError:
                return None, iteration
            x = x - change
            size, norm = float(np.linalg.norm(change)), max(float(np.linalg.norm(x)), 1e-300)
            if size <= _TOLERANCE * norm or 0.25 * before <= size <= _STALLED * norm:
                return x, iteration
            before = size
        return None, _ITERATIONS
