"""Jumps, changes, events and ends at one time act once, and runs are exact.

Random relaxations ``D^alpha y = u(t) - k y`` whose u jumps between 1 and -1. Within two units of
rounding of a jump there are one or several others. They are a break, a zero of a switch, a change,
an event, the end of the run. Changes are at a stated time or by an event. Solutions are sums of
Mittag-Leffler functions: each jump of u and each change of y adds one.
"""

from collections import Counter

import matplotlib.pyplot as plt
import numpy as np
from _study import Claim, study

import hereditary as hd

RTOL, EPS = 1e-7, np.finfo(float).eps
# Half a period of u, and its phase.
WAVES = ((0.7, 0.3), (1.1, 0.0), (0.35, 0.1), (1.3, 0.4), (0.6283185307, 0.2))
DOSE = 0.5


def by_floor(t, y, p):  # numbers: k, half a period, phase, whether u jumps at all
    return (1.0 - 2.0 * (np.floor((t + p[2]) / p[1]) % 2)) * p[3] - p[0] * y


def by_sine(t, y, p):
    return np.sign(np.sin((t + p[2]) * np.pi / p[1])) * p[3] - p[0] * y


def switch_of(half, phase):
    def switch(t, y):
        return np.sin((t + phase) * np.pi / half)

    return switch


SWITCHES = [switch_of(*wave) for wave in WAVES]
KINDS = ("break", "switch", "change", "changing event", "event", "end", "start")


class Problem:
    """A random problem: its run, its exact solution, and how often each thing is to act."""

    def __init__(self, seed):
        rng = np.random.default_rng([20261125, seed])
        self.alpha, self.k = rng.uniform(0.3, 1.0), rng.uniform(0.3, 3.0)
        wave = rng.integers(len(WAVES))
        self.half, phase = WAVES[wave]
        self.start = round(rng.uniform(-2, 2), 2) if rng.random() < 0.4 else 0.0
        first = np.floor((self.start + phase) / self.half) + 1
        number = first + np.arange(5)
        self.jumps = number * self.half - phase
        self.jumps = self.jumps[self.jumps > self.start + 1e-6]
        self.chosen = int(rng.integers(1, 3))
        self.time = self.jumps[self.chosen]
        self.kinds = set(rng.choice(KINDS[:6], rng.integers(2, 5), replace=False))
        if not self.kinds & {"break", "switch"}:
            self.kinds.add("break")
        self.offset = {kind: self._near(rng) for kind in KINDS}
        self.end = self.offset["end"] if "end" in self.kinds else self.jumps[3] + 0.4 * self.half
        self.u0 = (-1.0) ** np.floor((self.start + phase) / self.half)
        self.y0 = rng.uniform(-1, 1)
        self.switch = SWITCHES[wave]
        force = by_floor if "switch" not in self.kinds and rng.random() < 0.7 else by_sine
        params = [self.k, self.half, phase, 1.0]
        self.equation = hd.Equation(
            hd.Caputo(self.alpha), force, self.y0, params, t_start=self.start
        )
        self.calls = Counter()

    def _near(self, rng):
        """Return a time within two units of rounding of the jump."""
        return float(self.time + rng.integers(-2, 3) * np.spacing(abs(self.time)))

    def _adding(self, name):
        def change(t, y):
            self.calls[name] += 1
            return y + DOSE

        return change

    def _zero_at(self, time):
        return lambda t, y: t - time

    def solve(self):
        """Return the run."""
        how, events = {}, []
        if "break" in self.kinds:
            breaks = self.jumps.copy()
            breaks[self.chosen] = self.offset["break"]
            how["breaks"] = breaks
        if "switch" in self.kinds:
            how["switches"] = self.switch
        if "change" in self.kinds:
            how["changes"] = {self.offset["change"]: self._adding("change")}
        for kind in ("changing event", "event"):
            if kind in self.kinds:
                event = self._zero_at(self.offset[kind])
                if kind == "changing event":
                    event.change = self._adding(kind)
                events.append(event)
        return hd.solve(self.equation, self.end, rtol=RTOL, events=events or None, **how)

    def exact(self, t):
        """Return the solution at times t, (k,), off the jumps."""
        relax = hd.exact.relaxation(self.alpha, self.k)

        def mode(since):
            return np.where(t > since, relax(np.maximum(t - since, 0.0))[:, 0], 0.0)

        def step(since):
            return np.where(t > since, (1 - mode(since)) / self.k, 0.0)

        y, u = self.y0 * mode(self.start) + self.u0 * step(self.start), self.u0
        for time in self.jumps:
            y, u = y - 2 * u * step(time), -u
        n_doses = len(self.kinds & {"change", "changing event"})
        return y + n_doses * DOSE * mode(self.time)

    def verdict(self, sol):
        """Return the error in tolerances, and what is wrong, in a word."""
        off = np.abs(sol.t[:, None] - self.jumps).min(axis=1) > 1e-7
        off &= sol.t - self.start > 1e-9
        exact = self.exact(sol.t[off])
        error = np.abs(sol.y[off, 0] - exact).max() / (RTOL * np.abs(exact).max())
        if not sol.success:
            return error, sol.status.name
        acted = all(self.calls[kind] == 1 for kind in self.kinds & {"change", "changing event"})
        # an event at the very end, or a unit of rounding beyond it, may pass unseen
        n_events = sum(kind in self.kinds for kind in ("changing event", "event"))
        seen = sum(times.size for times in sol.t_events)
        if "end" in self.kinds:
            acted, seen = True, n_events
        if not acted or seen != n_events:
            return error, "NOT ONCE"
        return error, "" if error < 1 else "WRONG"


def measure(quick):
    for seed in range(40 if quick else 400):
        problem = Problem(seed)
        error, wrong = problem.verdict(problem.solve())
        kinds = " + ".join(sorted(problem.kinds))
        yield {"seed": seed, "alpha": round(problem.alpha, 3), "kinds": kinds, "error": error,
               "wrong": wrong}  # fmt: skip


def claims(rows):
    wrong = sum(row["wrong"] != "" for row in rows)
    yield Claim("runs that end early, act twice or err", wrong, 0, small=True)
    worst = max(row["error"] for row in rows)
    yield Claim("largest error, in tolerances", worst, 1, small=True)


def draw(rows):
    fig, ax = plt.subplots(figsize=(6, 4), layout="constrained")
    ax.hist(np.log10([max(r["error"], 1e-8) for r in rows]), 40, color="#0072B2")
    ax.set(xlabel="log10 of the error in tolerances", ylabel="runs")
    return fig


if __name__ == "__main__":
    study(measure, claims, draw)
