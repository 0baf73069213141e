"""A tangent costs little more than the orbit: one at most 4, two at most 6 times a plain run.

The hereditary stick-slip oscillator (beta 1.8, gamma 0.8, b 1, c 20, T 100) with modes. The claim
is about the explicit scheme at N = 200,000, where one run of `lyapunov` is compared to `solve`
keeping every 1000th row. The second run, which verdicts are compared with by default, costs at most
0.6 of the first one with the default scheme, BDF(2). Shorter runs and other schemes are measured
beside it. Seconds are the processor's for whole calls, the best of several, taken in turns.
"""

import time
from functools import partial

from _study import Claim, bars, in_turns, study

import hereditary as hd

T_END = 100.0
N_MAIN, N_SHORT = 200_000, 20_000
SCHEMES = [hd.ExplicitCaputo(), hd.L1(), hd.BDF(2)]
EXPLICIT, _, USUAL = map(repr, SCHEMES)
PLAIN, ONE, TWO, CHECKED = "plain run", "one tangent", "two tangents", "one, and a second run"
LABELS = (PLAIN, ONE, TWO, CHECKED)
# scheme, run, what it is compared with, and at most how many times as long
CLAIMS = [(EXPLICIT, ONE, PLAIN, 4.0), (EXPLICIT, TWO, PLAIN, 6.0), (USUAL, CHECKED, ONE, 1.6)]


def run(equation, n, label, scheme):
    if label == PLAIN:
        how = {"scheme": scheme, "save_every": 1000, "estimate": False}
        result = hd.solve(equation, T_END, n, **how)
    else:
        k, verify = 1 + (label == TWO), None if label == CHECKED else False
        result = hd.lyapunov(equation, T_END, n, k, scheme=scheme, verify=verify)
    if not result.success or (label == CHECKED and result.check is None):
        raise RuntimeError(f"{scheme} with {n} steps: {result.message}")


def measure(quick):
    """Rows for every scheme, number of steps and number of tangents."""
    # a load whose verdict is certain enough to be compared
    equation = hd.scenes.stick_slip(adhesion=20.0)
    rows = []
    for scheme in SCHEMES:
        for label in LABELS:  # compiled before it is timed
            run(equation, 8000, label, scheme)
        for n in (8000, N_SHORT) if quick else (N_SHORT, N_MAIN):
            repeats = 3 if quick else 10 if n == N_MAIN else 20
            calls = {label: partial(run, equation, n, label, scheme) for label in LABELS}
            best = in_turns(calls, repeats, time.process_time)  # the machine is shared
            for label, spent in best.items():
                rows.append(
                    {
                        "scheme": repr(scheme),
                        "n_steps": n,
                        "run": label,
                        "seconds": f"{spent:.4g}",
                        "ns_per_step": f"{spent / n * 1e9:.0f}",
                        "ratio": f"{spent / best[PLAIN]:.2f}",
                    }
                )
    return rows


def claims(rows):
    # the last rows of a scheme are those of its longest runs
    longest = {(row["scheme"], row["run"]): row["seconds"] for row in rows}
    for scheme, label, other, bound in CLAIMS:
        ratio = longest[scheme, label] / longest[scheme, other]
        yield Claim(f"{scheme}: {label}, times {other}", ratio, bound)


if __name__ == "__main__":
    draw = bars("ns_per_step", ("scheme", "n_steps", "run"), title="Hereditary stick-slip, T = 100")
    study(measure, claims, draw)
