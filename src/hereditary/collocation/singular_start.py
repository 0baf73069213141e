"""Trial lengths and variables of the first step after a start at which the solution is not smooth.

A *generator* is a number g of `Form.generators`: the exponents of time in the solution after the
start are sums of generators.
"""

import math
from collections.abc import Iterator
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from ..compiled.jacobian import LEAST
from ..compiled.jit import inner
from ..compiled.linalg import eigenvalues
from ..equation.system import System
from .edge import edge_at
from .equations import Form
from .first_rule import Variable
from .mode_tables import FIRST_PER_OCTAVE, floor_to
from .operators import FORCE, PRIMARY
from .orbit import OrbitAndTangents
from .stage_solver import has_stages

# Ratio of the next trial length to the length of a rejected trial step.
TRIAL_LENGTH_RATIO = 0.25
# Generator below which time to this power is not small for any possible step. A variable u that is
# bent by a rate c is tried then; below order 1 also where rounding of t > 0 hides how y changes.
_MAX_BENT_GENERATOR = 0.12
# Rate c from which a variable u is bent.
_LEAST_BENT = 0.5
# Number of trial lengths in a variable u that is bent by a rate c, before all trials with c = 0.
_BENT_TRIALS = 12
# Ratio of successive trial lengths in a variable u that is bent by a term of the equation. These
# trials end at the shortest possible step: orders 1.00001 and 1 need one of 1e-59.
_BENT_TRIAL_LENGTH_RATIO = 0.25**4
# Exponent below which a power of time hardly changes between 1e-300 and 1.
VANISHING = 1e-3
# Longest first step after a break, in lengths of the step before the break. An earlier singularity
# may be as close as that step is long.
_OF_LAST = 100.0
# Size of a component that is 0, as fraction of its reach, in the rate of change of many components.
_SIZE_IF_ZERO = 0.01
# Largest number of components for which first steps from an edge are tried. All of their stages are
# one dense system.
_MOST_AT_EDGE = 16
# Number of trial lengths of a first step from an edge, before all other trials.
_EDGE_TRIALS = 16
# Number of nodes of a first step from an edge. With 24, 37 of 288 problems D^a y = t^q - y^p with
# exponents q / p of the solution up to 13 end early at rtol 1e-6, with 36 nodes 18.
_NODES_AT_EDGE = 36
# Powers q of the variables u with t = u**q in which powers of time with unknown exponents are
# tried. In the last one y^0.37 is smooth, which is like t^0.21 at order 0.36. With 12 one of 30
# problems that grow from an edge ends early at rtol 1e-8.
_EDGE_POWERS = 4.0, 20.0


class Trial(NamedTuple):
    """A first step to try: its length [time], its variable, and whether it begins at an edge."""

    length: float
    variable: Variable
    at_edge: bool = False


def trials(
    system: System,
    form: Form,
    orbit: OrbitAndTangents,
    t: float,
    left: float,
    longest: float,
    least: float,
    jacobian: Any,
    units: np.ndarray,
    reach: np.ndarray,
) -> Iterator[Trial]:
    """Yield the `Trial` steps from t, until one is accepted."""
    # left: time to the next stop; least: length that every step must exceed. jacobian (d, d): of f
    # at the start, or just after it; units (d,): increments of its differences. reach (d,): what
    # other components could make of each during the run (compiled/reach.py).
    just_after = system.beside(t, 1) if t > 0 else 0.0
    smallest = form.generators[0]
    # steps before a jump by y are short, however far the last singularity is
    before = max(_OF_LAST * orbit.last_length, orbit.since)
    most = min(left / 16, longest, before or np.inf)
    if system.d <= _MOST_AT_EDGE:
        reached = np.asarray(abs(jacobian) @ units)
        if edge_at(system.compiled, just_after, orbit.x[0], units, reached):
            yield from _trials_at_edge(form, most)
    leading = np.where(system.leading == 0, 1.0, np.abs(system.leading))
    few, tiny, rate = not has_stages(form), smallest < _MAX_BENT_GENERATOR, 0.0
    if tiny or (t > 0 and few and not form.above_one.any()):
        rate = _rate_of_decay(jacobian / leading[:, None], most**smallest)
    if not tiny and rate * np.spacing(t) ** smallest < _LEAST_BENT:
        rate = 0.0  # the plain trials below resolve the change
    for h in most * TRIAL_LENGTH_RATIO ** np.arange(_BENT_TRIALS if rate > 0.0 else 0):
        if (c := rate * h**smallest) >= _LEAST_BENT:
            yield Trial(h, _bent(form.generators, c))
    order, variables = _plain(form)
    if not few:
        sizes = np.abs(orbit.x[0]) + _SIZE_IF_ZERO * reach
        sizes = np.where(sizes > LEAST, sizes, units)
        speeds = np.where(form.above_one, orbit.p[0], 0.0)
        vectors = system.rhs(just_after, orbit.x[0]) / leading, speeds
        rate = _rate_of_many(jacobian, leading, sizes, vectors)
    else:
        rate = rate_of_few(jacobian, leading)
    first = first_length(rate, order, most)
    first = first if t + first > t else most  # rounding of t hides a shorter one
    first = floor_to(first, FIRST_PER_OCTAVE) if t == 0 else first  # modes over it are made once
    for generators, variable, of_terms in variables:
        h = first
        while t + h > t and h > least:
            yield Trial(h, variable)
            h *= TRIAL_LENGTH_RATIO
        h = most
        while of_terms * h ** generators[0] >= _LEAST_BENT and t + h > t and h > least:
            yield Trial(h, _bent(generators, of_terms * h ** generators[0]))
            h *= _BENT_TRIAL_LENGTH_RATIO


@inner
def first_length(rate: float, order: float, most: float) -> float:
    """Return the length of the first trial step, at most `most`."""
    # over it the solution, which changes at this rate, changes by about half of its size
    if not 0.5 <= rate * most**order < np.inf:
        return most
    length = (0.5 / rate) ** (1.0 / order)
    return length if length > 0.0 else most


@lru_cache(maxsize=64)
def _plain(form: Form) -> tuple[float, list[tuple[tuple[float, ...], Variable, float]]]:
    """Return the order of a form, and (generators, variable, rate of terms) of plain trials."""
    # a power with an exponent next to 0 is nearly constant compared with other powers
    others = tuple(g for g in form.generators if g >= VANISHING)
    kinds = sorted({form.generators, others})
    variables = [(own, Variable.of(own), _rate_of_terms(form, own[0])) for own in kinds]
    return order_of(form), variables


def is_usual(form: Form) -> bool:
    """Return whether first steps are tried in one variable that is not bent, without kernels."""
    above, special = form.above_one, form.kernels or form.varying or form.implicit.any()
    alike = above.any() == above.all()
    return alike and not special and form.generators[0] >= _MAX_BENT_GENERATOR


def _trials_at_edge(form: Form, most: float) -> Iterator[Trial]:
    """Yield the trial steps from an edge."""
    # exponents of time are those of the balance of f there, which are not known
    by_generators = Variable.of(form.generators)._replace(n=_NODES_AT_EDGE)
    unknown, steep = (Variable(power, n=_NODES_AT_EDGE) for power in _EDGE_POWERS)
    for variables in (by_generators, unknown), (steep,):
        for k in range(_EDGE_TRIALS):
            for variable in dict.fromkeys(variables):
                yield Trial(most * TRIAL_LENGTH_RATIO**k, variable, True)


def _rate_of_decay(jacobian: Any, of_time: float) -> float:
    """Return the geometric mean of the least and largest eigenvalue that bends u, or 0."""
    # of_time: the power of the longest step that is multiplied by a rate
    if not np.isfinite(abs(jacobian).sum()):
        return 0.0
    rates = np.abs(eigenvalues(jacobian))
    rates = rates[(rates * of_time >= _LEAST_BENT) & (rates < np.inf)]
    return math.sqrt(rates.min() * rates.max()) if rates.size else 0.0


def _bent(generators: tuple[float, ...], c: float) -> Variable:
    """Return the variable that is bent by about c, the nearest power of 2."""
    return Variable.of(generators, 2.0 ** round(math.log2(c)))


def _rate_of_terms(form: Form, exponent: float) -> float:
    """Return the rate of terms that are integrals of p of this small order; 0 if there are none."""
    # with orders 1.00001 and 1, y' is nearly y'(0) / (1 + c t**1e-5): the rate is c, a ratio of
    # coefficients
    powers = (form.terms["index"] >= 0) & (form.terms["index"] < form.orders.size)
    terms = form.terms[powers & (form.terms["integrand"] == PRIMARY)]
    terms = terms[np.abs(form.orders[terms["index"]] - exponent) <= 1e-9 * exponent]
    rates = np.abs(terms["coefficient"])
    return (
        math.sqrt(rates.min() * rates.max())
        if rates.size and exponent < _MAX_BENT_GENERATOR
        else 0.0
    )


def order_of(form: Form) -> float:
    """Return the smallest order by which f is integrated, at least 0.1."""
    # smaller orders do not give useful lengths of steps
    forces = form.terms[form.terms["integrand"] == FORCE]
    orders = form.orders[forces["index"]] + form.above_one[forces["row"]]
    return max(float(orders.min()), 0.1) if orders.size else 1.0


@inner
def rate_of_few(jacobian: Any, leading: np.ndarray) -> float:
    """Return an estimate of the rate at which few components change just after the start."""
    # it is independent of units; jacobian (d, d), leading (d,)
    rate = 0.0
    for c in range(leading.size):
        total = 0.0
        for k in range(leading.size):
            own = jacobian[c, k] / leading[c] * (jacobian[k, c] / leading[k])
            total += math.sqrt(abs(own))
        rate = max(rate, total)
    return rate


def _rate_of_many(
    jacobian: Any, leading: np.ndarray, sizes: np.ndarray, vectors: tuple[np.ndarray, ...]
) -> float:
    """Return an estimate of the rate at which many components change just after the start."""
    # The largest |J v| / |v| for changes v (d,) of y and y', J (d, d) being the Jacobian over
    # leading (d,). Norms are largest entries over sizes (d,). With smooth initial data of a partial
    # differential equation it does not grow on finer meshes.
    rows, columns = jacobian.nonzero()
    entries, rates = np.abs(jacobian[rows, columns]), [0.0]
    with np.errstate(over="ignore", invalid="ignore"):
        entries = entries * sizes[columns] / (leading * sizes)[rows]
        largest = float(entries.max(initial=0.0))
        for v in vectors if np.isfinite(largest) else ():
            size = np.abs(v / sizes).max()
            if size > 0.0:
                rates.append(np.abs(jacobian @ v / (leading * sizes)).max() / size)
    rate = max(rates)
    return rate if 0.0 < rate < largest else largest
