"""A right-hand side that numba cannot compile costs its own time and less than 5 us a call.

Three of them, each beside a compiled one of the same values, are solved by a scheme with steps of
each kind and by collocation. A call takes the seconds of the run, less those of the compiled one,
over `n_rhs`:

* on given steps at most 5 us more than the function itself takes in a loop;
* in collocation at most 10 us more. About a hundred calls are between long periods of other work,
  after which the function itself is also slower than in a loop;
* numbers of both are equal to 1e-12.
"""

import warnings
from functools import partial

import numpy as np
from _study import Claim, bars, in_turns, study
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


def calls(fun):
    """Call a function from Python."""
    y = np.ones(1)
    for k in range(CALLS):
        fun(1e-4 * k, y)


def measure(quick):
    times = 2 if quick else 25
    compiled = hd.Equation(hd.Caputo(0.9), lambda t, y: -y, 1.0)
    for name in ("method", "dictionary", "spline"):
        fun = getattr(Model(), name)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", hd.PythonFunctionWarning)
            equation = hd.Equation(hd.Caputo(0.9), fun, 1.0)
        for label, scheme in SCHEMES.items():
            how = (
                {"rtol": 1e-8}
                if isinstance(scheme, hd.Collocation)
                else {"n_steps": 2000 if quick else 20000}
            )

            def solved(eq, how=how, scheme=scheme):
                for _ in range(20 if isinstance(scheme, hd.Collocation) else 1):
                    sol = hd.solve(eq, 1.0, scheme=scheme, estimate=False, **how)
                return sol

            ours, theirs = solved(equation), solved(compiled)
            runs = partial(solved, equation), partial(solved, compiled), partial(calls, fun)
            spent, beside, own = in_turns(dict(enumerate(runs)), times).values()
            own, n_rhs = 1e6 * own / CALLS, ours.stats["n_rhs"]
            spent, beside = (
                value / (20 if isinstance(scheme, hd.Collocation) else 1)
                for value in (spent, beside)
            )
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


def claims(rows):
    for row in rows:
        kind, most = ("collocation", 2) if row["scheme"] == "Collocation" else ("given steps", 1)
        where = f"{row['function']}, {row['scheme']}"
        yield Claim(f"{kind}: a call adds [us]", row["added_us"], most * MOST, where=where)
        yield Claim("results apart by", row["apart"], 1e-12, where=where, small=True)


if __name__ == "__main__":
    title = "A function called in Python, beside its own time"
    study(measure, claims, bars("added_us", ("function", "scheme"), title=title))
