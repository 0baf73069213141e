"""A sweep costs almost no time in addition to its points, and uses both of two cores.

Points of about 5 ms are the stick-slip oscillator, T 100, 60,000 steps. A sweep of them on one
thread takes at most 1.05 times as long as a plain loop over them, with a store too. The gain of two
worker processes on plain Python without shared data is the gain of two cores. For points of all
kinds two processes gain at least 0.85 times as much. Two threads gain at least 0.7 times as much if
a point is mostly compiled time stepping, as for exponents.

Times are the best of many repeats, taken in turns; worker processes were started before. Where the
machine has no second core to give, gains are not judged.
"""

import itertools
import tempfile
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from functools import partial
from pathlib import Path

import numpy as np
from _study import Claim, bars, in_turns, study

import hereditary as hd

T_END = 100.0
OVERHEAD_MAX, PROCESSES_MIN, THREADS_MIN = 1.05, 0.85, 0.7
# One run of the explicit scheme for each point.
PLAIN = {"scheme": hd.ExplicitCaputo(), "verify": False}
# A second core that is shared with others' work gives less.
FREE = 1.6


def python(b):
    return sum(b * k for k in range(60_000))


def last_row(b, n_steps):
    how = {"save_every": 1000, "estimate": False}
    return hd.solve(hd.scenes.stick_slip(spring_speed=b), T_END, n_steps, **how).y[-1, 0]


def solve_60_000(b):
    return last_row(b, 60_000)


def solve_200_000(b):
    return last_row(b, 200_000)


def lyapunov_20_000(b):
    equation = hd.scenes.stick_slip(beta=2.0, gamma=1.0, spring_speed=b)
    return hd.lyapunov(equation, T_END, 20_000, **PLAIN).exponents[0]


def lyapunov_400_000(b):
    equation = hd.scenes.stick_slip(spring_speed=b)
    return hd.lyapunov(equation, T_END, 400_000, **PLAIN).exponents[0]


# points in a sweep: a sweep takes some 0.2 s, and a repeat of all of them 4 s
SIZES = {
    python: 32,
    solve_60_000: 32,
    solve_200_000: 12,
    lyapunov_20_000: 10,
    lyapunov_400_000: 4,
}
MARCHED = dict.fromkeys([solve_60_000, solve_200_000, lyapunov_400_000], THREADS_MIN)


def ways(folder, pools):
    """How the same points are computed: name -> callable of function and values."""
    number = itertools.count()

    def loop(function, values):
        return np.array([function(b) for b in values.tolist()])

    def swept(executor, stored=False):
        def run(function, values):
            store = folder / f"{next(number)}" if stored else None
            table = hd.sweep(function, {"b": values}, executor, store)
            if not table.success.all():
                raise RuntimeError(f"{function.__name__}: {table.status}")
            return table["value"]

        return run

    return {
        "loop": loop,
        "one thread": swept(pools["one thread"]),
        "one thread, store": swept(pools["one thread"], stored=True),
        "two threads": swept(pools["two threads"]),
        "two processes": swept(pools["two processes"]),
    }


def measure(quick):
    """Rows for every kind of point and way, all with the same results."""
    rows, repeats = [], 2 if quick else 40
    with (
        ProcessPoolExecutor(2) as processes,
        ThreadPoolExecutor(1) as one,
        ThreadPoolExecutor(2) as two,
        tempfile.TemporaryDirectory() as folder,
    ):
        pools = {"one thread": one, "two threads": two, "two processes": processes}
        chosen = ways(Path(folder), pools)
        values = {f: np.linspace(0.5, 4.5, 2 if quick else n) for f, n in SIZES.items()}
        for function, points in values.items():
            # compiled, and worker processes ready, before anything is timed
            first = {name: way(function, points) for name, way in reversed(chosen.items())}
            if any(not np.array_equal(found, first["loop"]) for found in first.values()):
                raise RuntimeError(f"{function.__name__}: {first}")
        calls = {
            (function, name): partial(way, function, points)
            for function, points in values.items()
            for name, way in chosen.items()
        }
        best = in_turns(calls, repeats)
    for (function, name), seconds in best.items():
        rows.append(
            {
                "point": function.__name__,
                "way": name,
                "ms_a_point": f"{seconds / values[function].size * 1e3:.3g}",
                "gain": f"{best[function, 'loop'] / seconds:.3f}",
            }
        )
    return rows


def claims(rows):
    gains = {(row["point"], row["way"]): row["gain"] for row in rows}
    for way in ("one thread", "one thread, store"):
        cost = 1 / gains["solve_60_000", way]
        yield Claim(f"{way}, times a loop, points of 5 ms", cost, OVERHEAD_MAX)
    cores = gains["python", "two processes"]
    yield Claim("cores that the machine gave", cores)
    if cores < FREE:
        print(f"gains not judged: the machine gives only {cores:.2f} cores now")
        return
    ours = {function: PROCESSES_MIN for function in SIZES if function is not python}
    for way, least in {"two processes": ours, "two threads": MARCHED}.items():
        for function, share in least.items():
            gain, text = gains[function.__name__, way], f"gain of {way} over that of two cores"
            yield Claim(text, gain / cores, at_least=share, where=function.__name__)
            yield Claim(f"gain of {way}", gain)


if __name__ == "__main__":
    draw = bars("gain", ("point", "way"), title="Times as fast as a loop, stick-slip, two cores")
    study(measure, claims, draw)
