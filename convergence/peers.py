"""Error against time, compared with other codes on thirteen problems with known solutions.

* `Collocation` gets below 1e-9 on each. For errors from 1e-5 down pycaputo takes at least ten times
  as long, as far as it gets.
* At order 1 SciPy's DOP853 takes at least 1.2 times as long for errors from 1e-7 down (van der Pol,
  mu = 1). LSODA takes 0.7 times. With mu = 100 Radau takes 4 times, LSODA 1.2 times from 1e-5 down.
* Methods of the published figures repeat the published errors, so that only their times are
  another machine's.

Milliseconds are those of a whole call, the fastest of several after one that warms up. Runs of half
a second and more are made once. Compiling is not counted. Rows of "fresh process" count it, of
whole processes with an empty cache and with a full one. Errors of P4 to P6 and van der Pol are
those at the end, all others the largest over the mesh.

pycaputo, SciPy (order 1) and Octave codes (in a folder named by HEREDITARY_OCTAVE_CODES) run where
they are found. Docs: docs/benchmark.md.
"""

import os
import subprocess
import sys
import tempfile
import time
import warnings
from functools import partial

import numpy as np
from _peer_codes import by_octave, by_pycaputo, by_scipy, published, told_absent
from _peer_problems import problems
from _study import Claim, chosen, curves, fastest, study
from work_precision import ENDED_EARLY, HISTORY, covered

import hereditary as hd

PROCESSES = {
    "hereditary ExplicitCaputo": "import hereditary as hd; "
    "hd.solve(hd.Equation(hd.Caputo(0.5), lambda t, y: -y, 1.0), 5.0, 1000)",
    "hereditary Collocation": "import hereditary as hd; "
    "hd.solve(hd.Equation(hd.Caputo(0.5), lambda t, y: -y, 1.0), 5.0, rtol=1e-6)",
    "SciPy DOP853": "from scipy.integrate import solve_ivp; "
    "solve_ivp(lambda t, y: -y, (0.0, 5.0), [1.0], method='DOP853', rtol=1e-6)",
}
PROCESS = "fresh process"
OTHERS = ("pycaputo", "SciPy", "Octave")


def row(problem, code, setting, error, milliseconds, told=""):
    return {
        "problem": problem,
        "code": code,
        "setting": setting,
        "error": f"{error:.2e}",
        "ms": f"{milliseconds:.3g}",
        "published": told,
    }


def best(call, quick, warm):
    """Milliseconds of the fastest of several calls, and what the last one gave.

    `warm` says that an earlier, shorter run has warmed it up: a long one is then run once.
    """
    seconds, found = fastest(call, 1, warm=False)
    if not (warm and seconds > 0.5):
        seconds, found = fastest(call, 1 if quick else 7, within=0.4, warm=False)
    return 1e3 * seconds, found


def own_calls(problem, quick):
    """Yield this library's ways: a tolerance, then given steps."""
    for digits in (4, 8) if quick else (3, 4, 6, 8, 10, 12):
        solve = partial(hd.solve, problem.equation, problem.t_end, rtol=10.0**-digits)
        yield "Collocation", f"rtol=1e-{digits:02}", solve
    for scheme in problem.schemes:
        name = repr(scheme).replace("L2()", "L2").replace("ExplicitCaputo()", "ExplicitCaputo")
        graded = name == "L2"
        if graded and not covered(
            scheme, scheme.mesh_plan, problem.equation, np.linspace(0, 1e-2, 11)
        ):
            continue
        for n in problem.counts[:2] if quick else problem.counts:
            how = {"n_steps": n, "estimate": False}
            if graded:
                mesh = hd.graded(n, scheme.order(problem.alpha) / problem.alpha)
                how = {"mesh": mesh, "estimate": False}
            solve = partial(hd.solve, problem.equation, problem.t_end, scheme=scheme, **how)
            yield name, f"N={n}", partial(solve, history=HISTORY)


def of_problem(problem, quick):
    """Rows of a problem."""
    name, warm = problem.name, set()
    for code, setting, call in own_calls(problem, quick):
        spent, sol = best(call, quick, code in warm)
        warm.add(code)
        error = np.nan if sol.status in ENDED_EARLY else problem.error(sol.t, sol.y)
        yield row(name, code, setting, error, spent)
    components = sol.y.shape[1]
    for code, setting, call in [*by_pycaputo(problem, quick), *by_scipy(problem, quick)]:
        with np.errstate(all="ignore"):
            spent, (t, y) = best(call, quick, code in warm)
            warm.add(code)
            error = problem.error(t, y[:, :components])
        yield row(name, code, setting, error if error < 1e3 else np.nan, spent)
    for code, n, spent, error in by_octave(problem, quick):
        yield row(name, code, f"N={n}", error, spent)
    for code, n, spent, error, norm, known in published(problem):
        off, where = abs(norm / known - 1), f"{code}, N = {n}"
        yield Claim("published errors, repeated to", off, 0.02, where=where, small=True)
        yield row(name, code, f"N={n}", error, spent, "published, another machine")


def processes(quick):
    """Rows of whole fresh processes, with an empty cache and with a full one."""
    for code, script in PROCESSES.items():
        with tempfile.TemporaryDirectory() as folder:
            environment = os.environ | {"NUMBA_CACHE_DIR": folder}
            own = code.startswith("hereditary") and not quick
            for setting in ("empty cache", "full cache") if own else ("full cache",):
                if quick and code.startswith("hereditary"):
                    continue
                began = time.perf_counter()
                subprocess.run(
                    [sys.executable, "-c", script], env=environment, check=True, capture_output=True
                )
                spent = time.perf_counter() - began
                yield row(PROCESS, code, setting, np.nan, 1e3 * spent)


def least_ratio(rows, problem, code, most):
    """Least time of a code's rows with errors up to `most`, over that of Collocation as accurate.

    Infinite where the code gets no further than that.
    """
    mine = [r for r in rows if r["problem"] == problem and not r["published"]]
    own = [r for r in mine if r["code"] == "Collocation"]
    ratios = [
        r["ms"] / min((c["ms"] for c in own if c["error"] <= r["error"]), default=np.inf)
        for r in mine
        if r["code"].startswith(code) and r["error"] <= most
    ]
    return min(ratios, default=np.inf)


def claims(rows):
    for name in dict.fromkeys(row["problem"] for row in rows if row["problem"] != PROCESS):
        ratio = least_ratio(rows, name, "pycaputo", 1e-5)
        if np.isfinite(ratio):
            text = "errors from 1e-5 down: pycaputo takes times as long"
            yield Claim(text, ratio, at_least=10, where=name)
        own = chosen(rows, problem=name, code="Collocation")
        least = min(row["error"] for row in own)
        yield Claim("smallest error of Collocation", least, 1e-9, where=name)
        enough = [row["ms"] for row in own if row["error"] <= 1e-9]
        yield Claim("time of Collocation below 1e-9 [ms]", min(enough, default=np.nan))
    for mu, code, most, bound in (
        (1, "SciPy DOP853", 1e-7, 1.2),
        (1, "SciPy LSODA", 1e-7, 0.7),
        (100, "SciPy Radau", 1e-3, 4),
        (100, "SciPy LSODA", 1e-5, 1.2),
    ):
        ratio = least_ratio(rows, f"van der Pol {mu}", code, most)
        text = f"van der Pol, mu = {mu}, errors from {most:g} down: {code} takes times as long"
        yield Claim(text, ratio, at_least=bound)
    print_table(rows)


def print_table(rows):
    """Print the fastest row of ours and of the others to three errors, in Markdown."""
    print("| problem | error | ours | ms | others | ms |\n|---|---:|---|---:|---|---:|")
    for name in dict.fromkeys(row["problem"] for row in rows if row["problem"] != PROCESS):
        for most in (1e-3, 1e-6, 1e-9):
            close = [r for r in rows if r["problem"] == name and r["error"] <= most]
            known = [r for r in close if not r["code"].startswith(OTHERS) and not r["published"]]
            found = [r for r in close if r not in known]
            told = [cells(some) for some in (known, found)]
            print(f"| {name} | {most:g} | {told[0]} | {told[1]} |")


def cells(rows):
    """Two cells: code, setting and error, then milliseconds."""
    if not rows:
        return "none | "
    r = min(rows, key=lambda r: r["ms"])
    star = "*" if r["published"] else ""
    setting = str(r["setting"]).replace("N=", "N = ").replace("rtol=", "rtol ")
    return f"{r['code']}{star}, {setting}: {r['error']:.0e} | {r['ms']:.3g}"


def measure(quick):
    told_absent()
    with warnings.catch_warnings():
        # coarse steps are beyond stability limits and of short validity here and there
        warnings.simplefilter("ignore")
        for problem in problems():
            yield from of_problem(problem, quick)
    yield from processes(quick)


def draw(rows):
    titles = {problem.name: problem.title for problem in problems()}
    shown = [
        row | {"title": titles[row["problem"]]}
        for row in rows
        if row["problem"] != PROCESS and row["error"] > 0
    ]
    return curves("ms", "error", ("code",), ("title",))(shown)


if __name__ == "__main__":
    if os.environ.get("OPENBLAS_NUM_THREADS") != "1":
        # of small matrices: with more threads they wait for each other where other work runs beside
        os.environ["OPENBLAS_NUM_THREADS"] = "1"
        os.execv(sys.executable, [sys.executable, *sys.argv])
    study(measure, claims, draw)
