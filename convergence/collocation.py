"""Collocation with chosen steps: its accuracy, its cost, and what its tolerance means.

P1 to P6 are the problems of work_precision.py. Milliseconds are those of the fastest of several
warm `hd.solve` calls. Errors are the largest of y, and of y' above order 1, at times in all steps.
The truth of P3 to P6 is collocation with 12 nodes whose past is integrated exactly instead of
carried by modes. Closed forms and published digits agree with it. The tolerance of a component is
1.01 rtol times its largest size so far. For a component that starts at 0 the hundredth refers to
its size over the run. The tolerance of y' is rtol times its own size plus 0.04 / T times that of y.

* P1 and P2 to 1e-12 within 10 ms each, P3 to 1e-11 within 20 ms, x(100) of P4 to 1e-10 within
  100 ms. P5 to 1e-6 at all times and to 1e-9 on t <= 40 within 200 ms, the published digits of P6.
* P1 to T = 1e4 at 1e-10 with fewer than 1,800 right-hand sides, nine a step of them off the nodes.
* P1 to P6 and 60 random linear problems (tests/random_problems.py: orders 1e-6 to 1.98, rates to
  1e6) have rtol from 1e-4 to 1e-11. The error is at most one tolerance in every run, also after 160
  periods of an oscillation.
* Orders within 1e-6 of 0, 1 and 2 are solved as accurately as others. Tiny ones take few steps at
  rates of 1, 20 and 1,000.
* Doubling T adds a constant number of steps where the solution relaxes; the time of a step does not
  grow with T.
* ``D^beta x = -K x`` stays bounded by x(0) for beta from 1.02 to 2 and K up to 1e6.
"""

from dataclasses import dataclass
from functools import lru_cache, partial

import numpy as np
from _study import Claim, chosen, curves, fastest, side_by_side, study
from numpy.polynomial.legendre import leggauss, legvander
from problems import half_order_oscillator, half_order_relaxation
from random_problems import KINDS
from scipy.special import erfcx, rgamma
from work_precision import cases, sum_of_powers

import hereditary as hd
from hereditary import exact
from hereditary.collocation.equations import integral_form
from hereditary.collocation.first_rule import LEFT_OUT, functions, graded_rule
from hereditary.collocation.quadrature import radau_integrals, radau_nodes, to_legendre

SCHEME = hd.Collocation()
TOLERANCES = 10.0 ** -np.arange(4, 13)
NODES = 12  # of the reference
GAUSS = [(1 + leggauss(20)[0]) / 2, leggauss(20)[1] / 2]
# What is claimed: tolerance asked for, largest error, milliseconds.
CLAIMS = {
    "P1": (1e-10, 1e-12, 10),
    "P2": (1e-11, 1e-12, 10),
    "P3": (1e-10, 1e-11, 20),
    "P4": (1e-11, 5e-10, 100),  # at all times; x(100) to 1e-10
    "P5": (1e-9, 1e-6, 200),
}
X_100, P6_DIGITS = 1.23585168586364, (1.0097684171, 2.1581264031)
# Orders of D^beta x + 0.2 D^gamma x + x = 0 next to integers.
LIMITS = [
    (1.8, 0.6),
    (1.3, 0.7),
    (1.5, 0.5),
    (1.999, 0.999),
    (1.999, 0.001),
    (1.02, 0.98),
    (1.001, 0.999),
    (1.000001, 0.5),
    (1.999999, 0.999999),
    (1.5, 1e-6),
    (1.5, 1 - 1e-6),
]
NAMES = ("P1", "P2", "P3", "P4", "P5", "P6")


@dataclass(frozen=True)
class Truth:
    """True values: times (n,), y (n, d) and y' (n, d), nan where it is not an unknown, or None."""

    t: np.ndarray
    y: np.ndarray
    slopes: np.ndarray | None = None

    def judge(self, sol, rtol):
        """Largest error of a solution of `rtol`, and largest ratio of an error to its tolerance."""
        error, ratio, sizes = 0.0, 0.0, np.maximum.accumulate(np.abs(self.y), axis=0)
        sizes = np.where(self.y[0] == 0, sizes[-1], sizes)
        least = 0.01 * sizes, 0.04 * sizes / self.t[-1]
        for derivative, true in enumerate((self.y, self.slopes)):
            if true is None:
                continue
            off = np.abs(sol(self.t, derivative) - true)
            own = np.maximum.accumulate(np.abs(true), axis=0)
            tolerance = rtol * (least[derivative] + own)
            error, ratio = max(error, np.nanmax(off)), max(ratio, np.nanmax(off / tolerance))
        return error, ratio


def times(t_end):
    """Times that crowd towards 0, and even ones."""
    return np.unique(np.append(np.geomspace(1e-12 * t_end, t_end, 200), np.linspace(0, t_end, 401)))


class Past:
    """Past steps with their drivers, integrated without modes.

    Steps further off than their length are integrated by Gauss's rule. Nearer ones and the first,
    which is made of powers, are integrated by a rule that is graded towards both ends.
    """

    def __init__(self, form, initial):
        assert not form.offset_of.any()  # P3 to P6 have none
        self._orders, self._initial, self._steps = form.orders, initial, []
        self.rows = [(int(c), int(q), int(k), kappa) for c, q, k, kappa in form.terms.tolist()]

    def add(self, start, length, at, end):
        """Take in a step: `at(u)` (3, d, k) are f, p and y at u in [0, 1], `end` those at 1."""
        near, far = at(graded_rule()[0]), at(GAUSS[0])
        shares = np.array([kappa * length * GAUSS[1] * far[q, c] for c, q, _, kappa in self.rows])
        self._steps.append((start, length, near, end, shares))

    def at(self, t):
        """p(0) and the integrals over the past, at times t ahead, shape (d, k)."""
        total = np.repeat(self._initial[:, None], t.size, axis=1)
        distant = [i > 0 and t[0] > s[0] + 2 * s[1] for i, s in enumerate(self._steps)]
        far = [s for s, is_far in zip(self._steps, distant, strict=True) if is_far]
        for (start, length, near, end, _), is_far in zip(self._steps, distant, strict=True):
            if not is_far:
                self._add_near(total, np.maximum((t - start) / length - 1, 0), length, near, end)
        if far:
            ends = np.concatenate([start + length * GAUSS[0] for start, length, *_ in far])
            distances = np.subtract.outer(t, ends)
            kernels = [distances ** (a - 1) * rgamma(a) for a in self._orders]
            shares = np.concatenate([step[4] for step in far], axis=1)
            for (c, _, k, _), share in zip(self.rows, shares, strict=True):
                total[c] += kernels[k] @ share
        return total

    def _add_near(self, total, x, length, near, end):
        _, v, weights = graded_rule()
        for c, q, k, kappa in self.rows:
            a = self._orders[k]
            seen = (weights * np.add.outer(x, v) ** (a - 1)) @ near[q, c]
            seen += end[q, c] * ((LEFT_OUT + x) ** a - x**a) / a
            total[c] += kappa * length**a * rgamma(a) * seen


def exact_memory(equation, t_end, nodes=NODES):
    """Collocation with the steps of a run of rtol 1e-12 and the past integrated exactly."""
    run = hd.solve(equation, t_end, rtol=1e-12, scheme=hd.Collocation(nodes=nodes))
    form, c, matrix = integral_form(equation.system), radau_nodes(nodes), to_legendre(nodes)
    second = form.above_one == 1
    past = Past(form, np.where(second, equation.y0[-1], equation.y0[0]))
    first = run.dense._pieces[0]
    t = [first.length * np.exp(first.variable.logs(radau_nodes(first.variable.n)))]
    y = run(t[0]).T
    f = np.array([equation.system.rhs(*pair) for pair in zip(t[0], y.T, strict=True)]).T
    begun = values = np.array([f, first.row, y])
    of_nodes = partial(functions, first.variable)
    past.add(0.0, first.length, lambda u: begun @ of_nodes(np.log(u)).T, values[:, :, -1])
    found, edges = (
        [values],
        np.append(np.concatenate([p.edges() for p in run.dense._pieces]), t_end),
    )
    for start, h in zip(edges[1:-1], np.diff(edges[1:]), strict=True):
        t.append(start + h * c)
        guess = np.where(second, run(t[-1], 1), run(t[-1])).T
        base, y = past.at(t[-1]), found[-1][2, :, -1]
        found.append(stages(equation, form, t[-1], h, base, y, guess))
        values = found[-1]
        past.add(
            start,
            h,
            lambda u, values=values: values @ (legvander(2 * u - 1, nodes - 1) @ matrix).T,
            values[:, :, -1],
        )
    _, p, y = np.concatenate(found, axis=2).transpose(0, 2, 1)
    return Truth(np.concatenate(t), y, np.where(second, p, np.nan) if second.any() else None)


def stages(equation, form, t, h, base, y, p):
    """f, p and y at the nodes of a step, (3, d, s), by Newton's method from p."""
    d, s = p.shape
    operators, second = np.zeros((2, d, s, s)), form.above_one == 1
    for c, q, k, kappa in form.terms.tolist():  # y itself is no driver in P3 to P6
        a = form.orders[int(k)]
        operators[int(q), int(c)] += kappa * h**a * radau_integrals(s, a)
    whole = h * radau_integrals(s, 1.0)
    inner = [whole if is_second else np.eye(s) for is_second in second]
    f, x, matrix = np.empty((d, s)), y, np.empty((d, s, d, s))
    for sweep in range(6):
        x = np.where(second[:, None], y[:, None] + p @ whole.T, p)
        for j, row in enumerate(np.ascontiguousarray(x.T)):
            f[:, j] = equation.system.rhs(t[j], row)
        if sweep == 0:
            slopes = np.array([equation.jacobian(t[j], x[:, j].copy()) for j in range(s)])
            for c, e in np.ndindex(d, d):
                share = (operators[0, c] * slopes[:, c, e]) @ inner[e]
                matrix[c, :, e] = (c == e) * (np.eye(s) - operators[1, c]) - share
        known = np.einsum("cij,cj->ci", operators[0], f) + np.einsum("cij,cj->ci", operators[1], p)
        change = np.linalg.solve(matrix.reshape(d * s, d * s), (p - base - known).ravel())
        p = p - change.reshape(d, s)
    return np.array([f, p, np.where(second[:, None], y[:, None] + p @ whole.T, p)])


@lru_cache
def problem(name):
    """Equation, end and truth of P1 to P6."""
    case = next(case for case in cases() if name in case.errors)
    closed = {"P1": half_order_relaxation, "P2": sum_of_powers}
    if name in closed:
        t = times(case.t_end)
        return case.equation, case.t_end, Truth(t, closed[name](t))
    return case.equation, case.t_end, exact_memory(case.equation, case.t_end)


def row(case, name, t_end, rtol):
    """A row with empty cells."""
    known = {"case": case, "problem": name, "t_end": f"{t_end:.8g}", "rtol": f"{rtol:.0e}"}
    columns = ("error", "over_tolerance", "steps", "rejected", "rhs", "modes", "ms", "largest")
    return known | dict.fromkeys((*columns, "status", "h"), "")


def measured(case, name, equation, t_end, rtol, truth=None, quick=False, **given):
    """A row of the table: the fastest of several calls."""
    call = partial(hd.solve, equation, t_end, rtol=rtol, scheme=SCHEME, **given)
    seconds, sol = fastest(call, 1 if quick else 15, within=0.5)
    error, ratio = (np.nan, np.nan) if truth is None or not sol.success else truth.judge(sol, rtol)
    found = sol.stats
    return row(case, name, t_end, rtol) | {
        "error": f"{error:.3g}",
        "over_tolerance": f"{ratio:.3g}",
        "steps": found["n_steps"],
        "rejected": found["n_rejected"],
        "rhs": found["n_rhs"],
        "modes": found["n_modes"],
        "ms": f"{1e3 * seconds:.3g}",
        "largest": f"{np.abs(sol.y).max():.10g}",
        "status": str(sol.status),
    }


def measure_problems(quick):
    rows = []
    for name in ("P1", "P2", "P3") if quick else NAMES:
        equation, t_end, truth = problem(name)
        for rtol in TOLERANCES[:: 4 if quick else 1]:
            rows.append(measured("problems", name, equation, t_end, rtol, truth, quick))
    equation, _, _ = problem("P1")
    far = times(1e4)
    truth = Truth(far, half_order_relaxation(far))
    rows.append(measured("problems", "P1 to 1e4", equation, 1e4, 1e-10, truth, quick))
    return rows


def linear(t, y, p):
    return -p[0] * y


def measure_random(quick):
    """Ten problems of each kind, at the tolerances that their rounding allows."""
    rows, rng = [], np.random.default_rng(2026)
    for number in range(6 if quick else 60):
        case = KINDS[number % len(KINDS)](rng.uniform)
        t_end = min(10 ** rng.uniform(-1, 2), case.t_end)
        truth = Truth(times(t_end), case.solution(times(t_end)))
        for rtol in TOLERANCES[:: 4 if quick else 1]:
            if rtol >= case.rtol:
                name, equation = f"{number} {case.name}", case.equation
                rows.append(measured("random", name, equation, t_end, rtol, truth, True))
    return rows


def measure_long(quick):
    """Oscillations of many periods."""
    rows = []
    for beta, t_end in ((1.999, 100.0), (1.999, 1000.0))[: 1 if quick else 2]:
        equation = hd.Equation(hd.Caputo(beta), linear, [1.0, 0.0], params=(1.0,))
        truth = Truth(times(t_end), exact.relaxation(beta, 1.0, [1.0, 0.0])(times(t_end)))
        for rtol in (1e-6, 1e-8, 1e-10):
            rows.append(measured("long", f"D^{beta}", equation, t_end, rtol, truth, quick))
    return rows


def measure_limits(quick):
    rows = []
    for beta, gamma in LIMITS[:: 5 if quick else 1]:
        terms = [hd.Caputo(beta), 0.2 * hd.Caputo(gamma)]
        equation = hd.Equation(terms, linear, [1.0, 0.5], params=(1.0,))
        solution = exact.several_terms([beta, gamma], [1.0, 0.2], [1.0, 0.5], rate=1.0)
        truth = Truth(times(40.0), solution(times(40.0)))
        for rtol in (1e-8, 1e-10, 1e-12):
            rows.append(
                measured("limits", f"{beta!r}, {gamma!r}", equation, 40.0, rtol, truth, True)
            )
    return rows


def measure_horizon(quick):
    """A relaxation to ever later times, and stick and slip."""
    rows = []
    for k in range(0, 6 if quick else 22):
        t_end = 5.0 * 2**k
        truth = Truth(times(t_end), half_order_relaxation(times(t_end)))
        equation = hd.scenes.relaxation(0.5)
        rows.append(measured("horizon", "relaxation", equation, t_end, 1e-10, truth, quick))
    for k in range(0 if quick else 6):
        rows.append(
            measured("horizon", "P5", hd.scenes.stick_slip(), 100.0 * 2**k, 1e-8, None, quick)
        )
    return rows


def measure_stiff(quick):
    rows = []
    for beta in (1.02, 1.2, 1.5, 1.8, 1.95, 1.999, 2.0)[:: 3 if quick else 1]:
        for rate in (1.0, 1e3) if quick else (1.0, 1e2, 1e4, 1e6):
            equation = hd.Equation(hd.Caputo(beta), linear, [1.0, 0.0], params=(rate,))
            solution = exact.relaxation(beta, rate, [1.0, 0.0])
            truth = Truth(times(10.0), solution(times(10.0)))
            rows.append(measured("stiff", f"{beta}, {rate:.0e}", equation, 10.0, 1e-8, truth, True))
    return rows


def stepped(t, y, p):
    """Relaxation, pulled to 1 from p[0] on."""
    return np.where(t < p[0], -y, 1.0 - y)


def ring(t, y, dy, p):
    n = y.shape[0]
    for i in range(n):
        dy[i] = np.sin(y[(i + 1) % n]) - p[0] * y[i] + 0.1 * t / (1 + t)


def measure_others(quick):
    """Measure a jump with and without `breaks`, small orders, and the cost of components."""
    rows, t = [], np.unique(np.concatenate([times(3.0), 3 + times(2.0)]))
    later = np.where(t > 3, 1 - erfcx(np.sqrt(np.maximum(t - 3, 0))), 0.0)
    truth = Truth(t, half_order_relaxation(t) + later[:, None])
    equation = hd.Equation(hd.Caputo(0.5), stepped, 1.0, params=(3.0,))
    for rtol in (1e-4, 1e-6, 1e-8, 1e-10):
        for label, breaks in (("told", [3.0]), ("not told", ())):
            name = f"jump at 3, {label}"
            rows.append(measured("jump", name, equation, 5.0, rtol, truth, quick, breaks=breaks))
    t = np.append(0.0, np.geomspace(1e-30, 1.0, 300))
    for alpha in (1e-6, 0.01, 0.02, 0.05, 0.1, 0.2):
        for rate in (1.0, 20.0, 1e3):
            truth = Truth(t, exact.relaxation(alpha, rate)(t))
            equation, name = hd.scenes.relaxation(alpha, rate), f"{alpha}, {rate:g}"
            for rtol in (1e-6, 1e-10):
                rows.append(measured("small order", name, equation, 1.0, rtol, truth, quick))
    for d in (1, 2, 5) if quick else (1, 2, 5, 10, 20):
        start = np.linspace(0.5, 1.5, d) if d > 1 else 0.5
        equation = hd.Equation(hd.Caputo(0.8), ring, start, params=(1.0,))
        rows.append(measured("components", str(d), equation, 20.0, 1e-8, None, quick))
    return rows


def measure(quick):
    for part in (measure_problems, measure_random, measure_long, measure_limits):
        yield from part(quick)
    for part in (measure_horizon, measure_stiff, measure_others):
        yield from part(quick)
    if not quick:
        yield from run_rows()
        yield from references()


def run_rows():
    """The steps of a stick-slip run: where they end, how long they are, x and its error."""
    equation, t_end, truth = problem("P5")
    sol = hd.solve(equation, t_end, rtol=1e-8, scheme=SCHEME)
    off = np.abs(sol(truth.t) - truth.y)[:, 0]
    step = np.clip(np.searchsorted(sol.t, truth.t) - 1, 0, sol.t.size - 2)
    errors = np.zeros(sol.t.size - 1)
    np.maximum.at(errors, step, off)
    for t, h, x, error in zip(sol.t[1:], np.diff(sol.t), sol.y[1:, 0], errors, strict=True):
        found = {"h": f"{h:.4g}", "largest": f"{x:.8g}", "error": f"{error:.4g}"}
        yield row("run", "P5", t, 1e-8) | found


def references():
    """The exact memory against closed forms and digits, and runs against it."""
    truth = problem("P3")[2]
    off = np.abs(truth.y - half_order_oscillator(truth.t)).max()
    yield Claim("exact memory off the closed form of P3", off, 1e-13)
    off = abs(problem("P4")[2].y[-1, 0] - X_100)
    yield Claim("exact memory off x(100) of P4", off, 3e-13)
    equation, t_end, truth = problem("P6")
    sol = hd.solve(equation, t_end, rtol=1e-10, scheme=SCHEME)
    for where, ends in (("exact memory", truth.y[-1]), ("rtol 1e-10", sol.y[-1])):
        off = np.abs(ends.round(10) - P6_DIGITS).max()
        yield Claim("published digits of P6, off by", off, 0, where=where)
    equation, t_end, _ = problem("P4")
    off = abs(hd.solve(equation, t_end, rtol=CLAIMS["P4"][0]).y[-1, 0] - X_100)
    yield Claim("x(100) of P4 at 1e-11, error", off, 1e-10)
    equation, t_end, truth = problem("P5")
    yield Claim("x(100) of P5 off 62.0717793", abs(truth.y[-1, 0] - 62.0717793), 1e-7)
    early = truth.t <= 40
    sol = hd.solve(equation, t_end, rtol=CLAIMS["P5"][0])
    off = np.abs(sol(truth.t) - truth.y)[early].max()
    yield Claim("P5 at 1e-9, t <= 40, error", off, 1e-9)


def claims(rows):
    for name, (rtol, bound, ms) in CLAIMS.items():
        for row in chosen(rows, case="problems", problem=name, rtol=rtol):
            yield Claim(f"{name} at {rtol:.0e}, error", row["error"], bound)
            yield Claim(f"{name} at {rtol:.0e} [ms]", row["ms"], ms)
    (far,) = chosen(rows, case="problems", problem="P1 to 1e4")
    yield Claim("P1 to T = 1e4 at 1e-10, error", far["error"], 1e-10, small=True)
    yield Claim("P1 to T = 1e4 at 1e-10, right-hand sides", far["rhs"], 1799, small=True)
    yield from tolerance(rows)
    yield from reach(rows)


def tolerance(rows):
    """Errors are within the tolerance, in all runs down to 1e-11."""
    judged = [row for row in chosen(rows, case="problems") if row["problem"] in NAMES]
    judged += chosen(rows, case="random") + chosen(rows, case="long")
    for text, least, limit in (("1e-11", 1e-11, 1), ("1e-12", 1e-12, np.inf)):
        ratios = [row["over_tolerance"] for row in judged if row["rtol"] > 0.99 * least]
        yield Claim(f"runs with rtol from 1e-4 to {text}", len(ratios))
        beyond = sum(not ratio <= 1 for ratio in ratios)
        yield Claim(f"runs beyond the tolerance, 1e-4 to {text}", beyond, limit - 1)
        yield Claim(f"largest error over the tolerance, 1e-4 to {text}", max(ratios), limit)
    for row in chosen(rows, case="long"):
        text = "error over the tolerance after 160 periods"
        if row["t_end"] > 999:
            yield Claim(text, row["over_tolerance"], 1, where=f"rtol {row['rtol']:g}")
    for name in NAMES:
        if spent := [row["ms"] for row in chosen(rows, case="problems", problem=name)]:
            yield Claim(f"{name}: fastest run [ms]", min(spent))


def reach(rows):
    """Limits, the horizon, and stiff problems."""
    for row in chosen(rows, case="limits"):
        text, where = "orders near integers: error over the tolerance", row["problem"]
        yield Claim(text, row["over_tolerance"], 5, where=where)
    steps = [row["steps"] for row in chosen(rows, case="horizon", problem="relaxation")]
    added = np.diff(steps)[len(steps) // 2 :]
    yield Claim("steps that doubling T adds, apart", np.ptp(added), 2)
    yield Claim("steps that doubling T adds", added.max())
    cost = [
        row["ms"] / (row["steps"] + row["rejected"])
        for row in chosen(rows, case="horizon", problem="P5")
    ]
    if cost:
        yield Claim("stick and slip: a step of T = 3200 over one of T = 100", cost[-1] / cost[0], 2)
        yield Claim("stick and slip: a step [us]", 1e3 * cost[0])
    for row in chosen(rows, case="stiff"):
        how = {"where": row["problem"], "small": True}
        yield Claim("stiff: largest y over y(0)", row["largest"], 1 + 1e-8, **how)
        if float(row["problem"].split(",")[0]) < 1.99:
            yield Claim("stiff: error over the tolerance", row["over_tolerance"], 1, **how)
    for row in chosen(rows, case="jump") + chosen(rows, case="small order"):
        if "not" not in row["problem"]:
            text, how = "jumps told, small orders", {"where": row["problem"], "small": True}
            yield Claim(f"{text}: error over the tolerance", row["over_tolerance"], 1, **how)


def draw(rows):
    of = {"case": "problems"}
    rows = [row for row in rows if row["problem"] != "P1 to 1e4"]
    parts = [
        curves("rtol", "over_tolerance", ("problem",), of=of, title="True error over tolerance"),
        curves("ms", "error", ("problem",), of=of, title="Work and precision"),
    ]
    if chosen(rows, case="run"):
        look = {"xlabel": "t", "ylabel": "step (line), error of x", "title": "P5 at 1e-8"}
        parts.append(curves("t_end", ("h", "error"), log="y", of={"case": "run"}, **look))
    return side_by_side(*parts)(rows)


if __name__ == "__main__":
    study(measure, claims, draw)
