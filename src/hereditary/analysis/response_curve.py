"""A curve of steady responses, followed by its arclength, through its turning points."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np

from .harmonic_balance import Balance

# Most Newton iterations at the first value of the parameter.
_FIRST_POINT_MAXITER = 30
# Relative change of a frequency in differences.
_FREQUENCY_CHANGE = 1e-7
# Relative change of the response that ends Newton's method.
_RESPONSE_RTOL = 1e-12
# Relative change that also ends Newton's method if the last iteration did not reduce it to a
# quarter, because of rounding.
_STALLED_RESPONSE_RTOL = 1e-7
# Shortest step along the curve, relative to the units of responses and of the parameter.
_MIN_CURVE_STEP = 1e-7
# Longest step along the curve, relative to the same units as the shortest.
_MAX_CURVE_STEP = 0.03
# Growth of the step after few Newton iterations.
_CURVE_STEP_FACTOR = 1.5
# Most iterations that count as few.
_FEW_ITERATIONS = 5
# Most Newton iterations for one point of the curve.
_POINT_MAXITER = 10
# Most points of a curve.
_MOST_POINTS = 20_000
# Cosine of the largest angle between two consecutive steps along the curve.
_STRAIGHT = 0.9
# Least unit of a response, relative to the largest response so far.
_MIN_RESPONSE_UNIT = 1e-6
# Largest unit of a frequency along the curve, relative to that frequency.
_FREQUENCIES = 10.0
# Points of each step at which the curve is compared with its spline.
_SPLINE_CHECKS_PER_STEP = 8
# Largest difference of a response from the spline through the points, relative to the response.
_AWAY = 0.1


class Peak(NamedTuple):
    """Largest amplitude of a component's first harmonic on a piece of the curve."""

    component: int
    omega: float  # frequency [1/time]
    amplitude: float
    value: float  # of the parameter along the curve


class Curve:
    """Responses along a curve through a range of frequencies, or of another parameter."""

    def __init__(self, balance: Balance, wanted: np.ndarray, positive: bool) -> None:
        # A point, (size + 1,), consists of the unknowns of the balance and the value of the
        # parameter. `points` are those at requested values, and the turning points before each.
        self._balance, self._wanted, self._positive = balance, wanted, positive
        self.points: list[tuple[np.ndarray, int]] = []
        self.turning: list[float] = []
        self.peaks: list[Peak] = []
        self._sign = 1.0 if wanted[-1] >= wanted[0] else -1.0
        self._range = abs(wanted[-1] - wanted[0]) or abs(wanted[0]) or 1.0
        self._weights = np.ones(balance.size + 1)  # of the squares of a direction's parts
        self._value = np.append(np.zeros(balance.size), 1.0)

    def follow(self) -> str:
        """Follow the curve to the last value; return why that failed, or ""."""
        first, _ = self._solved(self._wanted[0] * self._value, self._value, _FIRST_POINT_MAXITER)
        if first is None:
            remedy = "begin elsewhere, or give jac and write y in units of its size"
            return f"no response was found at the first value, {self._wanted[0]:g}: {remedy}"
        places = [first]
        failure = self._onwards(places) if self._wanted.size > 1 else ""
        if len(places) == 1:
            self.points = [(first, 0)]
            return failure
        return self._answer(places) or failure

    def _onwards(self, places: list[np.ndarray]) -> str:
        """Append points until the last value is passed; return why that failed, or ""."""
        (place,), step, largest, wanted = places, _MAX_CURVE_STEP, 0.0, self._wanted
        tangent: np.ndarray = self._sign * self._value
        for _ in range(_MOST_POINTS):
            # next to a narrow peak steps are short: their unit is the response at this point
            size = float(np.linalg.norm(place[:-1]))
            largest = max(largest, size)
            unit = min(self._range, _FREQUENCIES * place[-1] if self._positive else np.inf)
            self._weights[:-1] = max(size, _MIN_RESPONSE_UNIT * largest) ** -2.0 if largest else 1.0
            self._weights[-1] = unit**-2.0
            if len(places) == 1:
                first = self._tangent(place, tangent)
                if first is None:
                    return f"the curve has no direction at the first value, {place[-1]:g}"
                tangent = first
            tangent = tangent / np.sqrt(tangent @ (self._weights * tangent))
            ahead, n = self._solved(place + step * tangent, self._weights * tangent, _POINT_MAXITER)
            turned = None if ahead is None else self._tangent(ahead, tangent)
            if ahead is None or turned is None or turned @ (self._weights * tangent) < _STRAIGHT:
                step *= 0.5
                if step < _MIN_CURVE_STEP:
                    return f"the curve could not be followed beyond {place[-1]:g}"
                continue
            place, tangent = ahead, turned
            places.append(place)
            if (place[-1] - wanted[-1]) * self._sign > 0:
                return ""
            if (place[-1] - wanted[0]) * self._sign < -_MAX_CURVE_STEP * self._range:
                return "the curve turns back beyond the first value"
            step = min(_MAX_CURVE_STEP, step * _CURVE_STEP_FACTOR) if n <= _FEW_ITERATIONS else step
        return f"the curve has more than {_MOST_POINTS} points"

    def _change(
        self, place: np.ndarray, row: np.ndarray, right: float | None = None
    ) -> np.ndarray | None:
        """Solve with the residual's derivative and one more row, (size + 1,); None if singular."""
        # the right-hand side is the residual and then `right`, or, without `right`, 0 and then 1
        residual, matrix = self._balance.residual(place[:-1], place[-1])
        unit = 0.0 if self._positive else self._range
        step = _FREQUENCY_CHANGE * max(abs(place[-1]), unit)
        moved, _ = self._balance.residual(place[:-1], place[-1] + step, False)
        matrix = np.vstack([np.column_stack([matrix, (moved - residual) / step]), row])
        column = self._value if right is None else np.append(residual, right)
        if np.isfinite(residual).all() and np.isfinite(matrix).all():
            with suppress(np.linalg.LinAlgError):
                return np.linalg.solve(matrix, column)
        return None

    def _tangent(self, place: np.ndarray, previous: np.ndarray) -> np.ndarray | None:
        """Return the unit tangent of the curve in the direction of the previous one, or None."""
        along = self._change(place, self._weights * previous)
        return None if along is None else along / np.sqrt(along @ (self._weights * along))

    def _solved(
        self, start: np.ndarray, row: np.ndarray, most: int
    ) -> tuple[np.ndarray | None, int]:
        """Return the point with ``row @ (point - start) = 0``, or None, and the iterations."""
        place, before = start, np.inf
        for iteration in range(most):
            in_domain = place[-1] > 0 or not self._positive
            change = self._change(place, row, row @ (place - start)) if in_domain else None
            if change is None:
                break
            place = place - change
            size, norm = (float(np.linalg.norm(v[:-1])) for v in (change, place))
            if (
                size <= _RESPONSE_RTOL * norm
                or 0.25 * before <= size <= _STALLED_RESPONSE_RTOL * norm
            ):
                return place, iteration
            before = size
        return None, most

    def _answer(self, places: list[np.ndarray]) -> str:
        """Find turning points, peaks and the requested values; return which was missed, or ""."""
        spline = self._spline(places)
        turns = _crossings(lambda s: spline(s, 1)[..., -1], spline.x)
        self.turning = spline(turns)[:, -1].tolist()
        m, failure = self._balance.size // self._balance.d, ""
        for c in range(self._balance.d):
            first = slice(c * m + 1, c * m + 3)  # of its harmonics

            def rise(s: np.ndarray, first: slice = first) -> np.ndarray:
                return np.sum(spline(s)[..., first] * spline(s, 1)[..., first], axis=-1)

            for s in _crossings(rise, spline.x, falling=True):
                place, _ = self._solved(spline(s), spline(s, 1), _POINT_MAXITER)
                if place is not None and self._wanted.min() <= place[-1] <= self._wanted.max():
                    omega = float(self._balance.omegas(place[-1:])[0])
                    height = abs(self._balance.coefficients(place[:-1])[0, c, 1])
                    self.peaks.append(Peak(c, omega, float(height), float(place[-1])))
        values = [
            (s, value)
            for value in self._wanted.tolist()
            for s in _crossings(lambda s, v=value: self._sign * (spline(s)[..., -1] - v), spline.x)
        ]
        for s, value in sorted(values):
            guess = np.append(spline(s)[:-1], value)
            place, _ = self._solved(guess, self._value, _POINT_MAXITER)
            if place is None or np.linalg.norm(place - guess) > _AWAY * np.linalg.norm(guess[:-1]):
                failure = f"no response was found at {value:g}, which the curve passes"
            else:
                self.points.append((place, int(np.sum(turns < s))))
        return failure

    def _spline(self, places: list[np.ndarray]) -> Any:
        """Return points of the curve as a function of the length between them."""
        from scipy.interpolate import CubicSpline

        units = np.full(self._balance.size + 1, np.ptp(places, axis=0)[:-1].max() or 1.0)
        units[-1] = self._range
        steps = np.linalg.norm(np.diff(places, axis=0) / units, axis=1)
        return CubicSpline(np.append(0.0, np.cumsum(steps)), places)


def _crossings(
    function: Callable[..., np.ndarray], lengths: np.ndarray, falling: bool = False
) -> np.ndarray:
    """Return where a function of the length changes its sign, or falls below 0."""
    from scipy.optimize import brentq

    parts = np.arange(_SPLINE_CHECKS_PER_STEP * (lengths.size - 1) + 1) / _SPLINE_CHECKS_PER_STEP
    s = np.interp(parts, np.arange(lengths.size), lengths)
    above = function(s) > 0
    turned = above[:-1] > above[1:] if falling else above[:-1] != above[1:]
    return np.array([brentq(function, s[k], s[k + 1]) for k in np.flatnonzero(turned)])
