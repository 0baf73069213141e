"""No success is beyond its tolerance, and no run ends early without a true reason: random problems.

Orders are from 0.01 to 2, a third of them within 1e-2 to 1e-12 of an integer. Rates and ends are
from 1e-8 to 1e8. Equations have one order, several terms, or other orders in each component, also
with Jordan blocks. There are forces, jumps with and without `breaks`, windows of forcing, and jumps
in y that the solution passes or on which it stays. Schemes of given steps are tested for the truth
of their statuses. Exact solutions come from Laplace transforms inverted in extended precision
(_laplace_truth.py). They are repeated by mpmath at the worst time of every run that is found wrong,
and of each tenth other.

Errors of y and y' are taken at t = 0, from 1e-12 of the first step on, at nodes, between them and
around corners. They are relative to rtol times the largest size so far of the component
(_campaign_verdicts.py). For systems and relays this tolerance is multiplied by the growth of
perturbed initial values and forces. Each problem has one of these verdicts:

* ok; wrong success, of y; wrong slope, of y' alone; not seen: a window without `breaks`;
* true status: the run ended early and gives the reason, or it warns of errors as large as y; false
  status: the reason is wrong;
* refused in a sentence; crash; no end within `limit` seconds of processor time; truth unsure.

Each problem is solved twice, the second time with each component in a unit of its own, from 1e-14
to 1e14. A fault there is the problem's verdict.

Problem k of a seed is always the same one. Results go to a file line by line; a run that was
stopped takes up where it was. ``--only k`` shows one problem, as lines to paste.
"""

import json
import multiprocessing as mp
import signal
import tempfile
import time
from collections import Counter
from dataclasses import replace
from multiprocessing.connection import wait
from pathlib import Path

import numpy as np
from _campaign_kinds import SCHEMES, in_units, problem
from _campaign_verdicts import (
    CRASH,
    FALSE,
    NO_END,
    NOT_SEEN,
    OK,
    REFUSED,
    SLOPE,
    TRUE,
    UNSURE,
    WRONG,
    judged,
    measured,
    over_tolerance,
    points,
    truth_error,
)  # fmt: skip
from _study import RESULTS, Claim, chosen, study

import hereditary as hd

VERDICTS = (OK, WRONG, SLOPE, NOT_SEEN, TRUE, FALSE, REFUSED, CRASH, NO_END, UNSURE)
FAULTS = (WRONG, SLOPE, FALSE, CRASH, NO_END)
_CONFIRMED, _SHOWN = 10, 40  # every how many-th truth is asked for twice; rows printed a verdict
# Seed and number of problems that were at fault once, and what they are to be judged now.
ONCE_AT_FAULT = [
    (0, 384, OK),  # y next to t = 0: a tiny order beside orders just above 1
    (0, 313, OK),  # y' there
    (1, 493, OK),  # y there, between the nodes of a tiny order and those of t
    (2, 44, OK),  # y' at t = 0, as the basis shows it
    (0, 188, OK),  # a set of rates that could not be prolonged
    (0, 136, OK),  # a relay at zero told as blown up
    (1, 456, OK),  # y' that may err absolutely by as much as y, for a million units of time
    (3, 36, OK),  # a jump between the start of a step and its first node
    (13, 5057, OK),  # a Jacobian differenced across a jump
    (14, 715, OK),  # a first step that errs by what is much later on, told as a jump
    (20261128, 1613, OK),  # early times of a first step in which y grows by decades
    (20261130, 610, OK),  # a first step in log t, which 24 nodes do not resolve: several terms
    (20261130, 893, OK),  # the same with other orders in each component
    (20261201, 106, OK),  # a first step whose last coefficient is small by chance
    (51127, 921, OK),  # y' next to t = 0, orders 1.00001 and 1
    (20261128, 2790, OK),  # the same with orders 1 + 1e-4 and 1 + 1e-10
    (820111, 410, OK),  # y in a first step at whose start y' jumps by a third of its change
    (51127, 959, TRUE),  # steps of Adams(2) that grow: the run warns of its error
]


def work(pipe, seed, limit):
    """A worker: compiles, then judges one problem after the other, each within a time of its own.

    A signal ends the process where a problem takes more, whatever code it is in.
    """
    for scheme in {"Collocation()", *SCHEMES}:
        how = {"rtol": 1e-6} if scheme == "Collocation()" else {"n_steps": 10}
        hd.solve(hd.scenes.relaxation(0.5), 1.0, **how, scheme=eval(f"hd.{scheme}"))
    pipe.send(None)
    while True:
        k = pipe.recv()
        began = time.perf_counter()
        signal.setitimer(signal.ITIMER_PROF, limit)
        try:
            row = judged_twice(seed, k)
        except Exception as error:  # of the judge: the library's are its verdicts
            row = {"verdict": UNSURE, "message": repr(error), "status": ""}
            row |= {"ratio": 0.0, "slope_ratio": 0.0}
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        pipe.send(row | {"all_seconds": round(time.perf_counter() - began, 2)})


def judged_twice(seed, k):
    """A row on a problem, with the verdict and the steps in drawn units of its components."""
    row = judged(problem(seed, k), confirm=k % _CONFIRMED == 0)
    other = judged(in_units(problem(seed, k), seed, k))
    row |= {f"{name}_in_units": other[name] for name in ("verdict", "steps", "ratio", "message")}
    if row["verdict"] not in FAULTS and other["verdict"] in FAULTS:
        row["verdict"] = other["verdict"]
    return row


class Worker:
    """A process, and the problem it is at: None while it compiles."""

    def __init__(self, seed, limit):
        context = mp.get_context("spawn")
        self.pipe, theirs = context.Pipe()
        self.process = context.Process(target=work, args=(theirs, seed, limit), daemon=True)
        self.process.start()
        theirs.close()
        self.k = None

    def begin(self, k):
        """Send it a problem."""
        self.k = k
        self.pipe.send(k)

    def answer(self):
        """Its row, or what became of the process instead; and whether it is still there."""
        try:
            return self.pipe.recv(), True
        except EOFError:
            self.process.join()
        if self.k is None:
            raise RuntimeError("a worker ended before its first problem")
        late = self.process.exitcode == -signal.SIGPROF
        message = "cut off" if late else f"the process died, {self.process.exitcode}"
        row = {"verdict": NO_END if late else CRASH, "message": message, "status": ""}
        return row | {"ratio": 0.0, "slope_ratio": 0.0}, False


def run(seed, wanted, file, processes, limit):
    """Judge the wanted problems; each row is written as soon as it is known."""
    left = list(wanted)[::-1]
    workers = [Worker(seed, limit) for _ in range(min(processes, len(left)))]
    while workers:
        ready = wait([w.pipe for w in workers])
        for worker in [w for w in workers if w.pipe in ready]:
            row, alive = worker.answer()
            if row is not None:
                row.setdefault("kind", problem(seed, worker.k).kind)
                file.write(json.dumps({"seed": seed, "k": worker.k} | row) + "\n")
                file.flush()
            if alive and left:
                worker.begin(left.pop())
                continue
            worker.process.kill()
            worker.process.join()
            workers.remove(worker)
            if left:
                workers.append(Worker(seed, limit))


def rows_of(path, seed, n):
    """Rows of the first n problems of a seed; a line cut off by a kill is left out."""
    rows = {}
    for line in path.read_text().splitlines() if path.exists() else ():
        try:
            row = json.loads(line)
        except ValueError:
            continue
        if row["seed"] == seed and row["k"] < n:
            rows[row["k"]] = row
    return rows


def table(rows):
    """Counts by kind and verdict, and the largest error over tolerance of runs that are ok."""
    out = []
    for kind in [*sorted({row["kind"] for row in rows}), "all"]:
        mine = [row for row in rows if kind in (row["kind"], "all")]
        counts = Counter(row["verdict"] for row in mine)
        good = [max(row["ratio"], row["slope_ratio"]) for row in mine if row["verdict"] == OK]
        line = {"kind": kind, "problems": len(mine)} | {v: counts[v] for v in VERDICTS}
        out.append(line | {"largest ok": f"{max(good, default=0.0):.2g}"})
    return out


def report_worst(rows, seed):
    """What is at fault, the worst of each verdict first."""
    for verdict in (*FAULTS, NOT_SEEN, TRUE, REFUSED, UNSURE):
        mine = [row for row in rows if row["verdict"] == verdict]
        mine.sort(key=lambda row: -max(row["ratio"], row["slope_ratio"]))
        print(f"\n{verdict}: {len(mine)}", dict(Counter(row["status"] for row in mine)))
        for row in mine[:_SHOWN]:
            print(
                f"  seed {seed}, k {row['k']}: {row['kind']}, {row['status']}, y "
                f"{row['ratio']:.3g}, y' {row['slope_ratio']:.3g}: {row['message'][:110]}"
            )


def judge_claims():
    """Exact solutions against mpmath, and whether the judge sees an error of 3 tolerances."""
    drawn = [problem(0, k) for k in range(20)]
    off = np.array([truth_error(one, 0.7 * one.t_end) for one in drawn])
    known = np.isfinite(off)
    yield Claim("exact solutions off mpmath's", off[known].max(), 1e-13, small=True)
    yield Claim("share of exact solutions compared", known.mean(), at_least=0.7, small=True)
    one, sol = drawn[9], drawn[9].solve()
    moved = replace(one.truth, start=one.truth.start * (1 + 3 * one.rtol))
    right, wrong = (measured(p, sol, False)["ratio"] for p in (one, replace(one, truth=moved)))
    yield Claim("what a run is judged to err by, in tolerances", right, 1, small=True)
    yield Claim("the same with an error of 3 tolerances", wrong, 3.5, 2.5, small=True)
    for seed, k, verdict in ONCE_AT_FAULT:
        differs, where = judged(problem(seed, k))["verdict"] != verdict, f"{k} of seed {seed}"
        yield Claim("problems once at fault, at fault again", differs, 0, where=where, small=True)


def show(seed, k):
    """One problem: as lines to paste, its verdict, and where it is worst."""
    one = problem(seed, k)
    print(one.code(), "\n")
    print({key: value for key, value in judged(one, confirm=True).items() if value != ""})
    sol = one.solve()
    print(sol, sol.stats)
    if one.n_steps is not None or sol.t.size == 1:
        return
    t = points(one, sol)
    for derivative in range(2 if one.truth.orders.max() > 1 else 1):
        ratio = over_tolerance(one, sol, t, derivative).max(axis=1)
        print("y'" if derivative else "y")
        for i in np.argsort(-ratio)[:8]:
            found, right = sol(t[i], derivative), one.solution(t[i : i + 1], derivative)[0]
            print(f"  t = {t[i]:.17g}: {ratio[i]:.3g} tolerances, {found} where right is {right}")
    print("distance of two ways to the exact solution", truth_error(one, float(t[-1])))


def measure(quick, problems, seed, out, processes, limit, only):
    if only >= 0:
        show(seed, only)
        raise SystemExit
    yield from judge_claims()
    n = 20 if quick else problems
    folder = Path(tempfile.mkdtemp()) if quick else RESULTS
    path = Path(out) if out else folder / "campaign.jsonl"
    done = rows_of(path, seed, n)
    with open(path, "a") as file:
        if file.tell() and not path.read_text().endswith("\n"):
            file.write("\n")
        wanted = [k for k in range(n) if k not in done]
        run(seed, wanted, file, 1 if quick else processes, limit)
    rows = list(rows_of(path, seed, n).values())
    report_worst(rows, seed)
    print()
    pairs = [(row.get("steps", 0), row.get("steps_in_units", 0)) for row in rows]
    apart = [abs(one - other) > max(1, 0.03 * one) for one, other in pairs]
    verdicts = sum(row["verdict"] != row.get("verdict_in_units", "") for row in rows)
    for line in table(rows):
        yield line | {"steps apart in units": sum(apart), "verdicts apart in units": verdicts}


def claims(rows):
    (row,) = chosen(rows, kind="all")
    yield Claim("other steps in drawn units, of all problems", row["steps apart in units"])
    yield Claim("other verdicts in drawn units, of all problems", row["verdicts apart in units"])
    yield Claim("problems", row["problems"])
    yield Claim("problems that show a fault", sum(row[v] for v in (*FAULTS, UNSURE)), 0)
    yield Claim("runs that end early for a true reason", row[TRUE])
    yield Claim("problems refused in a sentence", row[REFUSED])
    yield Claim("largest error of a success over its tolerance", row["largest ok"], 1)


if __name__ == "__main__":
    study(measure, claims, problems=10_000, seed=0, out="", processes=2, limit=60.0, only=-1)
