"""Memory kernels that are known by their Laplace transforms."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from ..support.checks import complaint
from .measured import Kernel

# The hyperbola zeta = 1 + sin(i theta - 0.8), s = scale zeta / t, nodes theta = (k + 1/2) step. Its
# three errors (towards the cut, to the right, truncation) are below 1e-15 for every scale from 6 to
# 12.4, rounding grows by exp(scale (1 - sin 0.8)) <= 33.
_STEP, _NODES = 0.055, 54
_THETA = 1j * (np.arange(_NODES) + 0.5) * _STEP - 0.8
ZETA, WEIGHTS = 1 + np.sin(_THETA), _STEP / np.pi * np.cos(_THETA)
# Scale of the values, scale of their check, and the largest difference of both over the mean of the
# kernel: analytic transforms leave 1e-13, and one with a pole between the hyperbolas about 1.
_SCALE, _OTHER, _DIFFERENCE = 6.0, 8.6, 1e-9
# Values of a call that are compared, at the most: to compare all doubles its time. A pole off the
# axis shows at times over a factor of 1.4, the ratio of the scales.
_CHECKED = 400
# Times that are inverted at once: complex numbers for all nodes take 17 MB.
_AT_ONCE = 20_000


def inverted(transform: Callable, t: ArrayLike, scale: float = _SCALE) -> np.ndarray:
    """Invert a Laplace transform that is analytic off the negative real axis.

    Parameters
    ----------
    transform : callable
        Of complex s, shape (n,).
    t : array_like
        Times t > 0 [time].
    scale : float
        Size of the hyperbola, from 6 to 12.4.

    Returns
    -------
    ndarray
        Values at `t`, with errors of about 1e-14 of the mean from 0 to t.
    """
    t = np.asarray(t, dtype=float)
    shape, times = np.exp(scale * ZETA) * WEIGHTS, t.reshape(-1, 1)
    parts = np.array_split(times, 1 + times.size // _AT_ONCE)
    values = [transform(scale * ZETA / part) @ shape * scale / part[:, 0] for part in parts]
    return np.concatenate(values).real.reshape(t.shape)


class LaplaceKernel(Kernel):
    """A memory kernel that is known by its Laplace transform; see `kernel_from_laplace`."""

    def _at(self, t):
        """Return values at times of shape (n,), some of them compared with a second inversion."""
        values, some = inverted(self.laplace, t), slice(None, None, 1 + t.size // _CHECKED)
        times, seen = t[some], values[some]
        size = np.abs(seen) + np.abs(self.laplace(1 / times + 0j)) / times
        difference = np.abs(inverted(self.laplace, times, _OTHER) - seen) / size
        worst = int(np.argmax(np.nan_to_num(difference)))
        if difference[worst] > _DIFFERENCE:
            required = "be analytic off the negative real axis"
            got = f"inversions that differ by {difference[worst]:.1e} at t = {times[worst]:g}"
            remedy = "a pole elsewhere is a pair of rates of hereditary.Prony"
            raise ValueError(complaint("transform", required, got, remedy))
        return values

    def integral(self, t: ArrayLike) -> np.ndarray:
        """Return ``int_0^t K``, the inverse of ``F(s) / s``."""
        t = np.asarray(t, dtype=float)
        found = inverted(lambda s: self.laplace(s) / s, np.where(t > 0, t, 1.0))
        return np.where(t > 0, found, 0.0)

    def laplace(self, s: ArrayLike) -> np.ndarray:
        """Return the transform as it was given."""
        s = np.asarray(s)
        values = np.asarray(self._function(s))
        if values.shape != s.shape or values.dtype.kind not in "iufc":
            required = "give one number for each s of an array"
            got = f"dtype {values.dtype}, shape {values.shape} for {s.shape}"
            raise TypeError(complaint("transform", required, got, "write it with NumPy"))
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
    ``-np.expm1(-c * np.log1p(x))`` for ``1 - (1 + x)**-c``.

    Cost
    ----
    54 values of F for each value of K: about 7 microseconds with one power in F.

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
