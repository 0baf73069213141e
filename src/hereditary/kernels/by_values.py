"""Memory kernels from a function or from a table of values."""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..support.checks import complaint, real, real_array, refuse
from .exponential_sum import fit_interval
from .kernel_fits import closest_signed, closest_table, root_mean_square
from .memory_kernel import ExponentialSum, MemoryKernel
from .special import gauss_unit

# Times at which the behaviour at 0 is read: the smallest one at which the function has a value.
_TIMES_NEAR_0 = 10.0 ** np.arange(-290.0, 1.0, 10.0)
_MIN_FIT_TIME = 1e-300
# Fit points per factor e of time before the first datum of a table, where the fit follows the power
# law of the run.
_PER_E_FOLD = 24
_GAUSS_NODES, _GAUSS_WEIGHTS = gauss_unit(20)


class Kernel(MemoryKernel):
    """A memory kernel from a function K(t).

    Parameters
    ----------
    function : callable
        K at times t > 0 of shape (n,), or at one time; smooth there.
    singular_exponent : float, optional
        The a of ``K ~ t**-a`` near 0, 0 <= a < 1 [-]; by default found from the function.
    signed : bool
        Whether K may grow or change its sign. Its fit then has weights of both signs. Errors count
        relative to the largest ``|K|`` from each time on, or a thousandth of the mean of it.

    Notes
    -----
    Unless `signed`, K must be completely monotone: positive, decreasing, convex and so on. Kernels
    that rise or are negative are refused. Other deviations appear in the error of the fit. A run
    judges a kernel by its values from 1e-8 of the run's end on, for any steps. Give the exponent if
    rounding spoils the function at small times.

    Examples
    --------
    >>> import numpy as np
    >>> from hereditary import Kernel
    >>> kernel = Kernel(lambda t: 1 / np.sqrt(t * (1 + t)))
    >>> kernel.singular_exponent
    0.5
    >>> kernel.fit(1e-3, 1e3, 1e-6).max_error < 1e-6
    True
    """

    by_values = True

    def __init__(
        self,
        function: Callable[..., ArrayLike],
        singular_exponent: float | None = None,
        signed: bool = False,
    ) -> None:
        if not callable(function):
            remedy = "use Kernel.from_table(t, K) for data"
            refuse("function", "be callable", repr(function), remedy, kind=TypeError)
        if not isinstance(signed, (bool, np.bool_)):
            refuse("signed", "be True or False", repr(signed), kind=TypeError)
        self._function, self._signed = function, bool(signed)
        self._knots = np.zeros(0)
        if singular_exponent is None:
            self._exponent = self._slope_at_zero()
        else:
            self._exponent = real("singular_exponent", singular_exponent)
        if not 0 <= self._exponent < 1:
            required = "be integrable at 0 (K ~ t**-a with 0 <= a < 1)"
            refuse("function", required, f"a = {self._exponent:.4g}")

    def __repr__(self) -> str:
        name = getattr(self._function, "__name__", repr(self._function))
        signed = ", signed=True" if self._signed else ""
        exponent = f"singular_exponent={self.singular_exponent:.6g}"
        return f"{type(self).__name__}({name}, {exponent}{signed})"

    @staticmethod
    def from_table(t: ArrayLike, values: ArrayLike, signed: bool = False) -> Kernel:
        """Return the kernel of a table.

        Parameters
        ----------
        t, values : array_like, shape (n,)
            Increasing times, n >= 4 [time], and K there [unit of the kernel].
        signed : bool
            Whether K may grow. If not, the table is that of a `TabulatedKernel`: positive, and
            smooth through noise. If it may, log(K) is the cubic spline over log(t) through all
            positive values. K follows power laws before and after them. Zeros at the beginning and
            at the end of the table do not count.

        Returns
        -------
        Kernel

        Examples
        --------
        Shares of infections that occur so many days after the first one:

        >>> import hereditary as hd
        >>> shares = [0.0, 0.1, 0.3, 0.25, 0.2, 0.1, 0.05, 0.0]
        >>> kernel = hd.Kernel.from_table(range(8), shares, signed=True)
        >>> round(float(kernel(2.0)), 12), round(float(kernel.integral(100.0)), 2)
        (0.3, 1.08)
        """
        return _curve(t, values) if signed else TabulatedKernel(t, values)

    @property
    def singular_exponent(self) -> float:
        """Exponent a of ``K ~ t**-a`` near 0 [-]: the given one, or the slope of values near 0."""
        return self._exponent

    @property
    def measured(self) -> bool:
        """Whether the kernel is that of a table, whose values between the data are unknown."""
        return self._knots.size > 0

    def __call__(self, t: ArrayLike) -> np.ndarray:
        """Return the kernel values, the shape of `t`."""
        t = np.asarray(t, dtype=float)
        values = self._at(t.ravel())
        bad = np.flatnonzero(~np.isfinite(values) & (t.ravel() > 0))
        if bad.size:
            got = f"{values[bad[0]]} at t = {t.ravel()[bad[0]]:g}"
            refuse("function", "give finite values at t > 0", got)
        return values.reshape(t.shape)

    def _at(self, t: np.ndarray) -> np.ndarray:
        """Return the values of the function at times (n,), one by one if it accepts no arrays."""
        values = np.empty(0)
        with suppress(Exception):  # whatever it is: one by one will tell
            values = np.asarray(self._function(t))
        if values.shape != t.shape:
            values = np.array([self._alone(float(time)) for time in t])
        if values.dtype.kind not in "iuf" or values.shape != t.shape:
            got = f"dtype {values.dtype}, shape {values.shape}"
            refuse("function", "give one real number for each time", got, kind=TypeError)
        return values.astype(float)

    def _alone(self, t: float) -> Any:
        """Return the value of the function at one time."""
        try:
            return self._function(t)
        except Exception as error:
            got = f"{type(error).__name__} at t = {t:g}: {error}"
            raise ValueError(
                complaint("function", "give a kernel's value at t > 0", got)
            ) from error

    def _slope_at_zero(self) -> float:
        """Return a of K ~ t**-a from values at the smallest times; an a near 0 counts as 0."""
        with np.errstate(all="ignore"):
            values = self._at(np.concatenate([_TIMES_NEAR_0, 2 * _TIMES_NEAR_0]))
        pairs = np.abs(values).reshape(2, -1)
        usable = np.flatnonzero(np.all(np.isfinite(pairs) & (pairs > 0), axis=0))
        if usable.size == 0 and np.isfinite(pairs).all():
            return 0.0  # the function is 0 up to some time
        if usable.size == 0:
            refuse("function", "give finite values at t > 0", "none near 0")
        first, second = pairs[:, usable[0]]
        a = math.log2(first / second)
        rounded = round(a, 6)
        a = rounded if abs(a - rounded) < 1e-8 else a
        return 0.0 if a < 0.01 else a  # a logarithm has slopes like 1/log(t)

    def integral(self, t: ArrayLike) -> np.ndarray:
        """Return ``int_0^t K``, by Gauss rules on panels down to where K is ``c t**-a``.

        Full precision where K is smooth from each time to four times that.
        """
        t = np.asarray(t, dtype=float)
        ends, p = np.unique(t[t > 0]), 1 - self.singular_exponent
        if ends.size == 0:
            return np.zeros(t.shape)
        low = max(ends[0] * 2.0 ** (-56 / p), min(_MIN_FIT_TIME, ends[0]))
        n = math.ceil(math.log(ends[-1] / low) / math.log(4.0)) + 1
        edges = np.unique(np.concatenate([np.geomspace(low, ends[-1], n)[:-1], ends, self._knots]))
        edges = edges[edges <= ends[-1]]
        sizes = np.diff(edges)[:, None]
        values = self(edges[:-1, None] + sizes * _GAUSS_NODES)
        panels = (sizes * _GAUSS_WEIGHTS * values).sum(axis=1)
        first = edges[0] * float(self(edges[0])) / p
        sums = np.cumsum(np.append(first, panels))
        return np.where(t > 0, sums[np.searchsorted(edges, t)], 0.0)

    def _closest(self, t_min: float, t_max: float, tol: float, fading: bool) -> ExponentialSum:
        """Return the closest sum, with weights of both signs if the kernel is signed."""
        if not self._signed:
            return super()._closest(t_min, t_max, tol, fading)
        return ExponentialSum(*closest_signed(self, t_min, t_max, tol, fading))


def _columns(t: ArrayLike, values: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """Return the columns of a table, which increases in t."""
    times, kernel = real_array("t", t), real_array("values", values)
    if times.ndim != 1 or times.shape != kernel.shape or times.size < 4:
        got = f"shapes {times.shape} and {kernel.shape}"
        refuse("t", "have shape (n,) as values, n >= 4", got)
    if np.any(np.diff(times) <= 0):
        refuse("t", "increase", times.tolist()[:6], "sort the table by t")
    return times, kernel


def _curve(t: ArrayLike, values: ArrayLike) -> Kernel:
    """Return the kernel whose logarithm is a cubic spline over log(t), straight at both ends."""
    from scipy.interpolate import CubicSpline

    times, data = _columns(t, values)
    used = np.flatnonzero(data != 0)
    inner = slice(used[0], used[-1] + 1) if used.size else slice(0)
    times, data = times[inner], data[inner]
    if times.size < 4 or times[0] <= 0 or np.any(data <= 0):
        required = "be positive at 4 times t > 0 or more, and 0 before and after them only"
        refuse("values", required, data.tolist()[:6])
    curve = CubicSpline(np.log(times), np.log(data), bc_type="natural")
    ends = np.log(times[[0, -1]])
    slopes = curve(ends, 1)

    def curve_through_table(t: np.ndarray) -> np.ndarray:
        logs = np.log(np.maximum(t, _MIN_FIT_TIME))
        inside = np.clip(logs, *ends)
        return np.exp(curve(inside) + slopes[(inside < logs).astype(int)] * (logs - inside))

    kernel = Kernel(curve_through_table, max(0.0, -float(slopes[0])), True)
    kernel._knots = times
    return kernel


class TabulatedKernel(Kernel):
    """A memory kernel from measured values, with or without noise.

    Parameters
    ----------
    t : array_like, shape (n,)
        Increasing times, t > 0, n >= 4 [time].
    values : array_like, shape (n,)
        K there, positive [unit of the kernel].

    Notes
    -----
    Values between the data follow a power law from point to point. Before the first point they
    follow the power law of the first e-fold of time, or are constant if that rises. The fit is
    smooth, because its weights are positive. Its `tol` is the noise level, the largest root mean
    square of the relative misfit at the data; `max_error` is the largest misfit.

    Examples
    --------
    >>> import numpy as np
    >>> from hereditary import Kernel
    >>> t = np.geomspace(1e-2, 1e2, 60)
    >>> noise = 0.01 * np.sin(37.0 * np.arange(60.0))
    >>> fit = Kernel.from_table(t, np.exp(-t**0.5) * (1 + noise)).fit(1e-2, 1e2, 0.01)
    >>> bool(abs(fit(1.0) * np.e - 1) < 0.01), bool((fit.weights > 0).all())
    (True, True)
    """

    def __init__(self, t: ArrayLike, values: ArrayLike) -> None:
        times, kernel = _columns(t, values)
        if times[0] <= 0:
            remedy = "leave that row out, or pass signed=True if K rises from 0"
            refuse("t", "be positive", f"{times[0]:g} first", remedy)
        if np.any(kernel <= 0):
            i = int(np.argmax(kernel <= 0))
            got = f"{kernel[i]:g} at t = {times[i]:g}"
            remedy = "end the table before noise dominates, or pass signed=True if K rises from 0"
            refuse("values", "be positive", got, remedy)
        self._t = self._knots = times
        self._values, logs = kernel, (np.log(times), np.log(kernel))
        early = max(2, int(np.count_nonzero(times <= math.e * times[0])))
        slope = np.polyfit(logs[0][:early], logs[1][:early], 1)[0]
        if slope <= -1:
            refuse("values", "be integrable at 0 (K ~ t**-a with a < 1)", f"a = {-slope:.4g}")
        self._exponent, self._logs = -slope if slope < -0.05 else 0.0, logs

    def __repr__(self) -> str:
        times, exponent = self._t, self.singular_exponent
        span = f"{times.size} values, t = {times[0]:g} .. {times[-1]:g}"
        return f"TabulatedKernel({span}, singular_exponent={exponent:.6g})"

    @property
    def t_last(self) -> float:
        """The last time of the table."""
        return float(self._t[-1])

    def __call__(self, t: ArrayLike) -> np.ndarray:
        """Return the kernel values, the shape of `t`; up to the last time of the table."""
        t = np.asarray(t, dtype=float)
        if np.any(t > self._t[-1] * (1 + 1e-12)):
            refuse("t", f"not exceed the table's last time, {self._t[-1]:g}", f"{np.max(t):g}")
        early = np.minimum(t, self._t[0]) / self._t[0]
        power = early**-self._exponent
        return power * np.exp(np.interp(np.log(np.maximum(t, self._t[0])), *self._logs))

    def fit(self, t_min: float, t_max: float, tol: float) -> ExponentialSum:
        """Fit a smooth kernel to the data; `tol` bounds the rms of relative misfits."""
        t_min, t_max, tol = fit_interval(t_min, t_max, tol)
        first, last = self._t[0], self._t[-1]
        if t_min < first * (1 - 1e-12) or t_max > last * (1 + 1e-12):
            required = f"lie within the table, [{first:g}, {last:g}]"
            refuse("t_min and t_max", required, f"{t_min:g} and {t_max:g}")
        inside = (self._t >= t_min * (1 - 1e-12)) & (self._t <= t_max * (1 + 1e-12))
        if np.count_nonzero(inside) < 4:
            got = f"{np.count_nonzero(inside)} between {t_min:g} and {t_max:g}"
            refuse("the table", "have at least 4 times", got)
        times, values = self._t[inside], self._values[inside]
        fit = ExponentialSum(*closest_table(times, values, t_min, t_max, tol, True))
        rms = root_mean_square(fit(times) / values - 1)
        if rms > tol * (1 + 1e-9):
            remedy = "allow for the noise; only completely monotone data can be fitted closely"
            required = f"be at least {1.01 * rms:.2g}, the rms misfit of the best positive sum"
            refuse("tol", required, tol, remedy)
        return fit

    def _closest(self, t_min: float, t_max: float, tol: float, fading: bool) -> ExponentialSum:
        """Fit all data from about `t_min` on, and the power law before, perhaps not to `tol`."""
        # the error is checked at the data alone, because the values between them are unknown
        first = max(0, min(int(np.searchsorted(self._t, t_min)) - 1, self._t.size - 4))
        times = self._t[first:]
        if t_min < times[0]:
            n_early = math.ceil(_PER_E_FOLD * math.log(times[0] / t_min))
            times = np.append(np.geomspace(t_min, times[0], n_early + 2)[:-1], times)
        return ExponentialSum(*closest_table(times, self(times), t_min, t_max, tol, False, fading))
