"""Power spectra of solutions and series, with a table of their peaks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..solver.solution import Solution
from ..support.checks import count, positive, real, real_array, refuse
from .sections import check_component, check_unbroken, values_at

# Most samples of a solution.
_MAX_SPECTRUM_SAMPLES = 2**18
# Fewest values of a series.
_MIN_SPECTRUM_SAMPLES = 16
# Least ratio of the power of a peak to that of the frequencies next to it.
_PROMINENT = 4.0
# Least ratio of the power of a peak to that of the highest peak.
_MIN_PEAK_POWER = 1e-8


@dataclass(frozen=True, eq=False)
class PowerSpectrum:
    """Power against angular frequency, and its peaks.

    Attributes
    ----------
    omega : ndarray, shape (n,)
        Angular frequencies [1/time].
    power : ndarray, shape (n,)
        Power spectral density, in units of the series squared times time. Its integral over omega /
        (2 pi) is about the variance if the series is long.
    peaks : ndarray, shape (k,)
        Records with fields omega and amplitude, the highest peak first: a line ``a cos(omega t)``
        has amplitude a.
    resolution : float
        Distance in omega below which two lines are one.
    """

    omega: np.ndarray
    power: np.ndarray
    peaks: np.ndarray
    resolution: float

    def __repr__(self) -> str:
        highest = f"highest at {self.peaks['omega'][0]:.6g}; " if self.peaks.size else ""
        counts = f"peaks: {self.peaks.size}, {highest}resolution {self.resolution:.3g}"
        return f"PowerSpectrum({counts}; {self.omega.size} frequencies)"


def power_spectrum(
    series: Solution | ArrayLike,
    step: float | None = None,
    *,
    component: int = 0,
    transient: float | None = None,
    n_peaks: int = 10,
) -> PowerSpectrum:
    """Compute the power spectrum of a component, through Hann's window.

    Parameters
    ----------
    series : Solution or array_like, shape (n,)
        A solution with dense output, or with rows at equal times that resolve the motion; or values
        at equal distances.
    step : float, optional
        Distance of the values of a series [time].
    component : int, optional
        Component of a solution.
    transient : float, optional
        Time of the first value that is used; for a series from its first value on [time].
    n_peaks : int, optional
        Most peaks in the table.

    Returns
    -------
    PowerSpectrum

    Error
    -----
    The resolution is 4 pi over the time. For lines further apart than this, two neighbouring values
    give frequency and amplitude, by the shape of a single line through Hann's window. The window
    leaves 1e-3 of a line at a distance of three resolutions and 1e-5 at ten. With memory, the
    approach to a motion that settles like t**-a appears at low frequencies. Leave out a transient,
    and do not take what remains there for chaos.

    Examples
    --------
    >>> import numpy as np
    >>> import hereditary as hd
    >>> t = 0.05 * np.arange(4096)
    >>> found = hd.power_spectrum(np.cos(2.0 * t) + 0.1 * np.cos(5.0 * t), 0.05)
    >>> found.peaks["omega"].round(2).tolist(), found.peaks["amplitude"].round(2).tolist()
    ([2.0, 5.0], [1.0, 0.1])
    """
    values, h = _sampled(series, step, component, transient)
    from scipy.signal import periodogram

    frequencies, density = periodogram(values, 1 / h, window="hann")
    omega, amplitudes = 2 * np.pi * frequencies, np.sqrt(3 * density * frequencies[1])
    peaks = _peaks(omega, amplitudes, count("n_peaks", n_peaks))
    return PowerSpectrum(omega, density, peaks, 2 * float(omega[1]))


def _sampled(
    series: Solution | ArrayLike, step: float | None, component: int, transient: float | None
) -> tuple[np.ndarray, float]:
    """Return values at equal distances, and the distance."""
    if transient is not None:
        transient = real("transient", transient)
    if not isinstance(series, Solution):
        values = real_array("series", series)
        h = positive("step", step, "the distance of the values") if step is not None else None
        if values.ndim != 1 or h is None:
            required = "be of shape (n,) and come with their distance, step"
            refuse("series", required, f"shape {values.shape}, step {step}")
        first = max(0, int(np.ceil((transient or 0.0) / h - 1e-9)))
        return _long(values[first:]), h
    check_unbroken(series)
    check_component(component, series)
    begin = series.t[0] if transient is None else max(transient, series.t[0])
    inside = series.t >= begin
    _long(series.t[inside])
    gaps = np.diff(series.t[inside])
    if not series.coarse and gaps[:-1].size and np.ptp(gaps[:-1]) > 0.01 * gaps.max():
        required = "have dense output, or rows at equal times"
        refuse("series", required, f"gaps {gaps.min():g} to {gaps.max():g}")
    rows = 4 * inside.sum() if series.coarse else inside.sum()
    n = int(min(_MAX_SPECTRUM_SAMPLES, 2 ** np.ceil(np.log2(rows))))
    times = np.linspace(begin, series.t[-1], n)
    return values_at(series, times)[:, component], (series.t[-1] - begin) / (n - 1)


def _long(values: np.ndarray) -> np.ndarray:
    """Return values, refusing too few of them."""
    if values.size < _MIN_SPECTRUM_SAMPLES:
        required = f"leave {_MIN_SPECTRUM_SAMPLES} values at least behind the transient"
        refuse("series", required, values.size)
    return values


def _peaks(omega: np.ndarray, amplitudes: np.ndarray, most: int) -> np.ndarray:
    """Return the highest peaks as records of omega and amplitude."""
    # a frequency between two bins follows from the ratio of heights, exactly for Hann's window
    from scipy.signal import find_peaks

    logs = np.log(np.maximum(amplitudes, 1e-300))
    tops, _ = find_peaks(logs, prominence=np.log(_PROMINENT))
    tops = tops[amplitudes[tops] > _MIN_PEAK_POWER * amplitudes.max()]
    tops = tops[np.argsort(-amplitudes[tops])][:most]
    before, here, after = (amplitudes[tops + k] for k in (-1, 0, 1))
    ratio = np.maximum(before, after) / here
    off = np.clip((2 * ratio - 1) / (ratio + 1), 0.0, 0.5)
    peaks = np.zeros(tops.size, [("omega", "f8"), ("amplitude", "f8")])
    peaks["omega"] = omega[tops] + np.where(after > before, off, -off) * omega[1]
    peaks["amplitude"] = here * (1 - off**2) / np.sinc(off)
    return peaks
