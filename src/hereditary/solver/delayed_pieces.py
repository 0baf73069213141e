"""Pieces of the solution that delays read: how they begin, get room and are stored."""

from __future__ import annotations

from functools import lru_cache
from typing import TypeAlias

import numpy as np
from numpy.polynomial.chebyshev import cheb2poly
from numpy.polynomial.legendre import legvander, poly2leg

from ..compiled.delayed_values import FIRST, PIECES, USED, Delays
from ..equation.delay import Delayed
from ..stepping.dense import StepPieces
from .piecewise import Piecewise

# Fields of `Delays` with an entry for each piece.
_OF_PIECES = ("starts", "lengths", "variables", "places", "widths")
# Room for further pieces, and for coefficients of each component: those of one call of a march.
_ROOM = 260, 260 * 13
# Halvings of the first given step towards its start, where the solution has powers of time. The
# values there are polynomials of 16 coefficients, so that 50 halvings leave rounding.
_HALVINGS_TO_START = 50
# Points in [-1, 1] of these polynomials.
_START_POINTS = np.cos(np.pi * (np.arange(16) + 0.5) / 16)
_FROM_POINTS = np.linalg.inv(legvander(_START_POINTS, 15))

# Starts (n,), lengths (n,) and Legendre coefficients (n, d, k) of polynomials in time.
_Polynomials: TypeAlias = tuple[np.ndarray, np.ndarray, np.ndarray]


def first_pieces(
    known: Delays,
    by_means: np.ndarray,
    delays: tuple[Delayed, ...],
    taus: list[Piecewise | None],
    pasts: list[Piecewise | None],
    y: np.ndarray | None,
) -> Delays:
    """Return the record of a march at its start, from the one that the equation has."""
    # y (d,): at the start of given steps, else None
    ranges, parts = [0], list[_Polynomials]()
    for delay, tau, past in zip(delays, taus, pasts, strict=True):
        before = past and _polynomials(past)
        if not callable(delay.past.delay.past):
            before = np.array([-1.0]), np.ones(1), delay.before(-np.ones(1))[:, :, None]
        for part in (tau and _polynomials(tau), before):
            parts += [part] if part else []
            ranges += 2 * [ranges[-1] + (part[0].size if part else 0)]
    n, given = ranges.pop(), [delay.past.delay.tau for delay in delays]
    found = known._replace(
        **{name: getattr(known, name)[:0] for name in (*_OF_PIECES, "numbers")},
        counts=np.zeros(3, dtype=np.int64),
        taus=np.array([np.nan if callable(tau) else tau for tau in given]),
        windows=np.tile([-np.inf, np.inf], (len(delays), 1)),
        ranges=np.array(ranges),
        by_means=by_means,
        read_at=np.array([np.nan]),
    )
    for part in parts:
        found = _added(found, *part)
    found.counts[FIRST] = n
    return found if y is None else _added(found, np.zeros(1), np.ones(1), y[None, :, None])


def _polynomials(found: Piecewise) -> _Polynomials:
    """Return a function of the user as polynomials."""
    coefficients = found.coefficients @ _of_chebyshev(found.coefficients.shape[2]).T
    return found.edges[:-1], np.diff(found.edges), coefficients


@lru_cache(maxsize=1)
def _of_chebyshev(n: int) -> np.ndarray:
    """Return the matrix from n Chebyshev coefficients to those of Legendre polynomials, (n, n)."""
    return np.array([np.append(poly2leg(cheb2poly(row)), np.zeros(n))[:n] for row in np.eye(n)]).T


def _added(delays: Delays, starts: np.ndarray, lengths: np.ndarray, values: np.ndarray) -> Delays:
    """Return the record with further pieces, polynomials in time, (n, d, k)."""
    n, d, width = values.shape
    delays = _longer(delays, n, values.size)
    pieces, used, _ = delays.counts.tolist()
    to = slice(pieces, pieces + n)
    delays.starts[to], delays.lengths[to], delays.widths[to] = starts, lengths, width
    delays.variables[to], delays.places[to] = (1.0, 1.0, 0.0), used + d * width * np.arange(n)
    delays.numbers[used : used + values.size] = values.ravel()
    delays.counts[:2] = pieces + n, used + values.size
    delays.read_at[:] = np.nan
    return delays


def appended(delays: Delays, piece: StepPieces, n: int, earliest: float) -> Delays:
    """Return the record with pieces of given steps from number n on, as parabolas."""
    # The last piece is y at the end, and makes way for the next step. So a time that is that of a
    # row has its y, whatever steps one call has made.
    times, rows, h = piece.times, piece.rows, np.diff(piece.times)
    mean = np.diff(rows, axis=0) / h[:, None]
    bend = 0.5 * (piece.slopes[1:] - mean)
    values = np.stack([rows[:-1], mean - bend, bend], axis=2)
    delays.counts[:2] -= 1, rows.shape[1]
    drop_before(delays, earliest)
    known = min(max(2 - n, 0), h.size) if piece.starting is not None else 0
    for k in range(known):
        halvings = np.arange(_HALVINGS_TO_START if n + k == 0 else 0, -1, -1)
        edges = times[k] + h[k] * np.append(0.0, 0.5**halvings)
        lengths = np.diff(edges)
        points = edges[:-1, None] + 0.5 * lengths[:, None] * (1.0 + _START_POINTS)
        inside = piece.starting.near(n + k + 1, points.ravel(), 0).reshape(*points.shape, -1)
        first = piece.starting.near(n + k + 1, edges[:-1], 0)
        first[0] = rows[k]
        means = (inside - first[:, None]) / (points - edges[:-1, None])[:, :, None]
        means = np.einsum("jk,nkd->ndj", _FROM_POINTS, means)
        numbers = np.concatenate([first[:, :, None], means], axis=2)
        delays = _added(delays, edges[:-1], lengths, numbers)
    delays = _added(delays, times[known:-1], h[known:], values[known:])
    return _added(delays, times[-1:], np.ones(1), rows[-1][None, :, None])


def set_last(delays: Delays, y: np.ndarray) -> None:
    """Set the last piece of given steps to y (d,)."""
    place = delays.places[delays.counts[PIECES] - 1]
    delays.numbers[place : place + y.size], delays.read_at[:] = y, np.nan


def drop_before(delays: Delays, earliest: float) -> None:
    """Drop pieces of the solution that end before a time."""
    pieces, used, first = delays.counts.tolist()
    ends = delays.starts[first:pieces] + delays.lengths[first:pieces]
    old = int(np.searchsorted(ends, earliest))
    if old in (0, pieces - first):
        return
    place = int(delays.places[first])
    gone = int(delays.places[first + old]) - place
    for name in _OF_PIECES:
        array = getattr(delays, name)
        array[first : pieces - old] = array[first + old : pieces].copy()
    delays.numbers[place : used - gone] = delays.numbers[place + gone : used].copy()
    delays.places[first : pieces - old] -= gone
    delays.counts[:2] = pieces - old, used - gone


def roomy(delays: Delays, earliest: float) -> Delays:
    """Return the record with room for the steps of one call of a march."""
    more = _ROOM[0], _ROOM[1] * delays.by_means.size
    if not _has_room(delays, *more):
        drop_before(delays, earliest)
    return _longer(delays, *more)


def _has_room(delays: Delays, n_pieces: int, n_numbers: int) -> bool:
    """Return whether there is room for further pieces and numbers."""
    pieces, used, _ = delays.counts.tolist()
    return pieces + n_pieces <= delays.starts.size and used + n_numbers <= delays.numbers.size


def _longer(delays: Delays, n_pieces: int, n_numbers: int) -> Delays:
    """Return the record with room for further pieces and numbers, twice as much as it has."""
    if _has_room(delays, n_pieces, n_numbers):
        return delays
    pieces, used, _ = delays.counts.tolist()
    longer = {}
    for name in (*_OF_PIECES, "numbers"):
        array, n = getattr(delays, name), pieces + n_pieces
        n = 2 * (used + n_numbers if name == "numbers" else n)
        longer[name] = np.zeros((n, *array.shape[1:]), array.dtype)
        longer[name][: min(n, len(array))] = array[:n]
    return delays._replace(**longer)


def solved(delays: Delays) -> tuple[np.ndarray, np.ndarray]:
    """Return the displacements of pasts, and the coefficients of the solution."""
    pieces, used, first = delays.counts.tolist()
    place = int(delays.places[first]) if first < pieces else used
    return delays.displacements, delays.numbers[place:used]


def contents(delays: Delays) -> tuple[np.ndarray, ...]:
    """Return copies of the pieces of the solution, and of the displacements of pasts."""
    pieces, _, first = delays.counts.tolist()
    parts = [getattr(delays, name)[first:pieces] for name in _OF_PIECES]
    return tuple(part.copy() for part in (*parts, *solved(delays)))


def with_contents(delays: Delays, contents: tuple[np.ndarray, ...]) -> Delays:
    """Return the record with pieces of the solution from `contents` in place of its own."""
    *parts, displacements, numbers = contents
    delays.counts[USED] -= solved(delays)[1].size
    delays.counts[PIECES] = delays.counts[FIRST]
    _, used, first = delays.counts.tolist()
    n = len(parts[0])
    delays = _longer(delays, n, numbers.size)
    for name, part in zip(_OF_PIECES, parts, strict=True):
        getattr(delays, name)[first : first + n] = part
    delays.places[first : first + n] += used - delays.places[first : first + 1]
    delays.numbers[used : used + numbers.size] = numbers
    delays.displacements[:], delays.read_at[:] = displacements, np.nan
    delays.counts[:2] = first + n, used + numbers.size
    return delays
