"""Memory operators applied to data or to a function that is known."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
import scipy.fft
from numpy.polynomial import chebyshev
from numpy.typing import ArrayLike
from scipy.special import rgamma

from .equation.operators import Summand
from .equation.statement import as_terms, factors_of
from .equation.system import System
from .equation.terms import SystemTerm, derivative_of_one
from .given.schemes.l1 import L1
from .given.schemes.l2 import L2
from .given.schemes.l12 import L12
from .kernels.named_kernels import PowerLaw
from .kernels.special import graded_unit
from .kernels.step_kernel import Integrated
from .solver.elsewhere import lacking
from .stepping.scheme import Scheme
from .support.checks import instance, real, real_array, refuse, shown

# Times are equidistant if they differ from equidistant ones by less than this fraction of the step.
_EQUIDISTANT_TOL = 1e-9
# Most numbers in an array of weights: 16 MB. Ten times as many are slower, because they leave the
# cache.
_BLOCK = 2_000_000
# Degrees of Chebyshev polynomials, tried in turn.
_DEGREES = (16, 32, 64, 128, 256, 512)
# A polynomial resolves a function if its last coefficients, over the largest of all, are below
# this: 30 roundings, since coefficients have rounding errors.
_RESOLVED_RTOL = 30 * np.finfo(float).eps
# Least number of derivatives by u of t**order, which choose the power q of t = u**q.
_MIN_DERIVATIVES = 6.0
# Fraction of t next to the singularity in which kernels are integrated exactly.
_NEAREST = 2.0**-50


@lacking("it solves no equation, as solve(...) does")
def derivative(
    t: ArrayLike,
    y: ArrayLike | Callable,
    operator: Summand | Iterable[Summand],
    scheme: Scheme | None = None,
    *,
    t_start: float = 0.0,
) -> np.ndarray:
    r"""Apply a fractional derivative, or any memory operator, to data or to a function.

    The operator sends y to :math:`\int_{t_0}^t K(t-s)\, y^{(m)}(s)\, ds`.

    Parameters
    ----------
    t : array_like, shape (n,)
        Times [time]. For data they increase, and memory begins at the first one.
    y : array_like, shape (n,) or (n, d), or callable
        Values at `t`; or ``y(times)`` of an array (k,), which returns shape (k,) or (k, d).
    operator : Caputo, RiemannLiouville, Memory, Term, a sum or a sequence of them
        Constant orders alone; coefficients and orders are numbers or one for each component. The
        fractional integral of order a < 1 is
        ``Memory(PowerLaw(1 - a) / scipy.special.gamma(a), 0)``.
    scheme : Scheme, optional
        For data: `L1` (default), `L12` or `L2`. `L12` and `L2` need Caputo kernels, and `L12` even
        times.
    t_start : float, optional
        For a function: the time at which memory begins; no time in `t` is earlier [time].

    Returns
    -------
    ndarray, shape (n,) or (n, d)
        Values at `t`, in units of y times the kernel's integral over time**m. At the start a
        Riemann-Liouville derivative of y(0) != 0 is infinite.

    Raises
    ------
    TypeError, ValueError
        An argument is not as required; or the function is not smooth, see Error.

    Error
    -----
    Data, orders up to 1, steps h: ``O(h**(2 - alpha))`` with `L1` and ``O(h**(3 - alpha))`` with
    `L12` and `L2` for smooth y. It is O(h) at a fixed time for y like t**alpha on even times.
    ``Memory(kernel, m)``, m = 0 or 1: ``O(h**(2-a))`` for kernels like t**-a near 0. Above order 1
    the operator, one order lower, acts on second-order differences of y (``numpy.gradient``): alpha
    in (1, 2) has ``O(h**(3 - alpha))`` with any scheme.

    *Noise*: independent errors of size sigma in y leave errors of size ``c sigma h**-alpha``. At
    orders up to 1 c is from 1 to 1.5 with `L1` and up to 2.4 with others. The size grows as steps
    get shorter. No scheme smooths data: smooth them before.

    Functions: 1e-11 of the largest value if y is a smooth function of t or, up to
    order 1, of t and t**alpha. Chebyshev polynomials of degree 512 at most interpolate y. A
    function that they do not resolve is refused, such as t**alpha below alpha = 0.01. Above order 1
    rounding grows to 1e-10 of it, and above order 3 to 1e-9.

    Cost
    ----
    Even times: O(n log n) by FFT, 0.6 s for 10^6 values. Other times: O(n^2), with O(n) storage;
    ``Memory(kernel, 0)`` then integrates its kernel 800 n^2 times, which is slow beyond n = 100.
    A function: about 1,000 kernel values for each time.

    Source
    ------
    Weights as in `L1`, `L12` and `L2`.

    Examples
    --------
    The derivative of order 1/2 of t^2 at t = 1 is 2 / Gamma(2.5) = 1.504506:

    >>> import numpy as np
    >>> import hereditary as hd
    >>> t = np.linspace(0.0, 1.0, 1001)
    >>> by_lines = hd.derivative(t, t**2, hd.Caputo(0.5))
    >>> by_parabolas = hd.derivative(t, t**2, hd.Caputo(0.5), hd.L12())
    >>> round(float(by_lines[-1]), 6), round(float(by_parabolas[-1]), 6)
    (1.504491, 1.504506)
    >>> round(float(hd.derivative([1.0], lambda s: s**2, hd.Caputo(0.5))[0]), 12)
    1.504505556127
    """
    times, terms = real_array("t", t), as_terms(operator)
    if times.ndim != 1 or times.size == 0:
        refuse("t", "have shape (n,)", f"shape {times.shape}")
    if any(getattr(term.operator, "varying", None) for term in terms):
        refuse("operator", "have constant orders", repr(operator))
    start = real("t_start", t_start)
    if callable(y):
        if scheme is not None:
            refuse("scheme", "be left out for a function", repr(scheme), kind=TypeError)
        times = times - start
        if times.min() < 0:
            refuse("t", "not lie before t_start", shown(times))
        known: Any = _Function(y, times, start)
    else:
        if start not in (0.0, times[0]):
            required = f"be left out for data, whose memory begins at t[0] = {times[0]:g}"
            refuse("t_start", required, start)
        known = _Data(times, real_array("y", y), L1() if scheme is None else scheme)
    return known.applied(terms)


class _Known:
    """Known values of y: times (n,) since the start, values at them, (n, d), and y(0) (d,)."""

    times: np.ndarray
    y0: np.ndarray
    flat: bool

    def one(self, operator: Any, columns: Any) -> Any:
        """Return the value of one operator on the components `columns`, (n, k)."""
        raise NotImplementedError

    def applied(self, terms: Any) -> np.ndarray:
        """Return the sum of these terms of y at all times."""
        d, total = self.y0.size, np.zeros((self.times.size, self.y0.size))
        factors = factors_of(terms, d, False)
        for term, factor in zip(terms, factors, strict=True):
            own = getattr(term.operator, "_order", np.zeros(()))
            if own.ndim and own.size != d:
                required = f"have one order, or one for each of {d} components"
                refuse("operator", required, repr(term.operator))
            part = np.zeros((self.times.size, d))
            for operator, held in term.operator.parts(np.broadcast_to(own, d)):
                if self.times.max() > operator.t_last * (1 + 1e-12):
                    required = f"stay within {operator.t_last:g} of the start, as the kernel does"
                    refuse("t", required, f"{self.times.max():g}")
                columns = np.broadcast_to(held, d)
                part[:, columns] = self.one(operator, columns) + self._at_start(operator, columns)
            total = total + (part * factor if factor.ndim < 2 else part @ factor.T)
        return total[:, 0] if self.flat else total

    def _at_start(self, operator: Any, columns: Any) -> Any:
        """Return what y(0) adds to the derivative of y - y(0), (n, k); it may be infinite at 0."""
        if operator.definition.subtracts_start or not operator.derivative:
            return 0.0
        factor, exponent = derivative_of_one(operator.order)
        with np.errstate(divide="ignore"):
            weights = factor * self.times**exponent
        y0 = self.y0[columns]
        return np.where(y0 == 0, 0.0, np.multiply.outer(weights, np.where(y0 == 0, 1.0, y0)))


class _Data(_Known):
    """Values at increasing times."""

    def __init__(self, times: np.ndarray, values: np.ndarray, scheme: Any) -> None:
        self._scheme = instance("scheme", scheme, Scheme, "hereditary.L1()")
        if not isinstance(scheme, (L1, L12, L2)):
            refuse("scheme", "be L1, L12 or L2", repr(scheme))
        if times.size < 3 or np.any(np.diff(times) <= 0):
            refuse("t", "hold at least three times, which increase", shown(times))
        if values.ndim not in (1, 2) or len(values) != times.size:
            refuse("y", f"have shape ({times.size},) or ({times.size}, d)", f"shape {values.shape}")
        self.times, self.flat = times - times[0], values.ndim == 1
        self._values = values.reshape(times.size, -1)
        self.y0, self._h = self._values[0], self.times[-1] / (times.size - 1)
        even = self._h * np.arange(times.size)
        self._even = bool(np.abs(self.times - even).max() < _EQUIDISTANT_TOL * self._h)

    def one(self, operator: Any, columns: Any) -> Any:
        """Return the value of one operator at all times, from increments."""
        values = self._values[:, columns]
        if operator.derivative > 1:
            for _ in range(operator.derivative - 1):
                values = np.gradient(values, self.times, axis=0, edge_order=2)
            operator = operator.lower(operator.derivative - 1)
        system = System([SystemTerm(operator, np.ones(1))], np.zeros((1, 1)))
        self._scheme.check_terms(system)
        found = np.zeros_like(values)
        by = self._by_fft if self._even else self._by_rows if operator.kernel else self._by_blocks
        found[1:] = by(system, operator, np.diff(values, axis=0))
        if operator.derivative == 0:  # what increments do not show
            found += np.multiply.outer(operator.kernel.integral(self.times), values[0])
        return found

    def _by_fft(self, system: System, _: Any, u: np.ndarray) -> np.ndarray:
        """Sum at equidistant times by one product of transforms."""
        plan, n = self._scheme.plan(system, self._h), len(u)
        weights, starts = plan.past.exact(n)
        size = scipy.fft.next_fast_len(2 * n, real=True)
        both = scipy.fft.rfft(weights[0], size)[:, None] * scipy.fft.rfft(u, size, axis=0)
        sums = scipy.fft.irfft(both, size, axis=0)[:n] + np.outer(starts[0], u[0])
        sums[0] = plan.rows.scale[0, 0] * u[0]
        return sums / plan.rows.lead[0, 0]

    def _by_blocks(self, system: System, _: Any, u: np.ndarray) -> np.ndarray:
        """Sum at any times, with Caputo's kernel."""
        past, n = self._scheme.mesh_plan(system, self.times).past, len(u)
        found, size, last = np.empty_like(u), max(1, _BLOCK // n), 0
        past.prepare(n)
        while last < n:
            first, last = last, min(last + size, past.reach(last)[0])
            earlier = np.maximum(np.arange(first, last)[:, None] - np.arange(last), 0)
            weights = past.weights(first, last, last)[0]
            found[first:last] = np.einsum("ik,ikc->ic", weights, u[earlier])
        return found

    def _by_rows(self, system: System, operator: Any, u: np.ndarray) -> np.ndarray:
        """Sum at any times, with the integrals of a general kernel."""
        kernel = operator.kernel if operator.derivative else Integrated(operator.kernel)
        slopes, found = u / np.diff(self.times)[:, None], np.empty_like(u)
        for n in range(len(u)):
            integrals = kernel.integral(self.times[n + 1] - self.times[: n + 2])
            found[n] = -np.diff(integrals) @ slopes[: n + 1]
        return found


class _Function(_Known):
    """A function of time as polynomials in u, with t = T u**q."""

    def __init__(self, function: Any, times: np.ndarray, t_start: float) -> None:
        self._function, self._start, self.times = function, t_start, times
        self._end = float(times.max()) or 1.0
        first = np.asarray(function(np.array([t_start])))
        if first.ndim not in (1, 2) or len(first) != 1:
            refuse("y", "return shape (k,) or (k, d)", f"shape {first.shape}")
        self.y0, self.flat = first.reshape(-1).astype(float), first.ndim == 1

    def one(self, operator: Any, columns: Any) -> Any:
        """Return the value of one operator at all times."""
        m, kernel, total = operator.derivative, operator.kernel, self._end
        whole = kernel is None and operator.order == m
        order = operator.order if kernel is None else kernel.singular_exponent
        q, series = self._series(1 if m > 1 else math.ceil(_MIN_DERIVATIVES / max(order, 0.1)))
        series = series[:, columns]
        if m:
            series = chebyshev.chebder(series, m, 2.0) / total ** (m - 1)
        if kernel is None and not whole:
            kernel = rgamma(m - operator.order) * PowerLaw(operator.order - m + 1)

        def density(u: Any) -> Any:  # of the integral over u
            values = np.moveaxis(chebyshev.chebval(2 * u - 1, series), 0, -1)
            return values if m else values * (total * q * u ** (q - 1))[..., None]

        if whole and q == 1:
            return density(self.times / total) / total
        x, weights = graded_unit(16 + len(series) // 2)
        x, weights = x[x > _NEAREST], weights[x > _NEAREST]
        found = np.zeros((self.times.size, series.shape[1]))
        after = np.flatnonzero(self.times > 0)
        for some in np.array_split(after, 1 + after.size * x.size // _BLOCK):
            t = self.times[some]
            u = (t / total) ** (1 / q)
            now = density(u) / (total * q * u ** (q - 1))[:, None]
            if kernel is None:
                found[some] = now
                continue
            gaps = np.multiply.outer(t, -np.expm1(q * np.log1p(-x)))
            each = kernel(gaps) * weights * u[:, None]
            found[some] = np.einsum("tx,txc->tc", each, density(np.multiply.outer(u, 1 - x)))
            nearest = kernel.integral(t * -math.expm1(q * math.log1p(-_NEAREST)))
            found[some] += nearest[:, None] * now
        return found

    def _series(self, q: Any) -> Any:
        """Return a power, 1 or q, and the Chebyshev series of y in u with t = T u**power."""

        def of_u(x: Any) -> Any:
            values = np.asarray(self._function(self._start + self._end * ((x + 1) / 2) ** power))
            return real_array("y", values).reshape(x.size, self.y0.size) - self.y0

        for power in dict.fromkeys((1, q)):
            for degree in _DEGREES:
                series = _interpolated(of_u, degree)
                size = np.abs(series).max(axis=0)
                if np.all(np.abs(series[-degree // 8 :]).max(axis=0) <= _RESOLVED_RTOL * size):
                    least = np.abs(series) > np.finfo(float).eps * size
                    kept = series[: 2 + np.flatnonzero(least.any(axis=1)).max(initial=0)]
                    kept[0] += self.y0  # constants leave no rounding in derivatives
                    return power, kept
        required = "be smooth in t, or up to order 1 in t and t**alpha"
        got, remedy = f"one that degree {degree} does not resolve", "hand in its values at times"
        refuse("y", required, got, remedy)


def _interpolated(function: Any, degree: int) -> Any:
    """Return the Chebyshev series that interpolates a function on [-1, 1], to rounding."""
    # NumPy's has rounding errors forty times as large, which grow by powers of the degree in y'
    n = degree + 1
    series = scipy.fft.dct(function(np.cos(np.pi * (np.arange(n) + 0.5) / n)), axis=0) / n
    series[0] /= 2
    return series
