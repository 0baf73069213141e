"""The 0-1 test for chaos, of a series or of the maxima of a solution."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from ..solver.solution import Solution
from ..support.checks import count, real_array, refuse
from .sections import extrema, tops

# Fewest values of a series.
_MIN_SERIES_VALUES = 200
# Longest lag of mean square displacements, as a fraction of the length of the series.
_MAX_LAG_FRACTION = 0.1
# Range of the random frequencies. It excludes the resonances at 0 and pi.
_FREQUENCY_RANGE = (np.pi / 5, 4 * np.pi / 5)
# Maxima that differ by less than this fraction of the component's range are equal.
_MAXIMA_TOL = 1e-3
# Values of a series that differ by less than this fraction of the largest are equal.
_VALUES_RTOL = 1e-10
# Signs of the extrema that are tested: maxima alone, or minima as well.
_SIGNS = {"maxima": (1.0,), "extrema": (1.0, -1.0), "values": ()}
# The series is chaotic if the median K exceeds this, and regular if it is below one minus this.
_MIN_CHAOTIC_K = 0.8


@dataclass(frozen=True, eq=False)
class ZeroOneResult:
    """Outcome of the 0-1 test.

    Attributes
    ----------
    k : float
        Median of the growth rates: near 1 for chaos, near 0 for regular motion [-].
    verdict : str
        "chaotic" for k above 0.8, "regular" for k below 0.2, else "undetermined".
    rates : ndarray, shape (n_c,)
        Growth rate K_c for each frequency c.
    frequencies : ndarray, shape (n_c,)
    n : int
        Length of the series.
    """

    k: float
    verdict: str
    rates: np.ndarray = field(repr=False)
    frequencies: np.ndarray = field(repr=False)
    n: int


def zero_one_test(
    series: Solution | ArrayLike,
    *,
    component: int = 0,
    transient: float | None = None,
    take: str | None = None,
    n_c: int = 100,
    seed: int = 0,
) -> ZeroOneResult:
    """Test a series for chaos by the 0-1 test: do translations driven by it diffuse?

    For a series x_j and frequencies c let ``p_n = sum_(j<=n) x_j cos(j c)``, and q_n the same sum
    with sines. They move like Brownian motion if the series is chaotic, and stay bounded if it is
    regular. The mean square displacement less its oscillating part
    ``mean(x)**2 (1 - cos n c) / (1 - cos c)`` has the correlation K_c with n. K is the median over
    c.

    Parameters
    ----------
    series : Solution or array_like, shape (n,)
        At least 200 values; a verdict usually needs a few thousand.
    component, transient : optional
        Of a solution: as in `maxima`.
    take : {"values", "maxima", "extrema"}, optional
        Whether all values of a series are tested, its local maxima, or maxima and minima in turn.
        Neighbours must be far apart in time: all values of an oversampled series look regular. By
        default all values of an array, which may be a map's, and the maxima of a `Solution`, which
        knows no "values". Extrema that differ by less than a thousandth of the range are the same.
    n_c : int, optional
        Number of frequencies, at random in (pi/5, 4 pi/5).
    seed : int, optional

    Returns
    -------
    ZeroOneResult

    Notes
    -----
    K describes the part of the orbit that you give. With memory an orbit may approach its limit
    slowly, like t**-a, so give a late part. The test cannot distinguish chaos from noise;
    docs/chaos.md compares it with exponents.

    Source
    ------
    [GottwaldMelbourne2009], eqs. (2.1), (3.1) to (3.4).

    Examples
    --------
    >>> import numpy as np
    >>> import hereditary as hd
    >>> x = [0.3]
    >>> for _ in range(999):
    ...     x.append(4 * x[-1] * (1 - x[-1]))
    >>> found = hd.zero_one_test(x)
    >>> found.verdict, found.k > 0.98
    ('chaotic', True)
    """
    values, least = _tested(series, component, transient, take)
    if values.ndim != 1 or values.size < _MIN_SERIES_VALUES:
        required = f"hold {_MIN_SERIES_VALUES} values or more"
        remedy = "run longer: so many maxima, or values, are needed"
        refuse("series", required, f"shape {values.shape}", remedy)
    spread = float(np.ptp(values))
    values = (values - values[0]) / spread if spread > least else np.zeros(values.size)
    random = np.random.default_rng(seed)
    frequencies = random.uniform(*_FREQUENCY_RANGE, count("n_c", n_c))
    rates = np.array([_rate(values, c) for c in frequencies])
    k = float(np.median(rates))
    verdict = (
        "chaotic" if k > _MIN_CHAOTIC_K else "regular" if k < 1 - _MIN_CHAOTIC_K else "undetermined"
    )
    return ZeroOneResult(k, verdict, rates, frequencies, values.size)


def _tested(
    series: Solution | ArrayLike, component: int, transient: float | None, take: str | None
) -> tuple[np.ndarray, float]:
    """Return the values that are tested, and the range below which they count as equal."""
    of_solution = isinstance(series, Solution)
    take = ("maxima" if of_solution else "values") if take is None else take
    kinds = [*_SIGNS][: 2 if of_solution else 3]
    if take not in kinds:
        refuse("take", f"be {' or '.join(map(repr, kinds))}", repr(take))
    if isinstance(series, Solution):
        _, values = extrema(series, component, 0, transient, _SIGNS[take])
        late = series.t >= (series.t[0] if transient is None else transient)
        return values, _MAXIMA_TOL * np.ptp(series.y[late, component]) if late.any() else 0.0
    values = real_array("series", series)
    if take == "values" or values.ndim != 1:
        return values, _VALUES_RTOL * np.abs(values).max(initial=0.0)
    return values[tops(values, _SIGNS[take])], _MAXIMA_TOL * np.ptp(values) if values.size else 0.0


def _rate(values: np.ndarray, c: float) -> float:
    """Return the growth rate of displacements at frequency c."""
    turns = np.exp(1j * c * np.arange(1, values.size + 1))
    place = np.cumsum(values * turns)
    n = np.arange(1, int(_MAX_LAG_FRACTION * values.size) + 1)
    steps = values.size - n[-1]
    displaced = np.array([np.mean(np.abs(place[k : k + steps] - place[:steps]) ** 2) for k in n])
    displaced -= np.mean(values) ** 2 * (1 - np.cos(n * c)) / (1 - np.cos(c))
    if np.ptp(displaced) <= 1e-12 * np.abs(displaced).max(initial=1e-300):
        return 0.0
    return float(np.corrcoef(n, displaced)[0, 1])
