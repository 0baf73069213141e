"""Steady response to a periodic force, by harmonic balance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..equation.equation import Equation, current_equation
from ..solver.elsewhere import OF_SOLVE, lacking
from ..support.checks import count, real_array, refuse, shown
from ..support.warning import warn
from .harmonic_balance import Balance
from .response_curve import Curve, Peak

# Fewest frequencies at which a response exceeds 1 / sqrt(2) of its peak, for a width of the peak.
_LEAST_ABOVE = 8
# Most values of the parameter at which the period of the force is checked.
_MAX_PERIOD_CHECKS = 16


@dataclass(frozen=True, eq=False)
class FrequencyResponse:
    """Periodic responses along a curve of frequencies, or of another parameter.

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
        Number of turning points before; a slow sweep jumps over the odd branches.
    turning : ndarray, shape (m,)
        Values of that parameter at the turning points.
    peaks : list of Peak
        Largest amplitudes along the curve, also between the given values.
    complete : bool
        Whether the curve was followed to the last value.
    message : str
    """

    omega: np.ndarray
    values: np.ndarray
    coefficients: np.ndarray
    branch: np.ndarray
    turning: np.ndarray
    peaks: list[Peak]
    complete: bool
    message: str

    def __repr__(self) -> str:
        span = f", omega = {self.omega.min():g} .. {self.omega.max():g}" if self.omega.size else ""
        counts = f"{self.omega.size} responses{span}; {self.turning.size} turning points"
        return f"FrequencyResponse({counts}; {self.message})"

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
        """Return frequency and amplitude of the highest response of a component.

        It is the highest of `peaks` and of the responses at the given values; NaN if there are
        none. The peaks for several forces are the backbone curve.
        """
        candidates = [(p.amplitude, p.omega) for p in self.peaks if p.component == component]
        candidates += zip(self.amplitude[:, component].tolist(), self.omega.tolist(), strict=True)
        height, omega = max(candidates, default=(float("nan"), float("nan")))
        return omega, height

    def quality(self, component: int = 0) -> float:
        """Return the quality factor: peak frequency over the width at 1 / sqrt(2) of the peak.

        It uses the given frequencies. It is NaN if fewer than eight of them are above that height,
        or if the curve does not fall so far on both sides. It is also NaN if the curve does not
        follow the frequency.
        """
        a, (centre, height) = self.amplitude[:, component], self.peak(component)
        below, level = np.flatnonzero(a < height / np.sqrt(2)), height / np.sqrt(2)
        top = int(np.argmax(a)) if a.size else 0
        left, right = below[below < top][-1:], below[below > top][:1]
        by_frequency = np.array_equal(self.values, self.omega)
        if a.size - below.size < _LEAST_ABOVE or not (by_frequency and left.size and right.size):
            return float("nan")
        ends = [
            np.interp(level, a[pair], self.omega[pair])
            for pair in (np.append(left, left + 1), np.append(right, right - 1))
        ]
        return float(centre / abs(ends[1] - ends[0]))


@lacking(
    "responses are periodic, of a memory without a start: harmonics sets their accuracy",
    params=OF_SOLVE["params"],
)
def frequency_response(
    equation: Equation,
    omegas: ArrayLike,
    *,
    frequency: int = 0,
    along: int | None = None,
    harmonics: int = 7,
) -> FrequencyResponse:
    """Compute the periodic response of an equation with memory to a force of each frequency.

    The memory starts at minus infinity, so that periodic solutions exist. An operator of order
    alpha multiplies the k-th harmonic by ``(i k omega)**alpha``. A memory kernel with m derivatives
    multiplies it by ``(i k omega)**m`` times its Laplace transform. Newton's method finds the
    coefficients of the harmonics, with the right-hand side evaluated over a period. The curve of
    solutions is followed by its arclength, also around turning points. Frequencies closer to a
    turning point than about 1e-6 of the range may be passed over.

    Parameters
    ----------
    equation : Equation
        With constant orders, and kernels whose Laplace transform is known. Its right-hand side has
        the period 2 pi / omega in t, and omega is one of its parameters. It may read memory.
    omegas : array_like, shape (n,)
        Angular frequencies above 0, all increasing or all decreasing [1/time]. Responses are found
        at each, starting with the first. With `along`, values of that parameter.
    frequency : int, optional
        Number of the parameter that is omega.
    along : int, optional
        Number of another parameter, such as the force. The curve then follows this parameter, at
        the frequency of the equation.
    harmonics : int, optional
        Highest harmonic H.

    Returns
    -------
    FrequencyResponse
        Its `complete` is false if the curve could not be followed to its end.

    Warns
    -----
    UserWarning
        Neither terms nor right-hand side depend on a mean of y, which is set to 0.

    Notes
    -----
    An equation whose memory starts at a finite time has no exact periodic solution. The response of
    a run in time tends to the periodic one like a power of t. Stability is not computed. At a
    turning point of the curve two responses meet, and one of them is unstable.

    Error
    -----
    Harmonics above H are omitted, and the right-hand side is sampled 8 H times a period, at least
    129 times. Errors decrease with H as the harmonics of response and force do. Linear equations
    are solved to rounding if the force has no harmonics above H; a pulse or a jump needs a larger
    H. Turning points have errors of about 1e-6 of the range. The error of a fitted sum of
    exponentials is also an error of the response. Fit it closely, to a t_max far above the longest
    period.

    Cost
    ----
    About ten systems of d (2 H + 1) unknowns for each frequency: 2 to 3 ms for one component.

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
    equation = current_equation(equation)
    _check(equation, frequency, along)
    followed = frequency if along is None else int(along)
    wanted = _followed(omegas, followed == frequency)
    balance = Balance(equation, frequency, followed, count("harmonics", harmonics))
    balance.check_period(
        wanted[np.unique(np.linspace(0, wanted.size - 1, _MAX_PERIOD_CHECKS).astype(int))]
    )
    if balance.hold_means(float(wanted[0])):
        free = "a mean of y is free, because neither terms nor rhs depend on it: 0 is taken"
        warn(free, UserWarning)
    curve = Curve(balance, wanted, followed == frequency)
    failure = curve.follow()
    places = np.array([place for place, _ in curve.points]).reshape(-1, balance.size + 1)
    values = places[:, -1]
    return FrequencyResponse(
        omega=balance.omegas(values),
        values=values,
        coefficients=balance.coefficients(places[:, :-1]),
        branch=np.array([branch for _, branch in curve.points], dtype=np.int64),
        turning=np.array(curve.turning),
        peaks=curve.peaks,
        complete=not failure,
        message=failure or "the curve was followed to the last value",
    )


def _followed(omegas: ArrayLike, positive: bool) -> np.ndarray:
    """Return frequencies, or values of another parameter, checked."""
    wanted = np.atleast_1d(real_array("omegas", omegas))
    steps = np.diff(wanted)
    monotone = np.all(steps > 0) or np.all(steps < 0)
    bad = positive and np.any(wanted <= 0)
    if wanted.ndim != 1 or wanted.size == 0 or not monotone or bad:
        kind = "frequencies above 0" if positive else "values"
        refuse("omegas", f"be {kind}, all increasing or all decreasing", shown(wanted))
    return wanted


def _check(equation: Equation, frequency: int, along: int | None) -> None:
    """Refuse equations whose operators have no symbol at i omega, and unsuitable parameters."""
    if equation.t_start != 0:
        refuse("t_start", "be 0", equation.t_start, "steady responses know no start")
    system, speeds = equation.system, equation.system.frame.speeds
    derivatives = "write derivatives as components, orders in Caputo([...])"
    for present, required, remedy in (
        (system.frame.paired, "have real y", "write real and imaginary parts as components"),
        (any(speed >= 0 for speed in speeds), "have orders up to 2", derivatives),
        (speeds, "have no matrix with a row of zeros", "state coefficients of shape (d,)"),
        (system.varies, "have constant orders", "take those of one time"),
        (system.callbacks, "have functions that numba compiles", "use arithmetic and NumPy"),
        (system.delays, "have no delays", "solve(...) until the motion is periodic"),
    ):
        if present:
            refuse("equation", required, repr(equation), remedy)
    p = equation.params.size
    numbers = {"frequency": frequency} | ({} if along is None else {"along": along})
    for name, number in numbers.items():
        whole = isinstance(number, (int, np.integer)) and not isinstance(number, bool)
        if not whole or not 0 <= number < p:
            required = f"be the number of a parameter, 0 .. {p - 1}" if p else "name a parameter"
            refuse(name, required, repr(number))
    if along is not None and along != frequency and not equation.params[frequency] > 0:
        required = f"have a frequency above 0, params[{frequency}]"
        refuse("equation", required, equation.params[frequency])
