"""Time and memory of large systems grow with the entries of their Jacobian.

``D^0.7 u = u_xx`` by the method of lines on d inner points of [0, 1], u(0) = sin(pi x) + sin(3 pi
x). To T = 1, against the exact solution of the discrete system:

* `Collocation` at rtol 1e-10, dense and banded, keeps its tolerance;
* `BDF(2)` with 1,000 steps, dense and banded, is as accurate as one equation is;
* L1 with the full history in NumPy and SciPy's `solve_banded`, as it is written by hand;
* the plane, m**2 components, by `BDF(2)` and SuperLU.

The linear algebra of a dense run of `Collocation` is timed by itself as well, in CPU seconds. It
uses one Hessenberg form for all lengths of steps. LAPACK's complex LU factors are the other way.

Where the entries of the Jacobian are stated a step takes a time in proportion to d.
"""

import time
from functools import partial

import numba
import numpy as np
import scipy.sparse as sp
from _study import Claim, chosen, curves, fastest, in_turns, study
from scipy.linalg import lapack, solve_banded
from scipy.special import gamma

import hereditary as hd
from hereditary.collocation.equations import integral_form
from hereditary.collocation.operators import FORCE
from hereditary.collocation.quadrature import radau_integrals
from hereditary.collocation.stage_solver import stage_solver
from hereditary.collocation.structures import REDUCED, STAGES, SYSTEMS
from hereditary.compiled.reference import by_reference
from hereditary.compiled.signatures import FACTORISE, SUBSTITUTE
from hereditary.exact import mittag_leffler

ALPHA, STEPS = 0.7, 1000
# Jacobians, lengths of steps and iterations of ``D^0.7 u = u_xx - u^3`` to T = 1 at rtol 1e-4,
# counted for d = 20, 60 and 200.
JACOBIANS, LENGTHS, ITERATIONS = 2, 12, 90


def laplacian(d):
    ones = np.ones(d - 1)
    parts = [ones, -2 * np.ones(d), ones]
    return (sp.diags_array(parts, offsets=[-1, 0, 1]) * (d + 1.0) ** 2).tocsr()


def plane(m):
    one = laplacian(m)
    return (sp.kron(one, sp.eye_array(m)) + sp.kron(sp.eye_array(m), one)).tocsr()


def waves(d):
    """Two eigenvectors, and their rates."""
    places, numbers = np.arange(1, d + 1) / (d + 1), np.array([1, 3])
    rates = 4 * (d + 1) ** 2 * np.sin(numbers * np.pi / (2 * d + 2)) ** 2
    return np.sin(np.pi * np.outer(numbers, places)), rates


def exact(rates, parts):
    return sum(mittag_leffler(-r, ALPHA, 1.0) * part for r, part in zip(rates, parts, strict=True))


def by_hand(d):
    """L1 with the full history in NumPy."""
    h, u = 1.0 / STEPS, np.empty((STEPS + 1, d))
    u[0] = waves(d)[0].sum(axis=0)
    weights = np.diff(np.arange(STEPS + 1.0) ** (1 - ALPHA)) * h**-ALPHA / gamma(2 - ALPHA)
    bands = np.zeros((3, d))
    bands[0, 1:] = bands[2, :-1] = -((d + 1.0) ** 2)
    bands[1] = weights[0] + 2 * (d + 1.0) ** 2
    for n in range(1, STEPS + 1):
        past = weights[1:n][::-1] @ np.diff(u[:n], axis=0) if n > 1 else 0.0
        u[n] = solve_banded((1, 1), bands, weights[0] * u[n - 1] - past)
    return u[-1], {"history_bytes": u.nbytes}


def solved(d, how, scheme):
    matrix = laplacian(d) if how == "banded" else laplacian(d).toarray()
    equation = hd.Equation(hd.Caputo(ALPHA), None, waves(d)[0].sum(axis=0), linear=matrix)
    steps = {"rtol": 1e-10} if scheme is None else {"n_steps": STEPS, "scheme": scheme}

    def run():
        sol = hd.solve(equation, 1.0, save_every=STEPS, estimate=False, **steps)
        return sol.y[-1], sol.stats

    return run


def measure(quick):
    few, some = ([3, 20], [11, 50]) if quick else ([3, 10, 40, 100, 200, 500], [11, 40, 100, 500])
    cases = [("Collocation", "dense", d, None) for d in few]
    cases += [("Collocation", "banded", d, None) for d in some + ([] if quick else [1000, 5000])]
    cases += [("BDF(2)", "dense", d, hd.BDF(2)) for d in few]
    cases += [("BDF(2)", "banded", d, hd.BDF(2)) for d in some]
    cases += [
        ("BDF(2)", "banded", d, hd.BDF(2)) for d in ([] if quick else [10**3, 10**4, 10**5, 10**6])
    ]
    cases += [("L1 by hand", "banded", d, None) for d in ([20] if quick else [11, 100, 1000])]
    for scheme, how, d, given in cases:
        run = (lambda d=d: by_hand(d)) if scheme == "L1 by hand" else solved(d, how, given)
        times = 1 if quick else 3
        seconds, (found, stats) = fastest(run, times, within=5, warm=d < 10**5)  # compiles
        parts, rates = waves(d)
        yield row(scheme, how, d, seconds, np.abs(found - exact(rates, parts)).max(), stats)
    for d in [20] if quick else [20, 60, 100, 200]:
        seconds = linear_algebra(d)
        text, least = (
            "complex LU factors over one Hessenberg form, CPU time",
            1.5 if d > 60 else -np.inf,
        )
        yield Claim(
            f"{text}, {d} components", seconds["LU"] / seconds["Hessenberg"], at_least=least
        )
    m = 12 if quick else 256
    wave, rate = waves(m)[0][0], waves(m)[1][0]
    start = np.outer(wave, wave).ravel()
    equation = hd.Equation(hd.Caputo(ALPHA), None, start, linear=plane(m))
    how = {"scheme": hd.BDF(2), "save_every": STEPS, "estimate": False}
    call = partial(hd.solve, equation, 1.0, STEPS, **how)
    seconds, sol = fastest(call, 1, warm=False)
    error = np.abs(sol.y[-1] - exact([2 * rate], [start])).max()
    yield row("BDF(2)", "plane", m * m, seconds, error, sol.stats)


@numba.njit(error_model="numpy")
def dense_run(solver, given, stages):
    """Make the linear algebra of a run by a compiled solver."""
    for k in range(LENGTHS):
        if k < JACOBIANS:
            stages.control[REDUCED] = 0.0
        solver(FACTORISE, given, stages)
    for _ in range(ITERATIONS):
        solver(SUBSTITUTE, given.copy(), stages)


def linear_algebra(d, s=8):
    """Return the CPU seconds of a dense run's linear algebra, in both ways."""
    equation = hd.Equation(hd.Caputo(ALPHA), None, np.ones(d), linear=laplacian(d).toarray())
    solver, stages, _ = stage_solver(None, integral_form(equation.system), s)
    stages.matrices[0, FORCE] = 0.1**ALPHA * radau_integrals(s, ALPHA)
    stages.integral[:] = 0.1 * radau_integrals(s, 1.0)
    stages.jacobians[0] = jacobian = laplacian(d).toarray()
    work, given = by_reference(stages, STAGES), np.random.default_rng(0).normal(size=(d, s))

    def hessenberg():
        dense_run(solver, given, work)

    def complex_lu():
        shifts, one = stages.shifts[: int(stages.control[SYSTEMS])], np.eye(d)
        for _ in range(LENGTHS):
            factors = [lapack.zgetrf(one - shift * jacobian)[:2] for shift in shifts]
        for _ in range(ITERATIONS):
            for factor in factors:
                lapack.zgetrs(*factor, right)

    right = given[:, 0] + 0j
    hessenberg()
    return in_turns({"Hessenberg": hessenberg, "LU": complex_lu}, 9, time.process_time)


def row(scheme, how, d, seconds, error, stats):
    return {
        "scheme": scheme,
        "jacobian": how,
        "d": d,
        "ms": f"{1e3 * seconds:.3g}",
        "error": f"{error:.2g}",
        "MB": f"{stats['history_bytes'] / 1e6:.3g}",
        "factorised": stats.get("n_factorised", ""),
    }


def claims(rows):
    for scheme, limit, how in (("Collocation", 1e-10, "rtol 1e-10"), ("BDF(2)", 1e-6, "N = 1,000")):
        for row in chosen(rows, scheme=scheme):
            where = {"where": f"{row['d']:g} {row['jacobian']}", "small": True}
            yield Claim(f"error of {scheme}, {how}", row["error"], limit, **where)
    banded = {row["d"]: row["ms"] for row in chosen(rows, scheme="BDF(2)", jacobian="banded")}
    sizes = (1_000_000, 1000)
    if set(sizes) <= banded.keys():
        growth = banded[sizes[0]] / banded[sizes[1]] / 1000
        yield Claim("time of a component of 1e6 over that of 1e3, BDF(2)", growth, 3)
    for scheme, d in (("Collocation", 100), ("Collocation", 1000), ("Collocation", 5000),
                      ("BDF(2)", 1000), ("BDF(2)", 100_000)):  # fmt: skip
        for row in chosen(rows, scheme=scheme, jacobian="banded", d=d):
            yield Claim(f"{scheme}, {d:,} banded components [ms]", row["ms"])


if __name__ == "__main__":
    draw = curves("d", ("ms", "MB"), ("scheme", "jacobian"))
    study(measure, claims, draw)
