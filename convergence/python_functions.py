"""A right-hand side that numba cannot compile costs its own time and less than 5 us a call.

Three of them, each beside a compiled one of the same values, are solved by a scheme with steps of
each kind and by collocation:

* a call takes at most 5 us more than the function itself does (seconds of the run over `n_rhs`;
  collocation spends them on its steps as well, whose own time, that of the compiled run, is left
  out);
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

MOST = 5.0  # us
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


def fastest(run, times):
    spent = []
    for _ in range(times):
        began = time.perf_counter()
        run()
        spent.append(time.perf_counter() - began)
    return min(spent)


def own_time(fun, times):
    """Microseconds of a call from Python."""
    y, calls = np.ones(1), 5000

    def run():
        for k in range(calls):
            fun(1e-4 * k, y)

    return 1e6 * fastest(run, times) / calls


def measure(study):
    times = 2 if study.quick else 9
    compiled = hd.Equation(hd.Caputo(0.9), lambda t, y: -y, 1.0)
    for name in ("method", "dictionary", "spline"):
        fun = getattr(Model(), name)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", hd.PythonFunctionWarning)
            equation = hd.Equation(hd.Caputo(0.9), fun, 1.0)
        for label, scheme in SCHEMES.items():
            how = {"rtol": 1e-8} if scheme.adaptive else {"n_steps": 2000 if study.quick else 20000}

            def solved(eq, how=how, scheme=scheme):
                return hd.solve(eq, 1.0, scheme=scheme, **how)

            ours, theirs = solved(equation), solved(compiled)
            seconds, beside = (fastest(partial(solved, eq), times) for eq in (equation, compiled))
            own, n_rhs = own_time(fun, times), ours.stats["n_rhs"]
            yield {
                "function": name,
                "scheme": label,
                "rhs": n_rhs,
                "ms": f"{1e3 * seconds:.3g}",
                "compiled_ms": f"{1e3 * beside:.3g}",
                "own_us": f"{own:.3g}",
                "added_us": f"{1e6 * (seconds - beside) / n_rhs - own:.3g}",
                "apart": f"{np.abs(ours.y[-1] / theirs.y[-1] - 1).max():.2g}",
            }


def main():
    study = Study(__file__, __doc__)
    study.write(list(measure(study)))
    rows = study.read()
    added = max(row["added_us"] for row in rows)
    check(f"a call adds at most {added:.2g} us (below {MOST:g})", added < MOST, study.quick)
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
