"""Resonance curves by harmonic balance, compared with settled runs in time.

One is a hardening Duffing oscillator with memory (orders 1.98 and 0.9), whose curve bends over. The
other is a forced van der Pol oscillator (orders 1.9 and 0.9) inside its band of synchronisation. At
20 points of each, the unstable branch left out, the equation is marched by `Collocation` from the
response's own values for 400 periods. The first harmonic of the last four is compared. Claims:

* amplitudes agree to 1e-5 of the largest (Duffing) and to 1e-4 (van der Pol);
* the linear transfer function is met to 1e-12;
* 100 frequencies of the Duffing oscillator take less than 0.6 s.
"""

from functools import partial

import matplotlib.pyplot as plt
import numpy as np
from _study import Claim, fastest, study

import hereditary as hd


def duffing(t, x, p):
    return p[1] * np.cos(p[0] * t) - x - p[2] * x**3


def van_der_pol(t, x, dx, p):
    dx[0] = x[1]
    dx[1] = p[1] * np.cos(p[0] * t) + p[2] * (1 - x[0] ** 2) * x[1] - x[0]


TERMS = hd.Caputo(1.98) + 0.05 * hd.Caputo(0.9)
# equation, frequencies, harmonics
CASES = {
    "Duffing": (
        hd.Equation(TERMS, duffing, [0.0, 0.0], params=[1.0, 0.3, 0.5]),
        np.linspace(0.4, 2.4, 100),
        11,
    ),
    "van der Pol": (
        hd.Equation(hd.Caputo([0.95, 0.95]), van_der_pol, [0.0, 0.0], params=[1.0, 2.0, 0.5]),
        np.linspace(0.8, 1.3, 40),
        15,
    ),
}


def marched(equation, omega, coefficients, periods):
    """Return the first harmonic of a march from a response's own values."""
    orders = np.arange(coefficients.shape[1])
    start = coefficients.sum(axis=1).real
    if equation.m == 2:
        slope = (1j * orders * omega * coefficients).sum(axis=1).real
        start = np.vstack([start, slope])
    period = 2 * np.pi / omega
    times = np.linspace((periods - 4) * period, periods * period, 257)
    params = equation.params.copy()
    params[0] = omega
    march = equation.replace(params=params, y0=start)
    y = hd.solve(march, times[-1], rtol=1e-8, t_eval=times).y[:-1]
    return 2 * np.mean(y * np.exp(-1j * omega * times[:-1, None]), axis=0)


def measure(quick):
    figure, axes = plt.subplots(2, 1, figsize=(6.5, 6.5), layout="constrained")
    for ax, (name, (equation, omegas, harmonics)) in zip(axes, CASES.items(), strict=True):
        hd.frequency_response(equation, omegas[:3])
        call = partial(hd.frequency_response, equation, omegas)
        seconds, found = fastest(call, times=1, warm=False)
        fine = hd.frequency_response(equation, omegas, harmonics=harmonics)
        stable = np.flatnonzero(fine.branch % 2 == 0)
        chosen = stable[:: max(1, stable.size // (2 if quick else 20))]
        settled = np.array(
            [
                marched(equation, fine.omega[k], fine.coefficients[k], 20 if quick else 400)
                for k in chosen
            ]
        )
        first = fine.coefficients[chosen, :, 1]
        error = np.abs(np.abs(settled) - np.abs(first)).max() / np.abs(first).max()
        yield {
            "case": name,
            "responses": found.omega.size,
            "turning points": found.turning.size,
            "seconds": f"{seconds:.3g}",
            "compared": chosen.size,
            "largest error": f"{error:.2e}",
        }
        hd.plots.frequency_response(fine, ax=ax)
        ax.plot(fine.omega[chosen], np.abs(settled[:, 0]), "x", color="C3")
        ax.set(title=f"{name}: lines by harmonic balance, crosses by marches")
    yield figure
    linear = CASES["Duffing"][0].replace(params=[1.0, 0.3, 0.0])
    response = hd.frequency_response(linear, CASES["Duffing"][1])
    s = 1j * response.omega
    off = np.abs(response.coefficients[:, 0, 1] - 0.3 / (s**1.98 + 0.05 * s**0.9 + 1)).max()
    yield Claim("distance from the linear transfer function", off, 1e-12)


def claims(rows):
    for row, limit in zip(rows, (1e-5, 1e-4), strict=True):
        yield Claim(f"{row['case']}: marches differ by", row["largest error"], limit)
    yield Claim("100 frequencies of the Duffing oscillator [s]", rows[0]["seconds"], 0.6)


if __name__ == "__main__":
    study(measure, claims)
