"""A right-hand side that numba cannot compile costs its own time and less than 5 us a call.

Three of them, each beside a compiled one of the same values, are solved by a scheme with steps of
each kind and by collocation. A call takes the seconds of the run, less those of the compiled one,
over `n_rhs`:

* on given steps at most 5 us more than the function itself takes in a loop;
* in collocation at most 10 us more: some hundred calls lie between long stretches of other work,
  after which also the function itself is slower than in a loop;
* numbers of both are equal to 1e-12.
"""

import time
import warnings
from functools import partial

import matplotlib.pyplot as plt
import numpy as np
from _study import Study, check
from scipy.interpolate import CubicSpline

import hereditary as hd

MOST, CALLS = 5.0, 2000  # us
SCHEMES = {
    "explicit": hd.ExplicitCaputo(),
    "L1": hd.L1(),
    "Adams": hd.Adams(),
    "Collocation": hd.Collocation(),
}
T = np.linspace(0.0, 10.0, 21)


class Model:
    """Functions that read what numba does not know."""

    rates = {"k": 1.0}
    ramp = CubicSpline(T, 1 + 0.0 * T)

    def method(self, t, y):
        return -y

    def dictionary(self, t, y):
        return [-self.rates["k"] * y[0]]

    def spline(self, t, y):
        return [-float(self.ramp(t)) * y[0]]


def seconds(run):
    began = time.perf_counter()
    run()
    return time.perf_counter() - began


def calls(fun):
    """Call a function from Python."""
    y = np.ones(1)
    for k in range(CALLS):
        fun(1e-4 * k, y)


def measure(study):
    times = 2 if study.quick else 25
    compiled = hd.Equation(hd.Caputo(0.9), lambda t, y: -y, 1.0)
    for name in ("method", "dictionary", "spline"):
        fun = getattr(Model(), name)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", hd.PythonFunctionWarning)
            equation = hd.Equation(hd.Caputo(0.9), fun, 1.0)
        for label, scheme in SCHEMES.items():
            how = {"rtol": 1e-8} if scheme.adaptive else {"n_steps": 2000 if study.quick else 20000}

            def solved(eq, how=how, scheme=scheme):
                for _ in range(20 if scheme.adaptive else 1):
                    sol = hd.solve(eq, 1.0, scheme=scheme, **how)
                return sol

            ours, theirs = solved(equation), solved(compiled)
            runs = partial(solved, equation), partial(solved, compiled), partial(calls, fun)
            # in turn, so that all see the same machine
            rounds = [[seconds(run) for run in runs] for _ in range(times)]
            spent, beside, own = map(min, zip(*rounds, strict=True))
            own, n_rhs = 1e6 * own / CALLS, ours.stats["n_rhs"]
            spent, beside = (value / (20 if scheme.adaptive else 1) for value in (spent, beside))
            yield {
                "function": name,
                "scheme": label,
                "rhs": n_rhs,
                "ms": f"{1e3 * spent:.3g}",
                "compiled_ms": f"{1e3 * beside:.3g}",
                "own_us": f"{own:.3g}",
                "added_us": f"{1e6 * (spent - beside) / n_rhs - own:.3g}",
                "apart": f"{np.abs(ours.y[-1] / theirs.y[-1] - 1).max():.2g}",
            }


def main():
    study = Study(__file__, __doc__)
    study.write(list(measure(study)))
    rows = study.read()
    for kind, most in (("given steps", MOST), ("collocation", 2 * MOST)):
        chosen = [row for row in rows if (row["scheme"] == "Collocation") == (most > MOST)]
        added = max(row["added_us"] for row in chosen)
        text = f"{kind}: a call adds at most {added:.2g} us (below {most:g})"
        check(text, added < most, study.quick)
    apart = max(row["apart"] for row in rows)
    check(f"numbers apart by {apart:.1e} (below 1e-12)", apart < 1e-12)
    names = [f"{row['function']}, {row['scheme']}" for row in rows]
    own, added = (np.array([row[key] for row in rows]) for key in ("own_us", "added_us"))
    figure, ax = plt.subplots(figsize=(7, 4), layout="constrained")
    ax.barh(names, own, label="the function itself", color="#56B4E9")
    ax.barh(names, added, left=own, label="added", color="#D55E00")
    ax.invert_yaxis()
    ax.legend()
    ax.set(xlabel="µs a call", title="A function called in Python")
    study.save(figure)


if __name__ == "__main__":
    main()
