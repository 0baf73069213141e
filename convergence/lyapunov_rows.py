"""`lyapunov` reproduces the field's reference rows, ``lyapunov_references.csv``.

Rows keep the numbers of the collection they come from; 12, a map, and 14 to 16, equations with a
delay, are outside the library. Every comparison says what it allows:

* 1 to 13, classical flows: three standard errors of both values, the reference's taken as large as
  ours, and half its last digit. The sum of all exponents is the mean divergence within 1e-3.
* 17 to 22 and 24, linear equations with memory: Mittag-Leffler functions and real roots, for every
  scheme that takes them. The error is at most twice the estimate from runs with N/2 and N steps. It
  falls with the scheme's order less 0.15.
* 23 and 25, an equilibrium of the Lorenz system: Re mu**(1/alpha) to 0.5 %, the critical order
  where it changes sign to 1e-5. The explicit scheme adds h omega**2 / 2 within 15 %.
* 26 to 33, memory cut off at every interval as published. Exact values where the orbit rests, three
  times the scatter over schemes and steps where it does not. The published predictor-corrector
  gives the published digits. For 27 it does so at its own step alone. There the restarted map falls
  into a periodic window that no other step or scheme has. References that are not claimed are
  published ones that no converged run supports.
* 34 to 40, long runs with memory kept: three standard errors; exponents that decay do so like
  t**-alpha, the power within 0.1. Row 40 has no rate at all, T times its exponents holds to 0.2.
"""

import csv
import math
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from _published_rules import product_integration
from _study import Claim, curves, study
from restarting import restarted
from scipy.optimize import fsolve

import hereditary as hd
from hereditary import exact

REFERENCES = Path(__file__).with_name("lyapunov_references.csv")
FINE = hd.SumOfExponentials(1e-13)
SCHEMES = [hd.ExplicitCaputo(), hd.L1(), hd.L2(), hd.L2Sigma(), hd.BDF(2), hd.Adams()]
SCHEMES += [hd.ProductTrapezoid()]
SECOND_ORDER, ADAMS = SCHEMES[3:], SCHEMES[5]
PANELS = {
    "classical flows": range(1, 14),
    "linear equations and equilibria, memory kept": range(17, 26),
    "memory cut off": range(26, 34),
    "long runs, memory kept": range(34, 41),
}


# Systems that are not scenes.


def duffing_1(t, y, dy, p):
    """friction, stiffness, cubic, force; the scene in two equations of first order."""
    dy[0] = y[1]
    dy[1] = p[3] * math.cos(t) - p[0] * y[1] - p[1] * y[0] - p[2] * y[0] ** 3


def jerk(t, y, dy, p):
    """x''' + p x'' - x'**2 + x = 0"""
    dy[0], dy[1] = y[1], y[2]
    dy[2] = y[1] ** 2 - y[0] - p[0] * y[2]


def fitzhugh_nagumo(t, y, dy, p):
    """Two coupled cells; a, c, k, and b of each."""
    for i in range(0, 4, 2):
        x, other = y[i], y[2 - i]
        dy[i] = x * (p[0] - x) * (x - 1) - y[i + 1] + p[2] * (other - x)
        dy[i + 1] = p[3 + i // 2] * x - p[1] * y[i + 1]


def spiral(t, y, dy, p):
    """y' = mu y for complex y; Re mu, Im mu."""
    dy[0] = p[0] * y[0] - p[1] * y[1]
    dy[1] = p[1] * y[0] + p[0] * y[1]


def two_terms(t, y, dy, p):
    """D^beta y + 0.25 D^gamma y = p y"""
    dy[0] = p[0] * y[0]


def four_wing(t, y, dy, p):
    dy[0] = y[1] * y[2] - y[0]
    dy[1] = y[1] - y[0] * y[2]
    dy[2] = p[0] - p[1] * y[2] + y[0] * y[1]


def financial(t, y, dy, p):
    """Not smooth: the demand is abs(x)."""
    dy[0] = y[2] + (y[1] - p[0]) * y[0]
    dy[1] = 1 - p[1] * y[1] - abs(y[0])
    dy[2] = -y[0] - p[2] * y[2]


OWN = (duffing_1, jerk, fitzhugh_nagumo, spiral, two_terms, four_wing, financial)
FUNCTIONS = {fun.__name__: fun for fun in OWN}


# References and runs.


@cache
def equation_of(name, alpha, given):
    """Equation of a system, its orders, and what is given as ``name=value,value``."""
    values = {}
    for one in given.split():
        key, _, text = one.partition("=")
        values[key] = tuple(map(float, text.split(",")))
    if name == "two_terms":
        terms = hd.Caputo(alpha[0]) + 0.25 * hd.Caputo(alpha[1])
        return hd.Equation(terms, two_terms, [1.0, 0.0], values["p"])
    orders = alpha[0] if len(alpha) == 1 else alpha
    if name in FUNCTIONS:
        terms = hd.Caputo(orders or 1.0)
        return hd.Equation(terms, FUNCTIONS[name], values["y0"], values["p"])
    values = {key: value[0] if len(value) == 1 else value for key, value in values.items()}
    return getattr(hd.scenes, name)(**values, **({"alpha": orders} if orders else {}))


@cache
def exponents(equation, t_end, h, k, scheme, mode, **settings):
    """`lyapunov` of a run that succeeds, or `restarted`."""
    if "directions" in settings:
        settings["directions"] = np.eye(equation.d)
    how = equation, t_end, round(t_end / h), k
    if mode == "restart":
        return restarted(*how, scheme, **settings)
    result = hd.lyapunov(*how, mode, scheme, verify=False, **settings)
    if not result.success:
        raise RuntimeError(f"{equation}: {result.message}")
    return result


@dataclass
class Reference:
    """A row of the references; numbers of its texts, and the comparisons with it."""

    row: str
    kind: str
    system: str
    alpha: tuple
    given: str
    mode: str
    scheme: object
    t_end: float
    h: float
    renorm: float | None
    transient: float
    expected: tuple
    allowed: float
    source: str

    @classmethod
    def read(cls, cells, quick):
        """Of the cells of the file; quick runs are shorter or coarser by the factors of a cell."""
        cells = dict(cells)
        factors = cells.pop("quick").split()
        shorter, coarser = map(float, factors) if quick else (1.0, 1.0)
        for key in ("alpha", "expected"):
            cells[key] = tuple(map(float, cells[key].split()))
        for key in ("t_end", "h", "renorm", "transient", "allowed"):
            cells[key] = float(cells[key] or 0)
        kinds = {type(scheme).__name__: scheme for scheme in SCHEMES}
        found = cls(**cells | {"scheme": kinds.get(cells["scheme"]), "renorm": cells["renorm"]})
        found.t_end, found.transient = shorter * found.t_end, shorter * found.transient
        found.h *= coarser
        return found

    @property
    def equation(self):
        return equation_of(self.system, self.alpha, self.given)

    def run(self, scheme=None, k=None, h=None, equation=None, **more):
        """Run it; restarted as published: from unit vectors, means over the whole run."""
        equation = equation or self.equation
        settings = {"mode": self.mode, "renorm": self.renorm or None} | more
        settings |= {"transient": self.transient} if self.transient else {}
        if self.mode == "restart":
            settings |= {"directions": "unit", "window": 1.0}
        elif self.transient:
            settings["window"] = 1.0
        how = (k or equation.d, scheme or self.scheme or ADAMS)
        return exponents(equation, self.t_end, h or self.h, *how, **settings)

    def compare(self, what, value, reference, allowed, stderr="", scheme=None, source=None):
        """One comparison; an order may also be higher than proven."""
        off = reference - value if what == "order" else abs(value - reference)
        claimed = self.source != "not claimed"
        orders = f"alpha {' '.join(f'{a:g}' for a in self.alpha)}" if self.alpha else ""
        return {
            "row": self.row,
            "system": " ".join(filter(None, (self.system, orders, self.given))),
            "mode": self.mode,
            "scheme": str(scheme or self.scheme or ""),
            "n_steps": round(self.t_end / self.h),
            "t_end": f"{self.t_end:.6g}",
            "compared": what,
            "value": f"{value:.7g}",
            "reference": f"{reference:.7g}",
            "deviation": f"{value - reference:.2g}",
            "tolerance": f"{allowed:.2g}",
            "stderr": f"{stderr:.2g}" if stderr != "" else "",
            "source": self.source if source is None else source,
            "verdict": "holds" if off <= allowed else "fails" if claimed else "not confirmed",
        }

    def each(self, values, references, allowed, stderrs=None, **more):
        """Comparisons of exponents 1, 2, ... with one reference each."""
        allowed = np.broadcast_to(allowed, len(values))
        stderrs = [""] * len(values) if stderrs is None else stderrs
        for i, numbers in enumerate(zip(values, references, allowed, stderrs, strict=True), 1):
            yield self.compare(f"exponent {i}", *numbers, **more)


# Comparisons by kind.


def flow(ref):
    """Exponents, sum rule and Kaplan-Yorke dimension of a classical run."""
    expected = np.array(ref.expected)
    result = ref.run(k=expected.size, window=1.0)
    allowed = 3 * math.sqrt(2) * result.slope_stderr + ref.allowed
    yield from ref.each(result.slope, expected, allowed, result.slope_stderr)
    yield ref.compare("sum rule defect", result.sum_rule_defect, 0.0, 1e-3)
    if expected.size > 2:
        j = int(np.flatnonzero(np.cumsum(expected) >= -1e-3)[-1]) + 1
        above, below = expected[:j].sum(), expected[j]
        spread = np.hypot(allowed[:j].sum() / below, above * allowed[j] / below**2)
        yield ref.compare("Kaplan-Yorke", result.kaplan_yorke, j + above / -below, spread)


def total(ref):
    result = ref.run(k=ref.equation.y0.size, window=1.0)
    yield ref.compare("sum", result.exponents.sum(), *ref.expected, ref.allowed)


def given_exponents(ref):
    yield from ref.each(ref.run().exponents, ref.expected, ref.allowed)


def slope(ref):
    yield ref.compare("slope", ref.run(k=1).slope[0], *ref.expected, ref.allowed)


def growth(alpha, mu, t):
    """ln abs(E_alpha(mu t**alpha)) / t for complex mu."""
    turning = [[mu.real, -mu.imag], [mu.imag, mu.real]]
    return math.log(np.linalg.norm(exact.system(alpha, turning, [1.0, 0.0])(t))) / t


def by_order(ref, what, scheme, truth, proven):
    """Exponent or slope, and the order with which runs of n/2 and n steps approach it."""
    results = [ref.run(scheme, h=h, history=FINE) for h in (2 * ref.h, ref.h)]
    kinds = (r.exponents if what == "exponent" else r.slope for r in results)
    coarse, fine = (float(np.mean(kind)) for kind in kinds)
    allowed = 2 * abs(fine - coarse) / (2**proven - 1)
    order = math.log2(abs((coarse - truth) / (fine - truth)))
    yield ref.compare(what, fine, truth, allowed, scheme=scheme)
    yield ref.compare("order", order, proven, 0.15, scheme=scheme, source="")


def linear(ref):
    (alpha,), mu = ref.alpha, complex(*ref.equation.params)
    truth = growth(alpha, mu, ref.t_end)
    value = (mu ** (1 / alpha)).real if "limit" in ref.source else truth
    yield ref.compare("printed value", value, *ref.expected, ref.allowed)
    for scheme in SCHEMES:
        yield from by_order(ref, "exponent", scheme, truth, scheme.order(alpha, "singular"))


def root(ref):
    """The real s with s**beta + 0.25 s**gamma = p.

    L1's friction is of order 2 - gamma, less than the 3 - beta of its inertia where
    gamma > beta - 1.
    """
    beta, gamma = ref.alpha
    found = fsolve(lambda s: s**beta + 0.25 * s**gamma - ref.equation.params, 1.0, xtol=1e-14)[0]
    yield ref.compare("printed value", found, *ref.expected, ref.allowed)
    for scheme, proven in zip(
        (SCHEMES[0], SCHEMES[1], hd.BDF(2)), (1.0, min(3 - beta, 2 - gamma), 2.0), strict=True
    ):
        yield from by_order(ref, "slope", scheme, found, proven)


def resting(equation, near):
    """Equilibrium next to a point, and eigenvalues of the Jacobian there by differences."""
    fun = getattr(equation.rhs, "py_func", equation.rhs)

    def value(y):
        dy = np.empty(len(y))
        fun(0.0, y, dy, equation.params)
        return dy

    rest = fsolve(value, near, xtol=1e-12)
    columns = [value(rest + e) - value(rest - e) for e in 1e-6 * np.eye(len(rest))]
    return rest, np.linalg.eigvals(np.array(columns).T / 2e-6)


def near_equilibrium(ref, scheme, alpha):
    """Mean slope of the two exponents that spiral, a distance of 0.001 off, and Re and Im."""
    equation = equation_of(ref.system, (alpha,), ref.given)
    rest, mu = resting(equation, np.ravel(equation.y0))
    result = ref.run(scheme, 2, equation=equation.replace(y0=[rest[0] + 1e-3, *rest[1:]]))
    return float(result.slope.mean()), max(mu, key=np.imag) ** (1 / alpha)


def spirals(ref):
    (expected,) = ref.expected
    for scheme in SECOND_ORDER:
        found, _ = near_equilibrium(ref, scheme, *ref.alpha)
        allowed = 5e-3 * abs(expected) + ref.allowed
        yield ref.compare("slope", found, expected, allowed, scheme=scheme)
    found, rate = near_equilibrium(ref, SCHEMES[0], *ref.alpha)
    added = 0.5 * ref.h * rate.imag**2
    what = ("slope added by the step", found - rate.real, added, 0.15 * added)
    yield ref.compare(*what, scheme=SCHEMES[0], source="")


def critical(ref):
    """Order at which the slope changes its sign."""
    low, high = ref.alpha
    below, above = (near_equilibrium(ref, ref.scheme, alpha)[0] for alpha in ref.alpha)
    found = low - below * (high - low) / (above - below)
    yield ref.compare("critical order", found, *ref.expected, ref.allowed)


def scatter(ref):
    """Chaotic orbits: the mean over four schemes, and one at half the step, and their scatter."""
    results = [ref.run(scheme) for scheme in SECOND_ORDER] + [ref.run(h=ref.h / 2)]
    values = np.array([result.exponents for result in results])
    spread = values.std(axis=0, ddof=1)
    allowed = 3 * math.sqrt(1 + 1 / len(results)) * spread
    yield from ref.each(values.mean(axis=0), ref.expected, allowed, spread, scheme="five runs")


def block(ref):
    """ln E_alpha(mu tau**alpha) / tau for every block."""
    truth = growth(*ref.alpha, complex(-float(ref.given.split("=")[1])), ref.renorm)
    for scheme in (hd.BDF(2), ADAMS):
        value = ref.run(scheme).exponents[0]
        yield ref.compare("exponent 1", value, truth, 1e-5, scheme=scheme)
    yield ref.compare("printed value", truth, *ref.expected, ref.allowed)


def at_rest(ref):
    """Blocks at an equilibrium, ln abs(E_q(mu tau**q)) / tau of every eigenvalue."""
    coarse, fine = (ref.run(h=h) for h in (2 * ref.h, ref.h))
    _, mus = resting(ref.equation, fine.y)
    rates = sorted((growth(*ref.alpha, mu, ref.renorm) for mu in mus.astype(complex)), reverse=True)
    allowed = 3 * fine.slope_stderr + 2 * np.abs(coarse.slope - fine.slope)
    yield from ref.each(fine.slope, rates, allowed, fine.slope_stderr)


def predictor_corrector(ref, h):
    """Exponents of a restarted system of three by the scheme of [DiethelmFordFreed2002].

    Tangents are imaginary parts of f at points that are 1e-30 of them aside.
    """
    equation, alpha = ref.equation, np.tile(ref.alpha, 4) if len(ref.alpha) > 1 else ref.alpha[0]
    fun = getattr(equation.rhs, "py_func", equation.rhs)

    def value(t, flat):
        rows, dy = flat.reshape(4, 3), np.empty((3, 3), complex)
        fun(t, (rows[0] + 1e-30j * rows[1:]).T, dy, equation.params)
        return np.concatenate([dy[:, 0].real, dy.T.imag.ravel() / 1e-30])

    x, grown = np.vstack([np.ravel(equation.y0), np.eye(3)]), np.zeros(3)
    for _ in range(round(ref.t_end / ref.renorm)):
        n = round(ref.renorm / h)
        last = product_integration("pece", alpha, value, [x.ravel()], ref.renorm, n)[-1]
        q, r = np.linalg.qr(last.reshape(4, 3)[1:].T)
        grown += np.log(np.abs(np.diag(r)))
        x = np.vstack([last[:3], q.T])
    return grown / ref.t_end


def published(ref):
    values = predictor_corrector(ref, ref.h)
    yield from ref.each(values, ref.expected, ref.allowed, scheme="published one")


def halved(ref):
    """Allowed is twice what halving the step changes, in both codes."""
    values, finer = (ref.run(h=h).exponents for h in (ref.h, ref.h / 2))
    theirs = np.abs(predictor_corrector(ref, ref.h / 2) - ref.expected)
    yield from ref.each(values, ref.expected, 2 * (np.abs(values - finer) + theirs))


def long_run(ref):
    result, (expected,) = ref.run(k=3), ref.expected
    error = result.slope_stderr[0]
    allowed = 3 * np.hypot(error, ref.allowed)
    yield ref.compare("exponent 1", result.slope[0], expected, allowed, error)
    yield ref.compare("power of exponent 3", result.algebraic_slope[2], *ref.alpha, 0.1)


def decay(ref):
    """All three decay like t**-alpha."""
    result = ref.run(directions="unit")
    for i, value in zip((0, 2), ref.expected, strict=True):
        yield ref.compare(f"T exponent {i + 1}", result.log_growth[-1][i], value, ref.allowed)
    for i, power in enumerate(result.algebraic_slope, 1):
        yield ref.compare(f"power of exponent {i}", power, *ref.alpha, 0.1)
    decaying = sum(verdict == "algebraic decay" for verdict in result.verdicts)
    yield ref.compare("verdicts of algebraic decay", decaying, 3, 0)


KINDS = {"flow": flow, "sum": total, "exponents": given_exponents, "slope": slope}
KINDS |= {"linear": linear, "root": root, "spiral": spirals, "critical": critical}
KINDS |= {"scatter": scatter, "block": block, "rest": at_rest, "published": published}
KINDS |= {"halved": halved, "long": long_run, "decay": decay}


def measure(quick):
    with open(REFERENCES, newline="") as file:
        for cells in csv.DictReader(file):
            if cells["quick"] or not quick:
                ref = Reference.read(cells, quick)
                yield from KINDS[ref.kind](ref)


def claims(rows):
    for title, numbers in PANELS.items():
        verdicts = [row["verdict"] for row in rows if row["row"] in numbers]
        exact = title in ("memory cut off", "linear equations and equilibria, memory kept")
        yield Claim(f"{title}: comparisons that hold", verdicts.count("holds"))
        yield Claim(f"{title}: comparisons that fail", verdicts.count("fails"), 0, small=exact)
    unconfirmed = sum(row["verdict"] == "not confirmed" for row in rows)
    yield Claim("published numbers not confirmed", unconfirmed)


def draw(rows):
    shown = [
        row | {"off": np.clip(row["deviation"] / (row["tolerance"] or 1), -4, 4)}
        for row in rows
        if row["compared"] != "order"
    ]
    look = {"ylabel": "(value - reference) / allowed", "title": "Reference rows of exponents"}
    return curves("row", "off", ("verdict",), log="", slopes=(), line="", **look)(shown)


if __name__ == "__main__":
    study(measure, claims, draw)
