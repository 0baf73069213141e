"""Memory by exponential modes costs less than the rest of the step, and does not grow.

The hereditary stick-slip oscillator (beta 1.8, gamma 0.8, b 1, c 50, T 100) with the explicit
scheme. Claims, all measured in one run because machines are noisy:

* at N = 200,000 the march with memory takes at most 2 times the march of the memoryless
  (classical) equation;
* it is at least 300 times faster than direct sums, extrapolated from N = 20,000 by N**2;
* it deviates from direct sums by less than 1e-8 at N = 20,000 with tolerance 1e-10;
* time a step is flat within 25 % from N = 1e4 to 1e7, and the history's bytes are the same.
"""

import statistics

import numpy as np
from _study import Claim, chosen, curves, study

import hereditary as hd

T_END = 100.0
N_MAIN, N_DIRECT = 200_000, 20_000


def march_seconds(equation, n, history, repeats):
    """Median run time of a march that keeps a thousand rows, and its last solution."""
    runs = []
    for _ in range(repeats):
        how = {"history": history, "save_every": max(1, n // 1000), "estimate": False}
        sol = hd.solve(equation, T_END, n, **how)
        runs.append(sol.stats["run_seconds"])
    return statistics.median(runs), sol


def measure(quick):
    """Rows for modes, direct sums and no memory over a range of N."""
    hereditary = hd.scenes.stick_slip()
    classical = hd.scenes.stick_slip(beta=2.0, gamma=1.0)
    largest = 10**5 if quick else 10**7
    counts = [n for n in (10**4, 10**5, N_MAIN, 10**6, 10**7) if n <= max(largest, N_MAIN)]
    rows = []
    for name, equation, history, sizes in (
        ("modes", hereditary, hd.SumOfExponentials(1e-10), counts),
        ("no memory", classical, hd.SumOfExponentials(1e-10), counts),
        ("direct", hereditary, hd.Direct(), [5000, 10_000, N_DIRECT]),
    ):
        march_seconds(equation, 1000, history, 1)  # compiled before it is timed
        for n in sizes:
            seconds, sol = march_seconds(equation, n, history, 3 if n > 10**6 else 9)
            rows.append(
                {
                    "history": name,
                    "n_steps": n,
                    "seconds": f"{seconds:.4g}",
                    "ns_per_step": f"{seconds / n * 1e9:.1f}",
                    "modes": sol.stats["n_modes"],
                    "bytes": sol.stats["history_bytes"],
                }
            )
    return [*rows, Claim("deviation from direct sums", deviation(), 1e-8, small=True)]


def deviation():
    """Largest difference between modes and direct sums over all times at N = 20,000."""
    equation = hd.scenes.stick_slip()
    fast = hd.solve(equation, T_END, N_DIRECT, history=hd.SumOfExponentials(1e-10))
    direct = hd.solve(equation, T_END, N_DIRECT, history=hd.Direct())
    return float(np.abs(fast.y - direct.y).max())


def claims(rows):
    time_of = {(row["history"], row["n_steps"]): row["seconds"] for row in rows}
    mine = chosen(rows, history="modes")
    per_step = [row["ns_per_step"] for row in mine]
    modes = time_of["modes", N_MAIN]
    yield Claim("seconds of the march with memory, N = 200,000", modes)
    ratio = modes / time_of["no memory", N_MAIN]
    yield Claim("times the march without memory", ratio, 2)
    gain = time_of["direct", N_DIRECT] * (N_MAIN / N_DIRECT) ** 2 / modes
    yield Claim("times as fast as direct sums, N = 200,000", gain, at_least=300)
    yield Claim("time a step varies by", max(per_step) / min(per_step) - 1, 0.25)
    stored = {row["bytes"] for row in mine}
    yield Claim("different bytes of the history", len(stored), 1, small=True)
    yield Claim("bytes of the history", max(stored))


if __name__ == "__main__":
    study(measure, claims, curves("n_steps", "seconds", ("history",)))
