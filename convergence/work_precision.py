"""Error against time: six problems, every scheme that covers them, chosen and given steps.

Seconds are those of a whole warm `hd.solve` call, the fastest of several, with
SumOfExponentials(1e-12) for given steps. Collocation chooses its own by rtol from 1e-3 to 1e-12.

* From 1e-8 down others take at least 1.5 times as long as Collocation on P1 to P5. On P6 BDF(4) is
  as fast down to its smallest error, about 1e-9. Above about 1e-4 other schemes are faster: a call
  of Collocation takes at least 6 ms. On every problem its smallest error is a tenth of any other.
* P1, D^0.5 y = -y: L2 and L2Sigma on graded meshes reach 1e-8 with N = 10,000.
* P3, D^1.5 x + 0.5 D^0.5 x + x = 0: only the schemes for several terms and orders above 1 cover it.
  At t = 20 ExplicitCaputo and L1 fall at their orders 1 and 1.5 in every decade from N = 1,000 to
  1e5. L1 is then at 3e-11, which says nothing of a floor at 1e-12. At N = 1e6 its error is still
  within 1e-12 of what order 1.5 predicts. (BDF(2) falls as h**2 to N = 1e5: tests/test_problems.)

Errors of P1 to P3 are maxima over the mesh, of P4 to P6 at the end. They are taken against values
computed with all of the past (convergence/collocation.py), with which published digits agree. P6 is
the Brusselator of orders 1.3 and 0.8 [GuglielmiHairer2025]. A run that ends early has error nan.
Meshes are graded(n, order / alpha).
"""

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from _study import Claim, chosen, curves, fastest, study
from problems import column, half_order_oscillator, half_order_relaxation
from scipy.special import gamma

import hereditary as hd
from hereditary.analysis.convergence import observed_order

HISTORY = hd.SumOfExponentials(1e-12)
COLLOCATION = hd.Collocation()
SCHEMES = [
    COLLOCATION,
    hd.ExplicitCaputo(),
    hd.L1(),
    hd.L2(),
    hd.L2Sigma(),
    hd.Adams(1),
    hd.Adams(3),
    hd.ProductTrapezoid(),
    hd.BDF(2),
    hd.BDF(4),
]
ENDED_EARLY = (
    hd.Status.BLOWN_UP,
    hd.Status.NOT_SOLVED,
    hd.Status.STEP_TOO_SMALL,
    hd.Status.RHS_FAILED,
)


@dataclass(frozen=True)
class Case:
    """A problem with its highest order, and errors by the name under which they are written."""

    equation: hd.Equation
    t_end: float
    alpha: float
    errors: dict[str, Callable]


def powers(t, y, p):
    """P2: a forcing of four powers of t, less y**1.5.

    y is 0 at the start and an iteration may try values below: those count as 0.
    """
    half = p[3] / 2
    cubed = (1.5 * t**half - t**4) ** 3
    forcing = p[0] * t ** (8 - p[3]) - p[1] * t ** (4 - half) + p[2] + cubed
    return forcing - max(y[0], 0.0) ** 1.5


POWERS = (40320 / gamma(8.5), 3 * gamma(5.25) / gamma(4.75), 2.25 * gamma(1.5), 0.5)


def sum_of_powers(t):
    return column(t**8 - 3 * t**4.25 + 2.25 * t**0.5)


def brusselator(t, y, dy, p):
    product = y[0] * y[0] * y[1]
    dy[0] = p[0] - (p[1] + 1) * y[0] + product
    dy[1] = p[1] * y[0] - product


def largest(exact):
    """Largest error over the mesh."""
    return lambda t, y: np.abs(y - exact(t)).max()


def last(*values):
    """Largest error at the last time, of the first components."""
    return lambda t, y: np.abs(y[-1, : len(values)] - values).max()


def cases():
    oscillator = hd.Equation([hd.Caputo(1.5), 0.5 * hd.Caputo(0.5)], lambda t, x: -x, y0=[1.0, 0.0])
    to_20 = {"P3": largest(half_order_oscillator)}
    to_20["P3, t = 20"] = last(half_order_oscillator([20.0])[0, 0])
    forced = hd.Equation(hd.Caputo(0.5), powers, 0.0, params=POWERS)
    product = hd.Equation(hd.Caputo(0.8), brusselator, [1.2, 2.8], params=[1.0, 3.0])
    start, ends = [[1.2, 2.8], [1.0, 0.0]], (1.009768417067, 2.158126403083)
    two_orders = hd.Equation(hd.Caputo([1.3, 0.8]), brusselator, start, params=[1.0, 3.0])
    return [
        Case(hd.scenes.relaxation(0.5, 1.0, 1.0), 5.0, 0.5, {"P1": largest(half_order_relaxation)}),
        Case(forced, 1.0, 0.5, {"P2": largest(sum_of_powers)}),
        Case(oscillator, 20.0, 1.5, to_20),
        Case(product, 100.0, 0.8, {"P4": last(1.23585168586364)}),
        Case(hd.scenes.stick_slip(), 100.0, 1.8, {"P5": last(62.071779346609)}),
        Case(two_orders, 220.0, 1.3, {"P6": last(*ends)}),
    ]


def covered(scheme, plan, equation, steps):
    """Whether a scheme takes an equation's terms and makes a plan: it refuses what it does not."""
    try:
        scheme.check_terms(equation.system)
        plan(scheme.reduction(equation.system) or equation.system, steps)
    except ValueError:
        return False
    return True


def settings(case, scheme, quick):
    """Names of the steps a scheme covers a problem with, their number, what `solve` takes."""
    if scheme is COLLOCATION:
        for rtol in 10.0 ** -np.arange(3, 13, 4 if quick else 1):
            yield f"rtol={rtol:.0e}", None, {"rtol": rtol}
        return
    if covered(scheme, scheme.plan, case.equation, 1e-3):
        for n in step_counts(case, quick):
            yield "uniform", n, {"n_steps": n, "history": HISTORY}
    if covered(scheme, scheme.mesh_plan, case.equation, np.linspace(0, 1e-2, 11)):
        exponent = scheme.order(case.alpha) / case.alpha
        for n in step_counts(case, quick):
            mesh = hd.graded(n, exponent)
            yield f"graded({exponent:.3g})", n, {"mesh": mesh, "history": HISTORY}


def step_counts(case, quick):
    if quick:
        return [100, 1000, 10_000]
    counts = [100, 300, 1000, 3000, 10_000, 30_000, 100_000]
    return [*counts, 10**6] if "P3" in case.errors else counts


def measure(quick):
    with warnings.catch_warnings():
        # coarse steps are beyond the stability limit here and there
        warnings.simplefilter("ignore", hd.StabilityWarning)
        warnings.simplefilter("ignore", hd.SolveWarning)
        return [
            row for case in cases() for scheme in SCHEMES for row in solved(case, scheme, quick)
        ]


def solved(case, scheme, quick):
    """Rows of a scheme."""
    for mesh, n, given in settings(case, scheme, quick):
        how = {"scheme": scheme, "estimate": False}
        call = partial(hd.solve, case.equation, case.t_end, **how, **given)
        seconds, sol = fastest(call, 1 if quick else 9)
        for name, error in case.errors.items():
            off = np.nan if sol.status in ENDED_EARLY else error(sol.t, sol.y)
            yield {
                "problem": name,
                "scheme": repr(scheme),
                "mesh": mesh,
                "n_steps": n or sol.t.size - 1,
                "seconds": f"{seconds:.3g}",
                "error": f"{off:.3g}",
            }


TITLES = {
    "P1": "P1: relaxation, order 0.5",
    "P2": "P2: powers of $t$, order 0.5",
    "P3": "P3: oscillator, orders 1.5, 0.5",
    "P4": "P4: Brusselator, order 0.8",
    "P5": "P5: stick-slip, orders 1.8, 0.8",
    "P6": "P6: Brusselator, orders 1.3, 0.8",
}


def claims(rows):
    for scheme in ("L2()", "L2Sigma()"):
        for row in chosen(rows, problem="P1", scheme=scheme, n_steps=10**4):
            if row["mesh"].startswith("graded"):
                text = "P1 on graded meshes, N = 10,000: error"
                yield Claim(text, row["error"], 1e-8, where=scheme)
    yield from oscillator(rows)
    for name in TITLES:
        mine = [row for row in chosen(rows, problem=name) if row["error"] > 0]
        own = chosen(mine, scheme=repr(COLLOCATION))
        others = [row for row in mine if row not in own]
        bound = 0.5 if name == "P6" else 1.5
        for row in others:
            if row["error"] <= 1e-8:
                best = min(
                    (c["seconds"] for c in own if c["error"] <= row["error"]), default=np.inf
                )
                text = f"errors from 1e-8 down: times as long as Collocation, {name}"
                yield Claim(text, row["seconds"] / best, at_least=bound, where=row["scheme"])
        reached = [min(row["error"] for row in some) for some in (own, others)]
        text = "smallest error of others over that of Collocation"
        yield Claim(text, reached[1] / reached[0], at_least=10, where=name)


def oscillator(rows):
    """Orders of P3 at t = 20 in every decade, and the floor that L1 leaves room for."""
    for scheme in (hd.ExplicitCaputo(), hd.L1()):
        mine = chosen(rows, problem="P3, t = 20", scheme=repr(scheme))
        found = {row["n_steps"]: row["error"] for row in mine}
        n = [k for k in (1000, 10**4, 10**5) if k in found]
        for order in observed_order(n, [found[k] for k in n])[0]:
            off = abs(order - scheme.order(1.5))
            yield Claim("P3 at t = 20: orders off the proven ones", off, 0.15, where=repr(scheme))
    if 10**6 in found:
        excess = abs(found[10**6] - found[10**5] * 10**-1.5)
        yield Claim("P3 at t = 20, L1: off order 1.5 at N = 1e6", excess, 1e-12)


def draw(rows):
    shown = [
        row | {"panel": TITLES[row["problem"]], "mesh": row["mesh"].split("(")[0].split("=")[0]}
        for row in rows
        if row["problem"] in TITLES and row["error"] < 100
    ]
    return curves("seconds", "error", ("scheme", "mesh"), ("panel",))(shown)


if __name__ == "__main__":
    study(measure, claims, draw)
