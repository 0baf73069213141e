"""Kernels by their Laplace transforms reach the tolerance of a run, down to 1e-10.

D y = -y is solved with four transforms. They are of Caputo's derivative, of Cole and Cole's and of
Havriliak and Negami's relaxation, and of Scarpi's derivative of variable order. All runs end at t =
1; runs with Scarpi's derivative also go to t = 100. The rows have the relative error of y at the
end, the number of rates and the error of the kernel's sum. They also have the time of a run that
fits the kernel anew. The exact values invert the transform of y in 40 digits.
"""

from functools import partial

import mpmath
import numpy as np
from _study import Claim, curves, fastest, study

import hereditary as hd


def caputo(s):
    return s**-0.3


def cole_cole(s):
    return 1 / (s + s**0.4)


def havriliak_negami(s):
    return (1 + s**0.8) ** -0.5


def scarpi(s):
    return s ** ((0.9 * 2 + 0.6 * s) / (2 + s) - 1)


KERNELS = {
    "Caputo 0.7": (caputo, False, 1.0),
    "Cole-Cole 0.6": (cole_cole, False, 1.0),
    "Havriliak-Negami 0.8, 0.5": (havriliak_negami, False, 1.0),
    "Scarpi 0.6 to 0.9": (scarpi, True, 1.0),
    "Scarpi, later": (scarpi, True, 100.0),
}


def truth(transform, end):
    """Return y(end) of ``K * y' = -y``, y(0) = 1; a bounded kernel lets y jump at 0."""
    with mpmath.workdps(40):
        found = mpmath.invertlaplace(
            lambda s: transform(s) / (s * transform(s) + 1), end, method="talbot", degree=80
        )
        return float(found)


def relaxed(transform, signed, end, rtol):
    kernel = hd.kernel_from_laplace(transform, signed=signed)
    return hd.solve(hd.Equation(hd.Memory(kernel, 1), decay, 1.0), end, rtol=rtol)


def measure(quick):
    rows = []
    for name, kernel in KERNELS.items():
        known = truth(kernel[0], kernel[2])
        for rtol in (1e-4, 1e-7) if quick else 10.0 ** -np.arange(3.0, 11.0):
            seconds, sol = fastest(partial(relaxed, *kernel, rtol), 3)
            rows.append(
                {
                    "kernel": name,
                    "rtol": f"{rtol:.0e}",
                    "error": f"{abs(sol.y[-1, 0] / known - 1):.2e}",
                    "kernel_error": f"{sol.stats['kernel_error']:.1e}",
                    "modes": sol.stats["n_modes"],
                    "steps": sol.stats["n_steps"],
                    "seconds": f"{seconds:.3f}",
                }
            )
    return rows


def decay(t, y):
    return -y


def claims(rows):
    for row in rows:
        where = {"where": f"{row['kernel']}, {row['rtol']:g}", "small": True}
        yield Claim("error at the end over rtol", row["error"] / row["rtol"], 1, **where)
        yield Claim("error of the sum over rtol", row["kernel_error"] / row["rtol"], 1, **where)
    yield Claim("rates of a sum at the most", max(row["modes"] for row in rows))
    yield Claim("seconds of a run with its fit at the most", max(row["seconds"] for row in rows))


if __name__ == "__main__":
    study(measure, claims, curves("seconds", "error", ("kernel",)))
