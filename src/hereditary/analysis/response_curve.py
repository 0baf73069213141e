"""A curve of steady responses, followed through its turning points by its length."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

# Newton iterations at a frequency, their tolerance, and that where rounding ends them.
_ITERATIONS, _TOLERANCE, _STALLED = 30, 1e-12, 1e-7
# Longest step across a turning point.
_TURN = 1e-3
# Shortest and longest step along the curve, as shares of the range of frequencies and of the size
# of responses, the growth of steps after few iterations, and the most points of a curve.
_SHORTEST, _LONGEST, _GROW, _FEW, _MOST_POINTS = 1e-7, 0.03, 1.5, 3, 20_000
# Cosine of the largest bend between two points, iterations to the next one and how near they come.
_STRAIGHT, _TRIES, _NEAR = 0.9, 8, 1e-7
# Places at which a piece of the curve between two points is looked at for peaks, and their powers.
_SHARES = np.linspace(0.0, 1.0, 33)
_POWERS = np.vander(_SHARES, 4, increasing=True)
# Least unit of responses, as a share of the largest so far.
_LEAST = 1e-6


class Peak(NamedTuple):
    """Largest amplitude of a component's first harmonic on a piece of the curve.

    component, frequency omega [1/time], amplitude, and the parameter followed, value.
    """

    component: int
    omega: float
    amplitude: float
    value: float


class Point(NamedTuple):
    """A response: unknowns, value of the parameter followed, and turning points passed before."""

    x: np.ndarray
    value: float
    branch: int


class Curve:
    """Responses along a curve through a range of frequencies, or of another parameter."""

    def __init__(self, balance, wanted, positive):
        self._balance, self._wanted, self._positive = balance, wanted, positive
        self.found: list[Point] = []
        self.turning: list[float] = []
        self.peaks: list[Peak] = []
        self._missed = ""
        self._sign = 1.0 if wanted[-1] >= wanted[0] else -1.0
        self._range = abs(wanted[-1] - wanted[0]) or abs(wanted[0]) or 1.0
        self._unit = 0.0 if positive else self._range

    def follow(self):
        """Follow the curve to the last value; return why it could not be, or nothing."""
        value = float(self._wanted[0])
        x = self._at(np.zeros(self._balance.size), value)
        if x is None:
            remedy = "begin elsewhere, or give jac and write y in units of its size"
            return f"no response was found at the first value, {value:g}: {remedy}"
        self.found.append(Point(x, value, 0))
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
            self._climb((x, value), tangent * step, ahead, turned)
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
        beside = self._balance.by_value(x, value, self._unit, residual)[:, None]
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
            found = self._at(guess, float(wanted))
            near = 2 * float(np.linalg.norm(new_x - x)) + 1e-6 * float(np.linalg.norm(x))
            if found is None or np.linalg.norm(found - guess) > near:
                self._missed = f"no response was found at {wanted:g}, which the curve passes"
            else:
                self.found.append(Point(found, float(wanted), branch))

    def _climb(self, point, onwards, ahead, turned):
        """Note components whose amplitude is largest between two points of the curve.

        By the cubics through both in the length along the first tangent, of which `onwards` is the
        step; `turned` is the direction at the second.
        """
        rises = self._balance.rises(point[0], onwards[:-1])
        rising = (rises > 0) & (self._balance.rises(ahead[0], turned[:-1]) < 0)
        if not rising.any():
            return
        turned = turned * (self._product(onwards, onwards) / self._product(turned, onwards))
        first, last = np.append(*point), np.append(*ahead)
        square = 3 * (last - first) - 2 * onwards - turned
        cubics = np.stack([first, onwards, square, last - first - onwards - square])
        heights = self._balance.amplitudes(_POWERS @ cubics[:, :-1])
        for c in np.flatnonzero(rising):
            top = int(np.clip(np.argmax(heights[:, c]), 1, _SHARES.size - 2))
            near = slice(top - 1, top + 2)
            bend, slope, _ = np.polyfit(_SHARES[near] - _SHARES[top], heights[near, c], 2)
            at = _SHARES[top] - (slope / (2 * bend) if bend < 0 else 0.0)
            place = (np.clip(at, 0.0, 1.0) ** np.arange(4)) @ cubics
            value = float(place[-1])
            if self._wanted.min() <= value <= self._wanted.max():
                height = float(self._balance.amplitudes(place[None, :-1])[0, c])
                omega = float(self._balance.omegas([value])[0])
                self.peaks.append(Peak(int(c), omega, height, value))

    def _at(self, x, value):
        """Solve at a value from a first guess; return unknowns, or None."""
        before = np.inf
        for _ in range(_ITERATIONS):
            residual, matrix = self._balance.residual(x, value)
            if not np.all(np.isfinite(residual)) or not np.all(np.isfinite(matrix)):
                return None
            try:
                change = np.linalg.solve(matrix, residual)
            except np.linalg.LinAlgError:
                return None
            x = x - change
            size, norm = float(np.linalg.norm(change)), max(float(np.linalg.norm(x)), 1e-300)
            if size <= _TOLERANCE * norm or 0.25 * before <= size <= _STALLED * norm:
                return x
            before = size
        return None
