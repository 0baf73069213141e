"""Time and storage of the three histories, and what memory costs each scheme.

* FFT overtakes direct sums at some thousand steps, modes overtake both, and their storage does not
  grow.
* With modes, time a step at N = 1e5 is at most 2 times that of the same march without memory for
  explicit schemes. It is at most 1.5 times for implicit ones.
"""

import statistics

import numpy as np
from _study import Claim, chosen, curves, study

import hereditary as hd

HISTORIES = {"direct": hd.Direct(), "fft": hd.FFT(), "modes": hd.SumOfExponentials(1e-10)}
LARGEST = {"direct": 32_000, "fft": 10**6, "modes": 10**6}


def force(t, y, dy, params):
    """A nonlinear right-hand side of the usual cost."""
    dy[0] = -y[0] - np.sin(3 * y[0]) + np.cos(t)


def pair(scheme):
    """The equation a scheme is timed on, with memory and without."""
    if isinstance(scheme, hd.ExplicitCaputo):
        orders = (1.8, 2.0)
        return [hd.Equation(hd.Caputo(a), force, [0.2, 0.3]) for a in orders], 2.0
    bound = 2.0 if isinstance(scheme, hd.Adams) else 1.5
    return [hd.Equation(hd.Caputo(a), force, 0.2) for a in (0.8, 1.0)], bound


SCHEMES = [
    hd.ExplicitCaputo(),
    hd.L1(),
    hd.L2(),
    hd.L2Sigma(),
    hd.BDF(2),
    hd.BDF(6),
    hd.Adams(),
    hd.ProductTrapezoid(),
]


def seconds(equation, n, scheme, history, repeats):
    how = {"scheme": scheme, "history": history, "save_every": n, "estimate": False}
    runs = [hd.solve(equation, 1e-3 * n, n, **how) for _ in range(repeats + 1)]
    return statistics.median(run.stats["run_seconds"] for run in runs[1:]), runs[0]


def measure_histories(quick):
    equation = hd.scenes.stick_slip()
    rows = []
    for name, history in HISTORIES.items():
        n = 1000
        while n <= (8000 if quick else LARGEST[name]):
            spent, run = seconds(equation, n, hd.ExplicitCaputo(), history, 3)
            rows.append(
                {
                    "what": name,
                    "n_steps": n,
                    "seconds": f"{spent:.4g}",
                    "bytes": run.stats["history_bytes"],
                    "ratio": "",
                    "bound": "",
                }
            )
            n *= 2
    return rows


def measure_schemes(quick):
    rows = []
    for scheme in SCHEMES:
        n = 10**4 if quick else 10**5
        (with_memory, without), bound = pair(scheme)
        times = [
            seconds(equation, n, scheme, hd.SumOfExponentials(1e-10), 7)[0]
            for equation in (with_memory, without)
        ]
        rows.append(
            {
                "what": repr(scheme),
                "n_steps": n,
                "seconds": f"{times[0]:.4g}",
                "bytes": "",
                "ratio": f"{times[0] / times[1]:.3f}",
                "bound": bound,
            }
        )
    return rows


def measure(quick):
    return measure_histories(quick) + measure_schemes(quick)


def claims(rows):
    for row in rows:
        if row["ratio"] != "":
            kind = row["what"] if row["bound"] == 2 else "implicit schemes"
            text = f"times the march without memory, {kind}"
            yield Claim(text, row["ratio"], row["bound"], where=row["what"])
    spent = {row["what"]: row["seconds"] for row in chosen(rows, n_steps=8000.0)}
    for one, other in (("modes", "fft"), ("fft", "direct")):
        yield Claim(f"time of {one} over {other}, N = 8,000", spent[one] / spent[other], 1)


if __name__ == "__main__":
    draw = curves("n_steps", "seconds", ("what",))
    study(measure, claims, lambda rows: draw([row for row in rows if row["bytes"] != ""]))
