"""`hd.solve_ivp` at order 1 is as accurate as SciPy's, and keeps its tolerance at other orders.

The problems are Lotka and Volterra's equations and a stiff van der Pol oscillator at order 1, and
relaxation of order 0.7. The rows have the largest error of y at the end over the size of y, the
evaluations, and the time of a warm call. SciPy's LSODA and Radau have the same tolerances. SciPy
calls the function in Python, `hd.solve_ivp` compiles it. References are Radau at 1e-12 and
Mittag-Leffler functions.
"""

from functools import partial

import numpy as np
import scipy.integrate
from _study import Claim, curves, fastest, study

import hereditary as hd


def predators(t, y):
    return np.array([1.5 * y[0] - y[0] * y[1], -3.0 * y[1] + y[0] * y[1]])


def van_der_pol(t, y):
    return np.array([y[1], 100.0 * (1 - y[0] ** 2) * y[1] - y[0]])


def decay(t, y):
    return -y


PROBLEMS = {
    "Lotka-Volterra": (predators, 10.0, [10.0, 5.0], 1.0),
    "van der Pol, stiff": (van_der_pol, 120.0, [2.0, 0.0], 1.0),
    "relaxation of order 0.7": (decay, 5.0, [1.0], 0.7),
}


def truth(fun, end, y0, order):
    """Return y at the end."""
    if order < 1:
        return hd.exact.relaxation(order, 1.0, y0)(end)
    how = {"method": "Radau", "rtol": 1e-12, "atol": 1e-14}
    return scipy.integrate.solve_ivp(fun, (0.0, end), y0, **how).y[:, -1]


def measure(quick):
    rows = []
    for name, (fun, end, y0, order) in PROBLEMS.items():
        known = truth(fun, end, y0, order)
        ours = partial(hd.solve_ivp, fun, (0.0, end), y0, order=order)
        codes = {"hereditary": ours}
        if order == 1:
            for method in ("LSODA", "Radau"):
                theirs = partial(scipy.integrate.solve_ivp, fun, (0.0, end), y0, method)
                codes[f"SciPy {method}"] = theirs
        for code, call in codes.items():
            for rtol in (1e-4, 1e-7) if quick else 10.0 ** -np.arange(3.0, 10.0):
                seconds, sol = fastest(partial(call, rtol=rtol, atol=1e-3 * rtol))
                error = np.abs(sol.y[:, -1] - known).max() / np.abs(known).max()
                rows.append(
                    {
                        "problem": name,
                        "code": code,
                        "rtol": f"{rtol:.0e}",
                        "error": f"{error:.2e}",
                        "evaluations": sol.nfev,
                        "milliseconds": f"{1e3 * seconds:.3f}",
                    }
                )
    return rows


def claims(rows):
    times = {(row["problem"], row["code"], row["rtol"]): row["milliseconds"] for row in rows}
    for row in rows:
        if row["code"] != "hereditary":
            continue
        where = {"where": f"{row['problem']}, {row['rtol']:g}"}
        yield Claim("error over rtol", row["error"] / row["rtol"], 1, **where, small=True)
        for method in ("LSODA", "Radau"):
            other = times.get((row["problem"], f"SciPy {method}", row["rtol"]))
            if other:
                yield Claim(f"time over {method}'s", row["milliseconds"] / other, **where)


if __name__ == "__main__":
    study(measure, claims, curves("milliseconds", "error", ("code",), ("problem",)))
