"""Cases: equation x scheme x history x steps, every one that the schemes' declared abilities allow.

An equation is made in other units of y and t, from another start, with its components permuted and
with a decoupled one more, so that laws can compare the solutions.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass
from functools import cache, wraps
from itertools import product
from typing import Any

import numba
import numpy as np
import pytest

import hereditary as hd
from hereditary.schemes import Scheme

T_END, N_STEPS, TOL, RTOL = 4.0, 96, 1e-10, 1e-6


@numba.njit
def decay(t, y):
    return np.cos(t) - (1 + 0.2 * np.sin(3 * t)) * y - 0.1 * y**3


@numba.njit
def spiral(t, y):
    rest = 1.0 + 0.1 * y[0] + 0.2 * np.sin(3 * t)
    return np.array([-y[0] + 2 * y[1], -2 * y[0] - y[1] * rest + np.sin(t)])


@numba.njit
def backward(t, y):
    return spiral(t, y[::-1].copy())[::-1].copy()


@numba.njit
def beside_another(t, y):
    return np.append(spiral(t, y[:2]), np.cos(t) - y[2])


@numba.njit
def diffusion(t, y):
    found = np.empty(y.size)
    for i in range(y.size):
        left, right = y[max(i - 1, 0)], y[min(i + 1, y.size - 1)]
        found[i] = left - 2 * y[i] + right - 0.1 * y[i] ** 3 + np.cos(t)
    return found


def scaled(f):
    """Return the right-hand side in units of y and t, p = (scale of y, of t, start)."""

    def rhs(t, y, p):
        return f((t - p[2]) / p[1], y / p[0]) * p[0]

    return rhs


def _reading(t, y, memory, p):
    return decay((t - p[2]) / p[1], y / p[0]) * p[0] - 0.5 * memory[0] * p[1] ** 0.4


RHS = {f: scaled(f) for f in (decay, spiral, backward, beside_another, diffusion)}


def of_order(order, coefficient=1.0):
    """Return a maker of a Caputo term in units of time: terms are multiplied by unit**order."""

    def made(unit, places=slice(None)):
        orders, factors = np.broadcast_arrays(order, coefficient)
        if orders.ndim:
            orders, factors = orders[places], factors[places]
        return (factors * unit**orders) * hd.Caputo(orders if orders.ndim else float(orders))

    return made


@dataclass(frozen=True)
class Family:
    """An equation that can be made in other units.

    Attributes
    ----------
    terms : tuple of callable
        ``term(unit of time, places)``, with the orders of these components.
    y0 : tuple
        Rows y(0) and, above order 1, y'(0).
    tags : frozenset of str
        several, differ (terms differ by component), kernel, varying, memory; order 1.3 and so on
        is `highest`.
    """

    name: str
    terms: tuple
    f: Any
    y0: tuple
    tags: frozenset = frozenset()
    highest: float = 1.0

    @property
    def d(self):
        return np.size(self.y0[0])


def _family(name, terms, f, y0, *tags, highest=1.0):
    return Family(name, terms, f, y0, frozenset(tags), highest)


def _tempered(unit, places=slice(None)):
    return unit**0.8 * hd.Memory(hd.TemperedPowerLaw(0.8, 1.0 / unit), 1)


def _remembering(unit, places=slice(None)):
    return 0.5 / unit * hd.Memory(hd.Prony([1.0 / unit, 10.0 / unit], [0.3, 0.7]), 0)


def _varying(middle, kind=hd.Caputo, factor=1.0):
    """Return a maker of a term whose order varies, in units of 1 alone."""
    return lambda unit, places: factor * kind(lambda t: middle + 0.1 * np.sin(t))


def _matrix(unit, places=slice(None)):
    matrix = np.array([[1.0, 0.2], [0.3, 1.5]])[places][:, places]
    return unit**0.7 * matrix * hd.Caputo(0.7)


def _riemann_liouville(unit, places=slice(None)):
    return unit**0.6 * hd.RiemannLiouville(0.6)


BELOW = ((1.0, 0.0),)
ABOVE = ((1.0, 0.0), (0.5, 0.0))
FAMILIES = [
    _family("one term", (of_order(0.6),), decay, (1.0,), highest=0.6),
    _family("above one", (of_order(1.4),), decay, (1.0, 0.5), highest=1.4),
    _family("order 1", (of_order(1.0),), decay, (1.0,)),
    _family("order 2", (of_order(2.0),), decay, (1.0, 0.5), highest=2.0),
    _family("system", (of_order(0.7),), spiral, BELOW, highest=0.7),
    _family("several terms", (of_order(0.9), of_order(0.3, 0.5)), decay, (1.0,), "several",
            highest=0.9),
    _family("several above one", (of_order(1.8), of_order(0.8, 0.5), of_order(1.2, 0.1)), decay,
            (1.0, 0.5), "several", highest=1.8),
    _family("orders differ", (of_order([0.9, 0.4]),), spiral, BELOW, "differ", highest=0.9),
    _family("orders differ above one", (of_order([1.3, 0.6]),), spiral, ABOVE, "differ",
            highest=1.3),
    _family("coefficients", (of_order(0.7, [2.0, 0.5]),), spiral, BELOW, "differ", highest=0.7),
    _family("kernel", (of_order(1.0), _tempered), decay, (1.0,), "several", "kernel"),
    _family("varying", (_varying(0.6),), decay, (1.0,), "varying", highest=0.7),
    _family("varying above one", (_varying(1.6), _varying(0.6)), decay, (1.0, 0.5), "varying",
            "several", highest=1.7),
    _family("varying Riemann-Liouville",
            (of_order(1.0), _varying(0.4, hd.RiemannLiouville, 0.5)), decay, (1.0,),
            "varying", "several"),
    _family("remembers y", (of_order(1.5), _remembering), decay, (1.0, 0.5), "several", "kernel",
            highest=1.5),
    _family("leading kernel", (_tempered,), decay, (1.0,), "kernel", highest=0.8),
    _family("Riemann-Liouville", (of_order(0.9), _riemann_liouville), decay, (1.0,), "several",
            highest=0.9),
    _family("above two", (of_order(2.6),), decay, (1.0, 0.5, 0.0), "enlarged", "differ"),
    _family("matrix", (_matrix,), spiral, BELOW, "matrix", highest=0.7),
    _family("complex", (of_order(0.8),), decay, (1.0 + 0.5j,), "complex", highest=0.8),
    _family("many", (of_order(0.7),), diffusion, (tuple(np.linspace(0, 1, 12)),), "banded",
            highest=0.7),
    _family("many above one", (of_order(1.6),), diffusion,
            (tuple(np.linspace(0, 1, 12)), (0.0,) * 12), "banded", highest=1.6),
    _family("many with orders of their own", (of_order(np.resize([0.9, 0.8, 0.6], 12)),), diffusion,
            (tuple(np.linspace(0, 1, 12)),), "banded", "differ", highest=0.9),
    _family("reads memory", (of_order(0.9),), _reading, (1.0,), "memory", highest=0.9),
]  # fmt: skip
# Every public scheme with its defaults, but for those that need a parameter or have several.
VARIANTS = {
    hd.Adams: [hd.Adams(), hd.Adams(corrections=2)],
    hd.BDF: [hd.BDF(p) for p in range(1, 7)],
    hd.IMEX: [hd.IMEX(hd.L1()), hd.IMEX(hd.BDF(2))],
}
PUBLIC = [getattr(hd, name) for name in hd.__all__]
KINDS = [kind for kind in PUBLIC if isinstance(kind, type) and issubclass(kind, Scheme)]
SCHEMES = [scheme for kind in KINDS for scheme in VARIANTS.get(kind) or [kind()]]
# Those of given steps that take any right-hand side.
GIVEN = [s for s in SCHEMES if not isinstance(s, hd.Collocation | hd.IMEX)]
HISTORIES = [hd.Direct(), hd.FFT(), hd.SumOfExponentials(TOL)]


@dataclass(frozen=True)
class Case:
    """One run: a family, a scheme, a history (None: the scheme's own) and the kind of its steps."""

    family: Family
    scheme: Any
    history: Any
    steps: str

    def __str__(self):
        return f"{self.family.name}, {self.scheme}, {self.history}, {self.steps}"

    @property
    def given(self):
        """Whether the steps are given."""
        return self.steps != "tolerance"

    def allowed(self):
        """Return whether the abilities that scheme and history declare allow this case."""
        scheme, tags, highest = self.scheme, self.family.tags, self.family.highest
        asked = [
            (highest > scheme.orders[1], False),
            ("several" in tags, scheme.several_terms and highest <= scheme.several_up_to),
            ("differ" in tags, scheme.components_differ),
            ("memory" in tags, scheme.takes_memory),
            (self.steps == "mesh", scheme.takes_meshes and highest <= scheme.meshes_up_to),
            (self.steps == "mesh", "kernel" not in tags),
            (isinstance(scheme, hd.IMEX), not tags & {"complex", "enlarged", "matrix"}),
        ]
        for name in ("kernel", "varying", "mesh"):
            ability = {"kernel": "takes_kernels", "varying": "takes_varying"}.get(name)
            if self.history is not None and (name in tags or self.steps == name):
                asked.append((True, getattr(self.history, ability or "takes_meshes")))
            if ability and name in tags:
                asked.append((True, getattr(scheme, ability)))
        return all(able for wanted, able in asked if wanted)

    def equation(self, y=1.0, time=1.0, start=0.0, places=None, f=None, more=()):
        """Return the equation in units of y and of time, from a start, of components in an order.

        `f` is the right-hand side of the components in that order, with `more` values of y0.
        """
        family = self.family
        places = slice(None) if places is None else np.asarray(places)
        y0 = [np.append(np.atleast_1d(row)[places], more) for row in family.y0]
        y0 = [y * row / time**k for k, row in enumerate(y0)]
        f, how = f or family.f, {}
        if "banded" in family.tags:
            how["bandwidth"] = 1, 1
        if "memory" in family.tags:
            how["memory"] = hd.Caputo(0.4)
        if isinstance(self.scheme, hd.IMEX):
            how["linear"] = -0.5 * np.eye(y0[0].size)
        terms = [term(time, places) for term in family.terms]
        rhs, y0 = RHS.get(f, f), y0[0] if len(y0) == 1 else y0
        return hd.Equation(terms, rhs, y0, [y, time, start], t_start=start, **how)

    def how(self, t_end=T_END, time=1.0, start=0.0, n=N_STEPS):
        """Return the keyword arguments of a run to t_end, in units of time."""
        how = {"scheme": self.scheme, "history": self.history}
        if self.steps == "tolerance":
            return {"scheme": self.scheme, "rtol": RTOL}
        if self.steps == "uniform":
            return how | {"n_steps": n, "estimate": False}
        mesh = start + time * t_end * np.linspace(0, 1, n + 1) ** 2
        return how | {"mesh": mesh, "estimate": False}

    def solve(self, t_end=T_END, n=N_STEPS, events=None, **units):
        """Solve the equation in these units, as `equation` takes them."""
        run = {key: units[key] for key in ("time", "start") if key in units} | {"n": n}
        end = units.get("start", 0.0) + units.get("time", 1.0) * t_end
        return hd.solve(self.equation(**units), end, **self.how(t_end, **run), events=events)

    def again(self):
        """Return keyword arguments with which a run goes on: the state knows the others."""
        return {"estimate": False} if self.given else {}

    def moved(self, c, by):
        """Return the equation with y(0) of a component moved."""
        equation = self.equation()
        y0 = equation.y0.copy()
        y0[0, c] += by
        return equation.replace(y0=y0 if len(self.family.y0) > 1 else y0[0])

    @cache  # noqa: B019
    def solution(self):
        """Return the run in units of 1."""
        return self.solve()


def _every():
    for family, scheme in product(FAMILIES, SCHEMES):
        if isinstance(scheme, hd.Collocation):
            yield Case(family, scheme, None, "tolerance")
        else:
            for history, steps in product(HISTORIES, ("uniform", "mesh")):
                yield Case(family, scheme, history, steps)


EVERY = list(_every())
CASES = [case for case in EVERY if case.allowed()]


def chosen(*tags, **wanted):
    """Return the cases whose family has all tags, and whose fields have the values wanted."""
    return [
        case
        for case in CASES
        if case.family.tags.issuperset(tags)
        and all(getattr(case, name) == value for name, value in wanted.items())
    ]


# Users see other components than those that are marched.
FRAMED = {"complex", "enlarged", "matrix"}
TANGENTS = [c for c in CASES if c.scheme.takes_tangents and c.family.tags.isdisjoint(FRAMED)]
# What rounding, and Newton's method, leave of laws that are exact otherwise, relative to |y|.
ROUNDING = 3e-11
# Steps of runs over more than two parts of FFT.
LONG = 2100
DIRECT = HISTORIES[0]


def over(cases):
    """State a law of cases, in one test for all histories of a family by a scheme."""
    together = defaultdict(list)
    for case in cases:
        together[f"{case.family.name}, {case.scheme}, {case.steps}"].append(case)

    def stated(law):
        @pytest.mark.parametrize("case", together.values(), ids=together)
        @wraps(law)
        def test(case, **given):
            for one in case:
                law(case=one, **given)

        return test

    return stated


def assert_close(found, expected, case, bound=ROUNDING):
    """Compare within rounding, or ten times the tolerance of a run that has one."""
    bound = bound if case.given else 10 * RTOL
    assert np.abs(found - expected).max() <= bound * np.abs(expected).max()


# Schemes that take first orders and tangents, and scenes whose exponents they compute.
FIRST_ORDER = [hd.ExplicitCaputo(), hd.GrunwaldLetnikov(), hd.L1(), hd.L12(), hd.L2()]
FIRST_ORDER += [hd.L2Sigma(), hd.BDF(2), hd.Adams(), hd.ProductTrapezoid()]
SECOND_ORDER = [hd.ExplicitCaputo(), hd.GrunwaldLetnikov(), hd.L1(), hd.BDF(2)]
ORBITS = [
    *((scheme, lambda: hd.scenes.lorenz(alpha=0.98)) for scheme in FIRST_ORDER),
    *((scheme, lambda: hd.scenes.stick_slip(beta=1.7, gamma=0.6)) for scheme in SECOND_ORDER),
    (hd.L2Sigma(), lambda: hd.scenes.duffing(beta=1.8, friction=0.0)),
    (hd.ProductTrapezoid(), lambda: hd.scenes.duffing(beta=1.8, friction=0.0)),
]
