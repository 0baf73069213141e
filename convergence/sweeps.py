"""A sweep costs nearly nothing beside its points, and uses both of two cores.

Points of about 5 ms (the stick-slip oscillator, T 100, 60,000 steps) in a sweep on one thread take
at most 1.05 times what a plain loop over the same points takes, with a store too. Two worker
processes gain on points of all kinds at least 0.85 times what they gain on plain Python that
shares nothing, which is what two cores of the machine give; two threads at least 0.7 times as much
on points that are mostly marched, exponents among them.

Times are the best of many repeats, taken in turns; worker processes were started before. Where the
machine has no second core to give, gains are not judged.
"""

import itertools
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from _study import Study, check

import hereditary as hd

T_END = 100.0
OVERHEAD_MAX, PROCESSES_MIN, THREADS_MIN = 1.05, 0.85, 0.7
# One run of the explicit scheme for each point.
PLAIN = {"scheme": hd.ExplicitCaputo(), "verify": False}
# A second core that is shared with others' work gives less.
FREE = 1.6


def python(b):
    return sum(b * k for k in range(60_000))


def solve_60_000(b):
    return hd.solve(hd.scenes.stick_slip(spring_speed=b), T_END, 60_000, save_every=1000).y[-1, 0]


def solve_200_000(b):
    return hd.solve(hd.scenes.stick_slip(spring_speed=b), T_END, 200_000, save_every=1000).y[-1, 0]


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
        best = dict.fromkeys(itertools.product(SIZES, chosen), np.inf)
        for _ in range(repeats):
            for function, name in best:
                began = time.perf_counter()
                chosen[name](function, values[function])
                spent = time.perf_counter() - began
                best[function, name] = min(best[function, name], spent)
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


def judge(rows, quick):
    gains = {(row["point"], row["way"]): row["gain"] for row in rows}
    for way in ("one thread", "one thread, store"):
        cost = 1 / gains["solve_60_000", way]
        statement = f"{way}: {cost:.3f} times a loop, points of 5 ms (at most {OVERHEAD_MAX})"
        check(statement, cost <= OVERHEAD_MAX, quick)
    cores = gains["python", "two processes"]
    if cores < FREE:
        print(f"gains not judged: the machine gives only {cores:.2f} cores now")
        return
    ours = {function: PROCESSES_MIN for function in SIZES if function is not python}
    bounds = {"two processes": ours, "two threads": MARCHED}
    for way, least in bounds.items():
        for function, share in least.items():
            gain = gains[function.__name__, way]
            statement = (
                f"{function.__name__}, {way}: gain {gain:.2f} (at least {share * cores:.2f})"
            )
            check(statement, gain >= share * cores, quick)


def draw(rows):
    figure, ax = plt.subplots(figsize=(8, 4), layout="constrained")
    points = list(dict.fromkeys(row["point"] for row in rows))
    names = list(dict.fromkeys(row["way"] for row in rows if row["way"] != "loop"))
    x = np.arange(len(points))
    for k, name in enumerate(names):
        heights = [row["gain"] for row in rows if row["way"] == name]
        bars = ax.bar(x + 0.2 * (k - 1.5), heights, 0.18, label=name)
        ax.bar_label(bars, [f"{gain:.2f}" for gain in heights], fontsize=8)
    loops = [row["ms_a_point"] for row in rows if row["way"] == "loop"]
    labels = [
        f"{point.replace('_', ', N = ', 1).replace('_', ',')}\n{ms:.3g} ms a point"
        for point, ms in zip(points, loops, strict=True)
    ]
    ax.set_xticks(x, labels, fontsize=8)
    ax.axhline(1, color="grey", linewidth=0.8)
    ax.axhline(2, color="grey", linewidth=0.8, linestyle=":")
    ax.set(ylabel="times as fast as a loop", title="Sweeps over stick-slip, two cores")
    ax.set_ylim(0, 2.5)
    ax.legend(ncols=4, fontsize=8, loc="upper center")
    return figure


def main():
    study = Study(__file__, __doc__)
    study.write(measure(study.quick))
    rows = study.read()
    judge(rows, study.quick)
    study.save(draw(rows))


if __name__ == "__main__":
    main()
