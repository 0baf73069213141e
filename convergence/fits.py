"""Fits to data: standard errors are right in seeded trials, and a fit takes 0.1 s.

Three models are fitted to 60 values with normal noise of known seeds, 200 times each. The first is
a relaxation (order and rate), the second an oscillator (two orders, friction, stiffness). The third
is a gas that accumulates in a chamber with memory, ``D^alpha(t) A = S - lambda A``. Its order is a
line in time (both its ends, S and lambda), and its noise is a tenth per cent. Claims:

* all fits succeed, and true values lie within two standard errors in 95 +- 3 per cent of all cases;
* the oscillator's four parameters take at most 15 sets of runs for each of them.
"""

import time
import warnings

import matplotlib.pyplot as plt
import numpy as np
from _study import Claim, study

import hereditary as hd

N_DATA, TRIALS = 60, 200


def decay(t, y, p):
    return -p[0] * y


def gain(t, y, p):
    return p[0] - p[1] * y


def relaxation(alpha, rate):
    return hd.Equation(hd.Caputo(alpha), decay, 1.0, params=[rate])


def oscillator(beta, gamma, friction, stiffness):
    terms = hd.Caputo(beta) + friction * hd.Caputo(gamma)
    return hd.Equation(terms, decay, [1.0, 0.0], params=[stiffness])


def accumulation(first, last, source, loss):
    def alpha(t):
        return first + (last - first) * t / 20.0

    return hd.Equation(hd.Caputo(alpha), gain, 0.0, params=[source, loss])


# model, last time, noise, true values, first guess, bounds
MODELS = {
    "relaxation": (
        relaxation,
        5.0,
        0.01,
        {"alpha": 0.7, "rate": 1.5},
        {"alpha": 0.9, "rate": 1.0},
        {"alpha": (0.05, 1.0)},
    ),
    "oscillator": (
        oscillator,
        12.0,
        0.01,
        {"beta": 1.8, "gamma": 0.6, "friction": 0.3, "stiffness": 1.5},
        {"beta": 1.6, "gamma": 0.5, "friction": 0.2, "stiffness": 1.2},
        {"beta": (1.05, 2.0), "gamma": (0.02, 1.0)},
    ),
    "accumulation": (
        accumulation,
        20.0,
        0.002,
        {"first": 0.9, "last": 0.7, "source": 1.0, "loss": 0.5},
        {"first": 0.8, "last": 0.8, "source": 0.8, "loss": 0.6},
        {"first": (0.1, 1.0), "last": (0.1, 1.0)},
    ),
}


def trials(name, count):
    """Fit noisy data many times; return rows of one for each parameter, and one fit."""
    model, t_end, noise, truth, guess, bounds = MODELS[name]
    t = np.linspace(t_end / N_DATA, t_end, N_DATA)
    exact = hd.solve(model(**truth), t_end, rtol=1e-10, t_eval=t).y[:, 0]
    misses, runs, seconds, failed = [], [], [], 0
    for seed in range(count):
        data = exact + noise * np.random.default_rng(seed).normal(size=N_DATA)
        began = time.perf_counter()
        found = hd.fit(model, t, data, guess, bounds=bounds)
        seconds.append(time.perf_counter() - began)
        failed += not found.success
        runs.append(found.n_runs)
        misses.append([(found.parameters[k] - truth[k]) / found.standard_errors[k] for k in truth])
    inside = np.mean(np.abs(misses) <= 2, axis=0)
    rows = [
        {
            "model": name,
            "parameter": parameter,
            "true": truth[parameter],
            "standard error": f"{found.standard_errors[parameter]:.2g}",
            "within two of them": f"{share:.3f}",
            "sets of runs": f"{np.mean(runs):.1f}",
            "milliseconds": f"{1e3 * np.median(seconds):.3g}",
            "failed": failed,
        }
        for parameter, share in zip(truth, inside, strict=True)
    ]
    return rows, found


def measure(quick):
    figure, axes = plt.subplots(3, 1, figsize=(6.5, 8), layout="constrained")
    for ax, name in zip(axes, MODELS, strict=True):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", hd.SolveWarning)
            rows, last = trials(name, 3 if quick else TRIALS)
        hd.plots.fit(last, ax=ax)
        yield from rows
    yield figure


def claims(rows):
    yield Claim("fits that failed", sum(row["failed"] for row in rows), 0)
    inside = np.mean([row["within two of them"] for row in rows])
    yield Claim("true values within two standard errors", inside, 0.98, 0.92)
    for row in rows:
        yield Claim("the same, by parameter", row["within two of them"], where=row["parameter"])
        if row["model"] == "oscillator":
            yield Claim("sets of runs for four parameters", row["sets of runs"], 60)
            yield Claim("time of a fit of four parameters [ms]", row["milliseconds"])


if __name__ == "__main__":
    study(measure, claims)
