"""Short runs: the cost of set-up, a new order, terms and dense output, compared with the steps.

Relaxation y(0) = 1, D^alpha y = -y, and the stick-slip oscillator, warm, best of several. Claims:

* forty steps of any scheme take less time than SciPy's `solve_ivp` for y' = -y to t = 5 at rtol =
  1e-8. Their error is not estimated. At that tolerance `Collocation` takes less than three times as
  much;
* an order never seen before costs less than five runs with one that was, and less than three
  equations with a run each. The rest are sums of exponentials and rules of the new order;
* other params cost less than a quarter of the call: f is called, and its units are found;
* twenty terms cost less than four times one term on given steps, and less than eight times with
  `Collocation`;
* one point of dense output costs less than ten of SciPy's, and many less than twice as much each;
* a warm call makes no more calls of functions, in Python and in C, than CALLS. They are checks of
  arguments, the stepper of the run and its rows. For an equation they are checks of its function.
"""

import sys
import time

import numpy as np
from _study import Claim, bars, study
from scipy.integrate import solve_ivp

import hereditary as hd

POINTS = np.linspace(0.0, 5.0, 100_000)
LONG = 100_000
ORDERS = np.linspace(0.9, 0.05, 20)
# Most calls of functions in one warm run, which no machine changes.
CALLS = {
    "Collocation, rtol 1e-6": 680,
    "40 steps, ExplicitCaputo": 445,
    "an equation of another order": 300,
    "Collocation, rtol 1e-6, with other params": 805,
    "explicit steps, 40, and their error": 1310,
}


def decay(t, y):
    return -y


def slowed(t, y, p):
    return -p[0] * y


def decay_in_place(t, y, dy, p):
    dy[0] = -y[0]


def best(run, repeats, times=8):
    """Return the least mean of `repeats` runs, in milliseconds of the processor."""
    run()
    found = []
    for _ in range(times):
        began = time.process_time()
        for _ in range(repeats):
            run()
        found.append((time.process_time() - began) / repeats)
    return 1e3 * min(found)


def calls(run):
    """Return the number of calls of functions, in Python and in C, that one warm run makes."""
    run()
    count = 0

    def note(frame, event, argument):
        nonlocal count
        count += event in ("call", "c_call")

    sys.setprofile(note)
    try:
        run()
    finally:
        sys.setprofile(None)
    return count - 1  # that of sys.setprofile


def longer():
    """Return runs by name in which steps cost more than set-up: of one term, and of twenty."""
    terms = [1.0 / (1 + i) * hd.Caputo(order) for i, order in enumerate(ORDERS)]
    runs = {}
    for name, operator in (("one term", terms[0]), ("20 terms", terms)):
        equation = hd.Equation(operator, decay_in_place, 1.0)
        for scheme in (hd.ExplicitCaputo(), hd.L1(), hd.BDF(2)):
            runs[f"{LONG:,} steps, {name}, {type(scheme).__name__}"] = (
                lambda equation=equation, scheme=scheme: hd.solve(
                    equation, 10.0, LONG, scheme=scheme, estimate=False
                )
            )
        runs[f"rtol 1e-8, {name}, Collocation"] = lambda equation=equation: hd.solve(
            equation, 10.0, rtol=1e-8
        )
    return runs


def runs_of(quick):
    """Return milliseconds by name, and numbers of calls by name."""
    repeats, random = 5 if quick else 30, np.random.default_rng(0)
    half = hd.Equation(hd.Caputo(0.5), decay, 1.0)
    ours, stick_slip = hd.solve(half, 5.0, rtol=1e-8), hd.scenes.stick_slip()
    swing = hd.Equation(hd.Caputo(0.5), slowed, 1.0, params=[1.0])
    how = {"rtol": 1e-8, "atol": 1e-10, "dense_output": True}
    theirs = solve_ivp(decay, (0.0, 5.0), [1.0], **how).sol

    def of_order(order):
        hd.solve(hd.Equation(hd.Caputo(order), decay, 1.0), 5.0, rtol=1e-8)

    schemes = (hd.ExplicitCaputo(), hd.L1(), hd.BDF(2), hd.Adams())
    runs = {
        "solve_ivp, rtol 1e-8": lambda: solve_ivp(decay, (0.0, 5.0), [1.0], **how),
        **{
            f"40 steps, {type(scheme).__name__}": lambda scheme=scheme: hd.solve(
                half, 5.0, 40, scheme=scheme, estimate=False
            )
            for scheme in schemes
        },
        "an exponent, 1,000 steps": lambda: hd.lyapunov(stick_slip, 10.0, 1000),
        "Collocation, rtol 1e-6": lambda: hd.solve(half, 1.0, rtol=1e-6),
        "Collocation, rtol 1e-6, with other params": lambda: hd.solve(
            swing.replace(params=[2.0]), 1.0, rtol=1e-6
        ),
        "explicit steps, 40, and their error": lambda: hd.solve(half, 5.0, 40),
        "solve_ivp, rtol 1e-6": lambda: solve_ivp(decay, (0.0, 1.0), [1.0], rtol=1e-6),
        "Collocation, rtol 1e-3": lambda: hd.solve(half, 5.0, rtol=1e-3),
        "Collocation, rtol 1e-8": lambda: hd.solve(half, 5.0, rtol=1e-8),
        "Collocation, a new order": lambda: of_order(random.uniform(0.3, 0.95)),
        "an equation of a known order, and its run": lambda: of_order(0.5),
        "an equation with other params": lambda: swing.replace(params=[2.0]),
        "an equation of another order": lambda: hd.Equation(hd.Caputo(0.6), decay, 1.0),
        "dense output, one point": lambda: ours(1.234),
        "solve_ivp's, one point": lambda: theirs(1.234),
    }
    found = {name: best(run, repeats) for name, run in runs.items()}
    found |= {name: best(run, 1) for name, run in longer().items()}
    # in nanoseconds a point
    found["dense output, each of many"] = best(lambda: ours(POINTS), 1) / POINTS.size
    found["solve_ivp's, each of many"] = best(lambda: theirs(POINTS), 1) / POINTS.size
    return found, {name: calls(runs[name]) for name in CALLS}


def measure(quick):
    found, counts = runs_of(quick)
    for name, value in found.items():
        yield {"what": name, "milliseconds": f"{value:.3g}", "calls": counts.get(name, "")}


def claims(rows):
    found = {row["what"]: row["milliseconds"] for row in rows}
    scipy = found["solve_ivp, rtol 1e-8"]
    for name, value in found.items():
        if name.startswith("40 steps"):
            yield Claim("forty steps over SciPy's solve_ivp at 1e-8", value / scipy, 1, where=name)
            yield Claim("forty steps [ms]", value)
        if "one term" in name:
            kind, limit = ("Collocation", 8) if "Coll" in name else ("given steps", 4)
            ratio = found[name.replace("one term", "20 terms")] / value
            yield Claim(f"twenty terms over one, {kind}", ratio, limit, where=name)
    ours = "Collocation, rtol 1e-8"
    for text, one, other, limit in (
        ("Collocation at 1e-8 over solve_ivp", ours, "solve_ivp, rtol 1e-8", 3),
        ("a new order over one that was seen", "Collocation, a new order", ours, 5),
        ("a new order over an equation and its run", "Collocation, a new order",
         "an equation of a known order, and its run", 3),
        ("one point of dense output over SciPy's", "dense output, one point",
         "solve_ivp's, one point", 10),
        ("each of many points over SciPy's", "dense output, each of many",
         "solve_ivp's, each of many", 2),
    ):  # fmt: skip
        yield Claim(text, found[one] / found[other], limit)
    for row in rows:
        if row["what"] in CALLS:
            text = "calls of functions in a warm run"
            yield Claim(text, row["calls"], CALLS[row["what"]], where=row["what"])
    call, theirs = found["Collocation, rtol 1e-6"], found["solve_ivp, rtol 1e-6"]
    for text, value, limit in (
        ("a dozen steps at 1e-6 over solve_ivp's RK45", call / theirs, 4),
        ("40 explicit steps over RK45 at 1e-6", found["40 steps, ExplicitCaputo"] / theirs, 1.5),
        ("an equation over RK45 at 1e-6", found["an equation of another order"] / theirs, 0.8),
        ("other params over the call", found["Collocation, rtol 1e-6, with other params"] / call,
         1.25),
        ("the error of 40 steps over the steps",
         found["explicit steps, 40, and their error"] / found["40 steps, ExplicitCaputo"] - 1, 4),
    ):  # fmt: skip
        yield Claim(text, value, limit)
    for name in (ours, "Collocation, a new order", "an exponent, 1,000 steps"):
        yield Claim(f"{name} [ms]", found[name])


if __name__ == "__main__":
    draw = bars("milliseconds", ("what",), log="x", title="Short runs, best of several")
    study(measure, claims, lambda rows: draw([row for row in rows if "many" not in row["what"]]))
