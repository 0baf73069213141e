"""Orders that vary: the orders of convergence are kept, at a few times the cost.

alpha(t) = 0.5 + 0.3 sin t and beta(t) = 1.5 + 0.3 cos t, alone and together. Claims:

* solutions are 1 + v t + t**3 to t = 2.5. The largest error falls with order 1 for the explicit
  scheme. For L1 it falls with 2 - alpha or 3 - beta, at least 1.2 on the way, within 0.1;
* collocation keeps it within the tolerance, rtol (0.01 + size), from 1e-4 to 1e-11, in at most 150
  steps. With a solution that is not smooth at 0 it is faster than both for errors below 1e-5;
* one set of rates with positive weights keeps the relative error of ``t**-a`` below the tolerance
  on 20,001 points. This holds for all 200 exponents tried in (0, 1];
* at N = 20,000 and a tolerance of 1e-10 modes deviate from direct sums by less than 1e-9;
* at N = 200,000 the stick-slip load with varying beta and gamma takes at most 4 times as long as
  with constant ones. So do equations with one and two terms and a very cheap right-hand side;
* exponents of Lyapunov by tangents and by pairs of orbits agree to 1e-5.
"""

import math
import time
from functools import partial

import numpy as np
from _study import Claim, chosen, curves, in_turns, side_by_side, study
from schemes.varying import MADE, alpha, beta

import hereditary as hd
from hereditary.analysis.convergence import observed_order
from hereditary.kernels.exponential_sum import bank_of_all_orders, weights_of_orders

SCHEMES = {"explicit": hd.ExplicitCaputo(), "L1": hd.L1()}


NAMES = {"below one": "alpha(t)", "above one": "beta(t)", "both": "both"}
PROBLEMS = {name: (MADE[made][0](), MADE[made][1]) for made, name in NAMES.items()}


def row(what, name, n, value, order="", digits=4):
    return {"what": what, "name": name, "n": n, "value": f"{value:.{digits}g}", "order": order}


def measure_orders(quick):
    counts = [100 * 2**k for k in range(4 if quick else 10)]
    rows = []
    for label, scheme in SCHEMES.items():
        for name, (equation, speed) in PROBLEMS.items():
            errors = []
            for n in counts:
                sol = hd.solve(equation, 2.5, n, scheme=scheme, history=hd.SumOfExponentials(1e-13))
                errors.append(float(np.abs(sol.y[:, 0] - 1 - speed * sol.t - sol.t**3).max()))
            orders = [np.nan, *observed_order(counts, errors)[0]]
            rows += [
                row("error", f"{label}, {name}", n, error, f"{order:.3f}")
                for n, error, order in zip(counts, errors, orders, strict=True)
            ]
    return rows


def measure_collocation(quick):
    """Largest error over its tolerance, with the number of steps."""
    rows = []
    for name, (equation, speed) in PROBLEMS.items():
        for rtol in 10.0 ** -np.arange(4, 7 if quick else 13):
            sol = hd.solve(equation, 2.5, rtol=rtol)
            t = np.unique(np.append(np.geomspace(1e-12, 2.5, 200), np.linspace(0, 2.5, 201)))
            true = 1 + speed * t + t**3
            ratio = np.abs(sol(t)[:, 0] - true) / (rtol * (0.01 + true))
            found = row("collocation", f"{name}, {rtol:.0e}", sol.stats["n_steps"], ratio.max())
            rows.append(found)
    return rows


def forced(t, x):
    return x - x**3 + 0.5 * np.cos(t)


def duffing():
    """A nonlinear oscillator both of whose orders vary; its solution is not smooth at 0."""
    return hd.Equation([hd.Caputo(beta), 0.2 * hd.Caputo(alpha)], forced, [0.2, 0.3])


def measure_work(quick):
    """Largest error of that to t = 10, with the time of the processor it took."""
    equation, t_end, rows = duffing(), 10.0, []
    truth = hd.solve(equation, t_end, rtol=1e-12, scheme=hd.Collocation(nodes=10))
    runs = [("Collocation", {"rtol": 10.0**-k}) for k in range(3, 7 if quick else 12)]
    for label, scheme in SCHEMES.items():
        counts = [200 * 4**k for k in range(2 if quick else 7)]
        runs += [(label, {"n_steps": n, "scheme": scheme}) for n in counts]
    for label, given in runs:
        call = partial(hd.solve, equation, t_end, **given)
        seconds, sol = in_turns({label: call}, 3, time.process_time)[label], call()
        some = slice(None, None, max(1, sol.t.size // 1000))
        error = float(np.abs(sol.y[some] - truth(sol.t[some])).max())
        rows.append(row("work", label, sol.t.size - 1, error, f"{seconds:.3e}"))
    return rows


def measure_rates(quick):
    """Largest relative error of a kernel over the tolerance; 2 where a weight is negative."""
    rows = []
    t = np.exp(np.linspace(0.0, math.log(2e7), 20_001))
    for tol in (1e-6, 1e-10, 1e-12):
        decays = np.exp(-np.multiply.outer(t, bank_of_all_orders(2e7, tol)[0]))
        exponents = np.linspace(0.0, 1.0, 11 if quick else 201)[1:]
        for a, weights in zip(exponents, weights_of_orders(exponents, 2e7, tol).T, strict=True):
            error = np.abs(decays @ weights * t**a - 1).max() / tol
            value = error if np.all(weights > 0) else 2.0
            rows.append(row("rates", f"tol = {tol:g}", f"{a:.3f}", value))
    return rows


def measure_deviation(quick):
    n = 2000 if quick else 20_000
    rows = []
    for name, (equation, _) in PROBLEMS.items():
        ends = [
            hd.solve(equation, 2.5, n, history=history).y
            for history in (hd.SumOfExponentials(1e-10), hd.Direct())
        ]
        off = float(np.abs(ends[0] - ends[1]).max() / np.abs(ends[1]).max())
        rows.append(row("deviation", name, n, off))
    return rows


def force(t, y, dy, params):
    """A nonlinear right-hand side of the usual cost."""
    dy[0] = -y[0] - np.sin(3 * y[0]) + np.cos(t)


def pull(t, x, dy, params):
    """That of the stick-slip load; parameters: its well."""
    total = t - x[0]
    for k in range(params.shape[0]):
        total += 50.0 * params[k] * np.sin((k + 1) * x[0])
    dy[0] = total


def slack(t, x, dy, params):
    """About the cheapest there is."""
    dy[0] = -x[0]


def gamma(t):
    return 0.8 + 0.1 * np.sin(t)


def measure_seconds(quick):
    n = 20_000 if quick else 200_000
    wells, y0 = hd.scenes.PRINTED_WELL, [0.2, 0.3]

    def late_beta(t):
        return 1.8 + 0.1 * np.cos(t)

    def load(b, g, rhs=pull):
        return hd.Equation([hd.Caputo(b), 0.25 * hd.Caputo(g)], rhs, y0, params=wells)

    pairs = {
        "one term": [hd.Equation(hd.Caputo(order), force, 0.2) for order in (0.6, alpha)],
        "stick-slip": [load(1.8, 0.8), load(late_beta, gamma)],
        "two terms": [load(1.8, 0.8, slack), load(late_beta, gamma, slack)],
    }
    rows = []
    for name, equations in pairs.items():
        calls = {
            kind: partial(hd.solve, equation, 5e-4 * n, n, save_every=100)
            for kind, equation in zip(("constant", "varying"), equations, strict=True)
        }
        # time of the processor: the machine is shared
        for kind, best in in_turns(calls, 3 if quick else 15, time.process_time).items():
            rows.append(row(f"seconds, {kind}", name, n, best))
    return rows


def measure_exponents(quick):
    equation = duffing()
    n = 2000 if quick else 20_000
    found = [
        hd.lyapunov(equation, n / 200, n, k=2, mode=mode, renorm=1.0, verify=False).exponents
        for mode in ("tangent", "pair")
    ]
    return [
        row("exponent", f"{i + 1}, {mode}", n, exponents[i], digits=9)
        for mode, exponents in zip(("tangent", "pair"), found, strict=True)
        for i in range(2)
    ]


def measure(quick):
    parts = (measure_orders, measure_collocation, measure_work, measure_rates)
    parts += (measure_deviation, measure_seconds, measure_exponents)
    return [found for part in parts for found in part(quick)]


def claims(rows):
    for name, order in {row["name"]: row["order"] for row in chosen(rows, what="error")}.items():
        off = abs(order - (1.0 if name.startswith("explicit") else 1.2))
        yield Claim("orders off the proven ones", off, 0.1, where=name)
    for row in chosen(rows, what="collocation"):
        if "e-12" not in row["name"]:
            how = {"where": row["name"], "small": True}
            yield Claim("errors of Collocation over the tolerance", row["value"], 1, **how)
            yield Claim("steps of Collocation", row["n"], 150, **how)
    work = chosen(rows, what="work")
    ours = [(row["value"], row["order"]) for row in work if row["name"] == "Collocation"]
    for row in work:
        if row["value"] < 1e-5 and row["name"] in SCHEMES:
            ratio = row["order"] / min(s for error, s in ours if error <= row["value"])
            text = "time of given steps over that of Collocation, errors below 1e-5"
            yield Claim(text, ratio, at_least=1, where=row["name"])
    worst = max(row["value"] for row in chosen(rows, what="rates"))
    yield Claim("errors of kernels over the tolerance", worst, 1, small=True)
    for row in chosen(rows, what="deviation"):
        yield Claim("modes off direct sums", row["value"], 1e-9, where=row["name"], small=True)
    seconds = {(row["what"], row["name"]): row["value"] for row in rows}
    for name in ("one term", "stick-slip", "two terms"):
        ratio = seconds["seconds, varying", name] / seconds["seconds, constant", name]
        yield Claim("times the run with constant orders", ratio, 4, where=name)
    found = [row["value"] for row in chosen(rows, what="exponent")]
    apart = max(abs(found[i] - found[i + 2]) for i in range(2))
    yield Claim("exponents of tangents and pairs apart", apart, 1e-5, small=True)


if __name__ == "__main__":
    errors = {"xlabel": "steps", "ylabel": "largest error", "title": "Orders that vary"}
    work = {"xlabel": "seconds", "ylabel": "largest error", "title": "Oscillator, both vary"}
    rates = {"xlabel": "exponent a", "ylabel": "error / tolerance", "title": "Rates for all orders"}
    draw = side_by_side(
        curves("n", "value", ("name",), slopes=(1, 1.2), of={"what": "error"}, **errors),
        curves("order", "value", ("name",), of={"what": "work"}, **work),
        curves("n", "value", ("name",), log="", of={"what": "rates"}, **rates),
    )
    study(measure, claims, draw)
