"""`stats["error_estimate"]` of runs on given steps is their error, wherever it is above 2e-4.

Problems are drawn: orders from 0.2 to 1.95, 40 to 4,000 steps of five schemes, and forces and
fronts that these steps may not resolve. Driven are linear and cubic springs and a pendulum, and
a spring whose force switches steeply. There is a front, and a pair of which one part relaxes
fast. All solutions start like t**alpha. Errors are those of all rows against a run to 1e-9,
relative to the size of each component. A run to 1e-11 says where that is not accurate.

The time of an estimate is that of processors, of a call like one before, and of the first call with
its order.
"""

import time
import warnings

import numpy as np
from _study import Claim, chosen, curves, study

import hereditary as hd

N_PROBLEMS, KNOWN = 500, 2e-4
SCHEMES = [hd.ExplicitCaputo(), hd.BDF(2), hd.L1(), hd.Adams(2), hd.GrunwaldLetnikov()]
STEPS = [40, 60, 150, 400, 1000, 4000]


def linear(t, y, p):
    return -p[0] * y + p[1] * np.sin(p[2] * t)


def cubic(t, y, p):
    return -p[0] * y**3 + p[1] * np.sin(p[2] * t)


def pendulum(t, y, p):
    return -p[0] * np.sin(y) + p[1] * np.cos(p[2] * t)


def steep(t, y, p):
    return -p[0] * y + p[1] * np.tanh(20 * np.sin(p[2] * t))


def front(t, y, p):
    return 8 * p[0] * y * y * (1 - y)


def two(t, y, p):
    return np.array([10 * p[0] * (np.cos(p[2] * t) - y[0]), p[1] * y[0] - y[1]])


KINDS = [linear, cubic, pendulum, steep, front, two]


def problem(number):
    """Return an equation, its end, its scheme and its number of steps."""
    rng = np.random.default_rng([20261127, number])
    kind, scheme = KINDS[number % 6], SCHEMES[number % 5]
    order, n, t_end = rng.uniform(0.2, 1.95), int(rng.choice(STEPS)), rng.uniform(5.0, 30.0)
    if kind is front:
        order, t_end = 0.2 + 0.8 * (order - 0.2) / 1.75, 2 * t_end
    params = rng.uniform(0.3, 2.0, 3)
    params[2] *= rng.choice([1.0, 3.0, 30.0], p=[0.45, 0.45, 0.1])
    start = {front: [0.05], two: [1.0, 0.0]}.get(kind, [1.0])
    y0 = start if order <= 1 else [start, [0.0] * len(start)]
    return hd.Equation(hd.Caputo(order), kind, y0, params=params), t_end, scheme, n


def cpu(call, times=1):
    """Return the least milliseconds of processors of a call, and what it gave."""
    least = np.inf
    for _ in range(times):
        began = time.process_time()
        found = call()
        least = min(least, 1e3 * (time.process_time() - began))
    return least, found


def row(number):
    """Return what a problem gives: error, estimate, and milliseconds."""
    equation, t_end, scheme, n = problem(number)

    def run(**more):
        return hd.solve(equation, t_end, n, scheme=scheme, **more)

    with warnings.catch_warnings(record=True) as seen:
        warnings.simplefilter("always")
        first_plain, _ = cpu(lambda: run(estimate=False))
        seen.clear()
        first, sol = cpu(run)
        warned = len(seen)
        plain, _ = cpu(lambda: run(estimate=False), 3)
        warm, _ = cpu(run, 3)
        true, closer = (hd.solve(equation, t_end, rtol=rtol) for rtol in (1e-9, 1e-11))
    told, error = sol.stats.get("error_estimate"), np.nan
    if sol.success and true.success and closer.success:
        size = np.abs(closer(sol.t)).max(axis=0)
        if (np.abs(true(sol.t) - closer(sol.t)) / size).max() < 1e-6:
            error = float((np.abs(sol.y - closer(sol.t)) / size).max())
    ends = "" if sol.success else f"run {sol.status}"
    return {
        "number": number, "kind": KINDS[number % 6].__name__, "scheme": repr(scheme),
        "order": round(equation.terms[0].operator.order, 4), "n_steps": n, "warnings": warned,
        "error": f"{error:.4e}", "estimate": "" if told is None else f"{told:.4e}",
        "estimate_over_error": "" if told is None else f"{told / error:.5f}",
        "why": sol.stats.get("error_unknown", ends),
        "run_ms": f"{plain:.2f}", "warm_ms": f"{warm - plain:.2f}",
        "first_run_ms": f"{first_plain:.2f}", "first_ms": f"{first - first_plain:.2f}",
    }  # fmt: skip


def measure(quick):
    for number in range(30 if quick else N_PROBLEMS):
        yield row(number)


def claims(rows):
    known = [row for row in rows if np.isfinite(row["error"])]
    yield Claim("runs whose error is known", len(known))
    told = [row for row in known if row["estimate"] != "" and row["error"] > KNOWN]
    yield Claim("of these, estimated errors above 2e-4", len(told))
    ratios = [row["estimate_over_error"] for row in told]
    text = "estimate over the error, above 2e-4"
    yield Claim(f"{text}: least", min(ratios), at_least=0.9, small=True)
    yield Claim(f"{text}: largest", max(ratios), 1.1, small=True)
    small = [row for row in known if row["estimate"] != "" and row["error"] <= KNOWN]
    least = max((row["estimate"] for row in small), default=0.0)
    yield Claim("largest estimate of an error below 2e-4", least, 1.1 * KNOWN, small=True)
    silent = [row["error"] for row in known if row["warnings"] == 0]
    yield Claim("largest error without a warning", max(silent), 0.1, small=True)
    yield Claim("runs without an estimate", sum(row["estimate"] == "" for row in known))
    errors = [row["error"] for row in known if row["estimate"] == ""]
    yield Claim("their least error", min(errors, default=np.nan))
    for n in (40, 4000):
        mine = chosen(rows, n_steps=n)
        for name, run in (("warm", "run"), ("first", "first_run")):
            ratio = [row[f"{name}_ms"] / row[f"{run}_ms"] for row in mine if row["estimate"] != ""]
            yield Claim(
                f"{n} steps, {name} calls: estimate over run, median time", np.median(ratio)
            )


draw = curves("error", "estimate", ("kind",), ("scheme",), line="")


if __name__ == "__main__":
    study(measure, claims, draw)
