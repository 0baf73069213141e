"""Random kernels given by their values: each is fitted to its tolerance, or refused rightly.

Two hundred completely monotone kernels are drawn, with T/h from 10 to 1e8. They are sums of one to
three products of one or two factors t^-a, exp(-r t), E_a(-(r t)^a) and exp(-(r t)^b). A fifth of
them are tables of three digits. The seed follows from the commit before this script. Errors are
measured against the closed form on 20,001 log-spaced times, relative to max(K, 1e-3 of the mean of
K from 0 to t). Those of a table are measured at its data. Claims:

* each fit ends within two seconds, with positive weights;
* a fit's error is within its tolerance, and at most 1.05 times the error that it reports;
* a refusal names an error that the closest sum has, and calls no kernel other than it is;
* each function is fitted, by at most 128 exponentials.
"""

import re
import signal
import time
from collections import Counter
from contextlib import contextmanager

import numpy as np
from _study import Claim, study

import hereditary as hd

SEED = 0x42EF1D6
COUNT, T = 200, 10.0
# A fit that takes longer than this counts as one without end [s].
LIMIT = 5
# A table of three digits errs by at most 5e-3, and by 1.7e-3 in the root mean square.
TABLE_TOL = 3e-3


def factor(rng, h, powers):
    """Draw a factor of a kernel: its name and its function."""
    kind = rng.choice(["power", "exp", "ML", "stretched"] if powers else ["exp", "ML", "stretched"])
    rate = float(np.exp(rng.uniform(np.log(0.1 / T), np.log(1 / h))))
    a = float(rng.uniform(0.1, 0.9))
    if kind == "power":
        return f"t^-{a:.2f}", lambda t: t**-a
    if kind == "exp":
        return f"exp(-{rate:.3g} t)", lambda t: np.exp(-rate * t)
    if kind == "ML":
        return f"E_{a:.2f}({rate:.3g} t)", hd.MittagLeffler(a, rate)
    return f"exp(-({rate:.3g} t)^{a:.2f})", hd.StretchedExponential(a, rate)


def product(rng, h):
    """Draw a product of one or two factors, at most one of them a power."""
    factors = [factor(rng, h, True)]
    if rng.random() < 0.5:
        factors.append(factor(rng, h, not factors[0][0].startswith("t^")))
    names, functions = zip(*factors, strict=True)
    return " ".join(names), lambda t: np.prod([function(t) for function in functions], axis=0)


def draw(rng):
    """Draw a kernel: its name, its function, h, the tolerance, and whether it is a table."""
    h = T * 10 ** -rng.uniform(1.0, 8.0)
    parts = [product(rng, h) for _ in range(rng.integers(1, 4))]
    weights = 10 ** rng.uniform(-1.0, 1.0, len(parts))
    names, functions = zip(*parts, strict=True)
    name = " + ".join(f"{w:.2g} {own}" for w, own in zip(weights, names, strict=True))

    def function(t):
        return sum(w * own(t) for w, own in zip(weights, functions, strict=True))

    tol, is_table = 10.0 ** rng.choice([-4, -6, -8, -10]), rng.random() < 0.2
    return name, function, h, TABLE_TOL if is_table else tol, is_table


@contextmanager
def time_limit(seconds):
    """Raise TimeoutError in the body after some seconds."""

    def stop(*_):
        raise TimeoutError

    before = signal.signal(signal.SIGALRM, stop)
    signal.alarm(seconds)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def true_error(fit, function, t):
    """Return the largest error relative to max(K, 1e-3 of its running mean)."""
    values = function(t)
    mean = hd.Kernel(function).integral(t) / t
    return float((np.abs(fit(t) - values) / np.maximum(values, 1e-3 * mean)).max())


def tabulated(function, h):
    """Return times and values of three digits, up to where the kernel is gone."""
    t = np.geomspace(h, T, 80)
    values = function(t)
    t, values = t[values > 1e-100], values[values > 1e-100]
    return t, np.array([float(f"{value:.2e}") for value in values])


def judged(name, function, h, tol, is_table):
    """Fit a kernel and judge what came of it, as a row."""
    t = np.geomspace(h, T, 20_001)
    t[[0, -1]] = h, T
    if is_table:
        t, values = tabulated(function, h)

    def error_of(fit):
        return np.abs(fit(t) / values - 1).max() if is_table else true_error(fit, function, t)

    modes, told, error, began = 0, np.nan, np.nan, time.perf_counter()
    try:
        with time_limit(LIMIT):
            kernel = hd.Kernel.from_table(t, values) if is_table else hd.Kernel(function)
            fit = hd.fit_exponentials(kernel, t[0], t[-1], tol)
    except TimeoutError:
        seconds, outcome = np.inf, "no end"
    except ValueError as refusal:
        seconds, outcome = time.perf_counter() - began, "refused falsely"
        named = re.search(r"tol must be at least ([^ ,]+)", str(refusal))
        if named:
            fit, told = kernel.closest_fit(t[0], t[-1], tol), float(named[1])
            error = error_of(fit)
            if is_table or tol < 1.05 * error <= 1.1 * told:
                outcome = "refused truly"
        elif is_table and "integrable at 0" in str(refusal):
            last = np.searchsorted(t, np.e * t[0]) - 1  # t K(t) falls over the first e-fold
            outcome = "refused truly" if t[last] * values[last] < t[0] * values[0] else outcome
    else:
        seconds, outcome = time.perf_counter() - began, "fitted"
        modes, told, error = fit.n_modes, fit.max_error, error_of(fit)
        within = np.all(fit.weights > 0) and (is_table or told <= tol)
        if not within or error > 1.05 * told + 3e-14:
            outcome = "fitted falsely"
    return {
        "kernel": ("table of " if is_table else "") + name,
        "T_over_h": f"{T / h:.1e}",
        "tol": f"{tol:.0e}",
        "outcome": outcome,
        "modes": modes,
        "error_reported": f"{told:.1e}",
        "error": f"{error:.1e}",
        "seconds": f"{seconds:.3f}",
    }


def measure(quick):
    rng = np.random.default_rng(SEED)
    drawn = [draw(rng) for _ in range(COUNT)]
    return [judged(*kernel) for kernel in drawn[:: 20 if quick else 1]]


def claims(rows):
    yield Claim("the longest fit [s]", max(row["seconds"] for row in rows), 2)
    kinds = {"functions": [], "tables": []}
    for row in rows:
        kinds["tables" if row["kernel"].startswith("table") else "functions"].append(row["outcome"])
    for kind, outcomes in kinds.items():
        counts = Counter(outcomes)
        yield Claim(f"{kind} fitted, of {len(outcomes)}", counts["fitted"])
        yield Claim(f"{kind} refused truly", counts["refused truly"])
        false = len(outcomes) - counts["fitted"]
        false -= counts["refused truly"] if kind == "tables" else 0
        yield Claim(f"{kind} neither fitted nor refused truly", false, 0, small=True)
    yield Claim("modes at the most", max(row["modes"] for row in rows), 128, small=True)


if __name__ == "__main__":
    study(measure, claims)
