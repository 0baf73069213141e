"""Memory kernels that are known by their Laplace transforms."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import ArrayLike

from ..support.checks import refuse
from .by_values import Kernel

# The hyperbola zeta = 1 + sin(i theta - 0.8), s = scale zeta / t, has nodes at theta = (k + 1/2)
# _HYPERBOLA_STEP. Its three errors (towards the cut, to the right, truncation) are below 1e-15 for
# every scale from 6 to 12.4. Rounding grows by exp(scale (1 - sin 0.8)) <= 33.
_HYPERBOLA_STEP = 0.055
# Number of nodes of the hyperbola.
_HYPERBOLA_NODES = 54
_THETA = 1j * (np.arange(_HYPERBOLA_NODES) + 0.5) * _HYPERBOLA_STEP - 0.8
# Nodes zeta of the hyperbola.
ZETA = 1 + np.sin(_THETA)
# Weights of the nodes ZETA in the inverse transform.
WEIGHTS = _HYPERBOLA_STEP / np.pi * np.cos(_THETA)
# Scale of the hyperbola from which values are computed.
_SCALE = 6.0
# Scale of the second hyperbola, which checks the values of the first.
_OTHER = 8.6
# Largest difference of the values by both hyperbolas, relative to the mean of the kernel. Analytic
# transforms leave 1e-13, a transform with a pole between the hyperbolas about 1.
_MAX_INVERSION_DIFFERENCE = 1e-9
# Most values of one call that are checked by the second hyperbola: to check all values doubles the
# time. A pole off the axis shows at times over a factor of 1.4, the ratio of the scales.
_MAX_VALUES_CHECKED = 400
# Relative changes of s at which the sensitivity of a transform to rounding is measured.
_RELATIVE_CHANGES_OF_S = (1e-15, 4e-15)
# Largest relative change of values by rounding of s. Kernels whose transforms cancel at infinity
# change by more before some time, and are continued by a power from there. ln((s + 10)/(s + 1/2))
# has 1e-7 at t = 1e-8, sums of powers have 1e-14 at all times.
_MAX_CHANGE_BY_ROUNDING = 1e-7
# Two inversions may differ by this multiple of the change by rounding.
_DIFFERENCE_PER_ROUNDING = 1e3
# Times at which the change by rounding is measured.
_TIMES_OF_ROUNDING = 10.0 ** np.arange(-290, 291)
# Decimals to which the exponent of the power near 0 is computed.
_EXPONENT_DECIMALS = 4
# Values of completely monotone kernels between a power of two and the next one are a polynomial: it
# converges like 5.8**-n, for K is analytic and bounded to the right of each positive time.
BINADE_DEGREE = 20
_BINADE_POINTS = np.cos(np.pi * (np.arange(BINADE_DEGREE) + 0.5) / BINADE_DEGREE)
_OF_VALUES = np.linalg.inv(chebyshev.chebvander(_BINADE_POINTS, BINADE_DEGREE - 1)).T
# Most times that are inverted at once. Complex numbers for all nodes then take 17 MB.
_MAX_TIMES_AT_ONCE = 20_000


def inverted(transform: Callable, t: ArrayLike, scale: float = _SCALE) -> np.ndarray:
    """Invert a Laplace transform of complex s (n,) that is analytic off the negative real axis."""
    # t > 0; scale: size of the hyperbola, 6 to 12.4; errors are 1e-14 of the mean from 0 to t
    t = np.asarray(t, dtype=float)
    shape, times = np.exp(scale * ZETA) * WEIGHTS, t.reshape(-1, 1)
    batches = np.array_split(times, 1 + times.size // _MAX_TIMES_AT_ONCE)
    values = [transform(scale * ZETA / some) @ shape * scale / some[:, 0] for some in batches]
    return np.concatenate(values).real.reshape(t.shape)


def by_polynomials(
    function: Callable, t: np.ndarray, polynomials: dict[int, np.ndarray]
) -> np.ndarray:
    """Return a completely monotone function at t (n,) by polynomials between powers of two."""
    # `polynomials` holds those that are known, and gets the new ones
    fractions, exponents = np.frexp(t)  # in [1/2, 1)
    used, places = np.unique(exponents, return_inverse=True)
    new = [e for e in used.tolist() if e not in polynomials]
    if new:
        times = np.ldexp((_BINADE_POINTS + 3) / 4, np.reshape(new, (-1, 1)))
        values = function(times.ravel()).reshape(times.shape)
        polynomials |= dict(zip(new, values @ _OF_VALUES, strict=True))
    series = np.reshape([polynomials[e] for e in used.tolist()], (-1, BINADE_DEGREE))
    return chebyshev.chebval(4 * fractions - 3, series[places].T, tensor=False)


def _rung(t: float | np.ndarray) -> np.ndarray | np.intp:
    """Return the index of the last time of the ladder before each t."""
    return np.maximum(np.searchsorted(_TIMES_OF_ROUNDING, t, "right") - 1, 0)


class LaplaceKernel(Kernel):
    """A memory kernel that is known by its Laplace transform; see `kernel_from_laplace`."""

    def __init__(
        self, transform: Callable, singular_exponent: float | None = None, signed: bool = False
    ) -> None:
        self._function, self._signed = transform, signed
        self._polynomials: dict[int, np.ndarray] = {}
        self._first, self._largest, self._rounded = 0.0, *np.zeros((2, _TIMES_OF_ROUNDING.size))
        if callable(transform):
            self._leave_out_rounding()
        super().__init__(transform, singular_exponent, signed)

    def _leave_out_rounding(self) -> None:
        """Find the time below which rounding of F hides K, which is continued there by a power."""
        with np.errstate(all="ignore"):
            if self._rounding(_TIMES_OF_ROUNDING[:1])[0] < _MAX_CHANGE_BY_ROUNDING:
                return  # then it is at later times too
            values = inverted(self.laplace, _TIMES_OF_ROUNDING)
            sizes = np.nan_to_num(self._sizes(_TIMES_OF_ROUNDING, values))
            if self._signed:  # errors count relative to the largest |K| from each time on
                self._largest = np.maximum.accumulate(np.append(sizes[1:], 0.0)[::-1])[::-1]
            moved = self._rounding(_TIMES_OF_ROUNDING)
        exact = moved < _MAX_CHANGE_BY_ROUNDING
        self._rounded = np.maximum.accumulate(moved[::-1])[::-1]
        self._first = float(_TIMES_OF_ROUNDING[np.argmax(exact)]) if exact.any() else 0.0

    def _sizes(self, t: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Return the sizes that errors at times t are relative to."""
        sizes = np.abs(values) + np.abs(self.laplace(1 / t + 0j)) / t
        return np.maximum(sizes, self._largest[_rung(t)])

    def _rounding(self, t: np.ndarray) -> np.ndarray:
        """Return the change of values at times t, relative to their size, by rounding of s."""
        values = inverted(self.laplace, t)
        changes = _RELATIVE_CHANGES_OF_S
        moved = [inverted(lambda s, by=by: self.laplace(s * (1 + by)), t) for by in changes]
        difference = np.abs(np.array(moved) - values).max(axis=0)
        return np.nan_to_num(difference / self._sizes(t, values), nan=np.inf)

    def _slope_at_zero(self) -> float:
        """Return a of K ~ t**-a at the smallest times at which rounding does not hide K."""
        if self._first == 0.0:
            return super()._slope_at_zero()
        with np.errstate(all="ignore"):  # of kernels that are refused for their exponent
            early = np.abs(self._inverted(self._first * np.array([1.0, 2.0])))
            # the early values of a signed kernel may be rounding relative to its later values
            early = np.maximum(early, _MAX_CHANGE_BY_ROUNDING * self._largest[_rung(self._first)])
            slope = float(np.nan_to_num(np.log2(early[0] / early[1])))
        return max(0.0, round(slope, _EXPONENT_DECIMALS))

    def _at(self, t: np.ndarray) -> np.ndarray:
        """Return values at times of shape (n,), by polynomials unless K is signed."""
        later = np.maximum(t, self._first)
        if self._signed:
            values = self._inverted(later)
        else:
            values = by_polynomials(self._inverted, later, self._polynomials)
        return values if self._first == 0.0 else values * (later / t) ** self._exponent

    def _inverted(self, t: np.ndarray) -> np.ndarray:
        """Return values at times of shape (n,), and check some of them by a second inversion."""
        values = inverted(self.laplace, t)
        some = slice(None, None, 1 + t.size // _MAX_VALUES_CHECKED)
        times, checked = t[some], values[some]
        difference = np.abs(inverted(self.laplace, times, _OTHER) - checked)
        difference = np.nan_to_num(difference / self._sizes(times, checked))
        worst = int(np.argmax(difference)) if times.size else 0
        by_rounding = _DIFFERENCE_PER_ROUNDING * self._rounded[_rung(times)]
        if np.any(difference > _MAX_INVERSION_DIFFERENCE + by_rounding):
            required = "be analytic off the negative real axis"
            got = f"inversions that differ by {difference[worst]:.1e} at t = {times[worst]:g}"
            remedy = "a pole elsewhere is a pair of rates of hereditary.Prony"
            refuse("transform", required, got, remedy)
        return values

    def integral(self, t: ArrayLike) -> np.ndarray:
        """Return ``int_0^t K``, the inverse of ``F(s) / s``."""
        t = np.asarray(t, dtype=float)
        later = np.maximum(np.where(t > 0, t, 1.0), self._first)
        integrals = inverted(lambda s: self.laplace(s) / s, later)
        return np.where(
            t > 0, integrals * (np.minimum(t, later) / later) ** (1 - self._exponent), 0.0
        )

    def laplace(self, s: ArrayLike) -> np.ndarray:
        """Return the given transform at s."""
        s = np.asarray(s)
        values = np.asarray(self._function(s))
        if values.shape != s.shape or values.dtype.kind not in "iufc":
            required = "give one number for each s of an array"
            got = f"dtype {values.dtype}, shape {values.shape} for {s.shape}"
            refuse("transform", required, got, "write it with NumPy", kind=TypeError)
        return values


def kernel_from_laplace(
    transform: Callable, singular_exponent: float | None = None, signed: bool = False
) -> LaplaceKernel:
    """Make a memory kernel of its Laplace transform F(s).

    Runs and `fit_exponentials` represent the kernel by a sum of exponentials, as any other.

    Parameters
    ----------
    transform : callable
        F at complex s of any shape, written with NumPy. F is analytic off the negative real axis,
        real on the positive one, and tends to 0 at infinity.
    singular_exponent : float, optional
        The a of ``K ~ t**-a`` near 0, 0 <= a < 1 [-], where ``F ~ s**(a-1)`` at infinity. By
        default it is read off the values of K at tiny times.
    signed : bool, optional
        Whether K may grow or change its sign, as in `Kernel`. Without it K is completely monotone.

    Returns
    -------
    LaplaceKernel

    Raises
    ------
    TypeError, ValueError
        `transform` is no function, or its kernel is not integrable at 0. Or F has a singularity off
        the negative axis that two inversions show.

    Error
    -----
    Values and integrals have errors of about 1e-14 of the mean from 0 to t. Fits are checked
    against them, as those of `Kernel`. Write F without cancellation:
    ``-np.expm1(-c * np.log1p(x))`` for ``1 - (1 + x)**-c``. Where F cancels at large s, rounding
    grows towards t = 0. Below the time at which it is 1e-7 of K, a power law replaces K.

    Cost
    ----
    Signed: 54 values of F for each value of K, about 7 microseconds with one power in F. Others:
    54 values of F for each of 20 times between two powers of two, where K is a polynomial.

    Source
    ------
    Hyperbolas as contours: [WeidemanTrefethen2007].

    Examples
    --------
    Scarpi's derivative, whose order goes from 0.6 at the start to 0.9 at the rate 2
    [GarrappaGiustiMainardi2021]:

    >>> import hereditary as hd
    >>> def scarpi(s):
    ...     return s ** ((0.9 * 2 + 0.6 * s) / (2 + s) - 1)
    >>> operator = hd.Memory(hd.kernel_from_laplace(scarpi, signed=True), 1)
    >>> relaxing = hd.solve(hd.Equation(operator, lambda t, y: -y, 1.0), 1.0, rtol=1e-6)
    >>> round(float(relaxing.y[-1, 0]), 6)
    0.426186
    """
    return LaplaceKernel(transform, singular_exponent, signed)
