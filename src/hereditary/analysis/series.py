"""Series of data that a model is compared with."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..support.checks import complaint, component_numbers, real_array, shown

# A residual that is no number counts as ten of the largest one, or of so many of the largest value.
_FAR = 1e2
# A curve of the model has at least so many points: about the pixels of a figure's width.
_FINE = 1000


class Series(NamedTuple):
    """Data at increasing times, and their standard deviations.

    t (n,), data (n, k), NaN where a value is missing or masked, and sigma (n, k) or None.
    """

    t: np.ndarray
    data: np.ndarray
    sigma: np.ndarray | None

    @property
    def size(self) -> int:
        """Number of values that are not missing."""
        return int(np.isfinite(self.data).sum())

    @property
    def largest(self) -> float:
        """Largest absolute value."""
        return float(np.nanmax(np.abs(self.data)))

    def finer_times(self):
        """Return times that divide the gaps between the data's times evenly."""
        parts = _FINE // self.t.size + 2
        places = np.arange((self.t.size - 1) * parts + 1) / parts
        return np.interp(places, np.arange(self.t.size), self.t)

    def seen(self, y, observe):
        """Return what is observed of rows (m, d), (m, k)."""
        rows, k = len(y), self.data.shape[1]
        if callable(observe):
            seen = np.asarray(observe(y))
        elif observe is None:
            seen = y[:, :k]
        else:
            seen = y[:, component_numbers(observe, y.shape[1], "observe")]
        if seen.shape[:1] != (rows,) or seen.size != rows * k or seen.dtype.kind not in "iuf":
            required = (
                f"give real values of shape ({rows}{f', {k}' if k > 1 else ','}), as data has"
            )
            got = f"shape {seen.shape} of {seen.dtype} from y of shape {y.shape}"
            raise ValueError(complaint("observe", required, got))
        return seen.reshape(rows, k)

    def lacking(self, solution, observe):
        """Return model minus data, (n, k): NaN where data are missing, inf where the run ended."""
        found = np.full(self.data.shape, np.inf)
        found[: len(solution.y)] = self.seen(solution.y, observe) - self.data[: len(solution.y)]
        found[np.isnan(self.data)] = np.nan
        return found

    def curve(self, solution, fine, observe):
        """Return times (m,) and values (m, k) of the model from a run to finer times.

        `observe` may need the data's times: the values are those of `solution`, at these times.
        """
        values = self.seen(solution.y, observe)
        try:
            often = self.seen(fine.y, observe)
            again = often[np.isin(fine.t, solution.t)]
            same = np.allclose(again, values, rtol=0, atol=1e-6 * self.largest)
        except ValueError:  # of shapes
            same = False
        return (fine.t, often) if same else (solution.t, values)

    def weighed(self, lacking):
        """Return what is not missing of residuals, over sigma, flat.

        Rows behind the end of a run count as far from the data, so that others are preferred.
        """
        sigma = 1.0 if self.sigma is None else self.sigma
        known = np.isfinite(lacking)
        far = 10 * max(_FAR * (self.largest or 1.0), np.abs(lacking[known]).max(initial=0.0))
        return (np.where(known, lacking, far) / sigma)[np.isfinite(self.data)]


def series_of(t, data, sigma) -> list[Series]:
    """Return series of data, checked; t and data are arrays, or lists of one for each series."""
    several = isinstance(t, (list, tuple)) and len(t) > 0 and np.ndim(t[0]) > 0
    if not several:
        return [_one("", t, data, sigma)]
    if not isinstance(data, (list, tuple)) or len(data) != len(t):
        required = f"be a list of {len(t)} series, as t is"
        raise ValueError(complaint("data", required, type(data).__name__))
    sigmas = sigma if isinstance(sigma, (list, tuple)) else [sigma] * len(t)
    if len(sigmas) != len(t):
        required = f"be one for all, or a list of {len(t)}"
        raise ValueError(complaint("sigma", required, f"{len(sigmas)} of them"))
    if len({one is None for one in sigmas}) > 1:
        raise ValueError(complaint("sigma", "be given for all series or for none", "some"))
    parts = enumerate(zip(t, data, sigmas, strict=True))
    return [_one(f"[{k}]", *part) for k, part in parts]


def _one(place, t, data, sigma):
    """Return one series; `place` is where it stands in a list."""
    times = real_array(f"t{place}", t)
    if times.ndim != 1 or times.size == 0 or np.any(np.diff(times) <= 0):
        raise ValueError(complaint(f"t{place}", "be increasing times (n,)", shown(times)))
    if np.iscomplexobj(np.asarray(data)):
        remedy = "give real and imaginary part as two values, and observe them"
        raise TypeError(complaint(f"data{place}", "be real", "complex numbers", remedy))
    values: np.ndarray = np.ma.array(data, dtype=float, copy=True).filled(np.nan)
    required = f"have shape ({times.size},) or ({times.size}, k), NaN for missing values"
    if values.ndim not in (1, 2) or len(values) != times.size:
        raise ValueError(complaint(f"data{place}", required, f"shape {values.shape}"))
    if np.any(np.isinf(values)) or not np.any(np.isfinite(values)):
        raise ValueError(complaint(f"data{place}", "be finite, or NaN", shown(values)))
    values = values.reshape(times.size, -1)
    if sigma is None:
        return Series(times, values, None)
    spread = real_array(f"sigma{place}", sigma)
    spread = spread[:, None] if spread.ndim == 1 and spread.size == times.size else spread
    try:
        spread = np.broadcast_to(spread, values.shape)
    except ValueError as error:
        required = "be one number, or have the shape of data"
        raise ValueError(complaint(f"sigma{place}", required, f"shape {spread.shape}")) from error
    if not np.all(spread > 0):
        raise ValueError(complaint(f"sigma{place}", "be above 0", shown(spread)))
    return Series(times, values, spread)
