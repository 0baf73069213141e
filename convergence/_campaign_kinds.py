"""Random problems at the ends of what an equation can hold.

Problem k of seed s is a function of (s, k) alone. Orders go from 0.01 to 2, a third of them within
1e-2 to 1e-12 of an integer. Rates and ends of runs go from 1e-8 to 1e8. Left out: oscillations that
last more than some hundred periods, growth by more than exp(30).
"""

from dataclasses import replace
from inspect import signature

import numpy as np
from _campaign_problems import Problem
from _laplace_truth import Force, Truth

import hereditary as hd

_PERIODS, _GROWTH = 600.0, 30.0


def problem(seed, k):
    """Problem k of a seed; draws whose exact solution is out of reach are drawn again."""
    rng = np.random.default_rng([seed, k])
    kind = KINDS[k % len(KINDS)]
    while True:
        try:
            drawn = kind(rng)
        except ValueError:  # two poles that cannot be told apart
            continue
        if drawn is not None:
            return drawn


def in_units(drawn, seed, k):
    """The same problem with each component times a factor of its own, from 1e-14 to 1e14."""
    truth, rng = drawn.truth, np.random.default_rng([seed, k, 1])
    unit = 10 ** rng.uniform(-14, 14, truth.d)
    moved = [replace(truth, **_times(truth, unit)) for truth in (truth, *drawn.perturbed)]
    relay = tuple(float(unit[0] * part) for part in drawn.relay)
    return replace(drawn, truth=moved[0], perturbed=tuple(moved[1:]), relay=relay)


def _times(truth, unit):
    """Fields of a truth whose components are multiplied by units, (d,)."""
    forces = [replace(f, amplitudes=tuple((unit * f.amplitudes).tolist())) for f in truth.forces]
    matrix = truth.matrix * np.divide.outer(unit, unit)
    return {"matrix": matrix, "start": truth.start * unit, "forces": forces}


def order(rng, low=0.01, high=2.0):
    """An order, often next to an integer or on it, or tiny."""
    while True:
        which = rng.random()
        if which < 0.4:
            a = rng.uniform(0.01, 2.0)
        elif which < 0.5:
            a = 10 ** rng.uniform(-2.0, -1.0)
        elif which < 0.75:
            a = 1.0 + rng.choice([-1.0, 1.0]) * 10.0 ** -rng.integers(2, 13)
        elif which < 0.85:
            a = 2.0 - 10.0 ** -rng.integers(2, 13)
        elif which < 0.95:
            a = float(rng.integers(1, 3))
        else:
            a = float(rng.choice([0.1, 0.25, 1 / 3, 0.5, 2 / 3, 0.75, 4 / 3, 1.5]))
        if low <= a <= high:
            return float(a)


def log_uniform(rng, low, high):
    return float(10 ** rng.uniform(np.log10(low), np.log10(high)))


def rate_and_end(rng, a):
    """A rate and an end, the product of one with the other to the power a often near 1."""
    t_end = log_uniform(rng, 1e-8, 1e8)
    rate = log_uniform(rng, 1e-8, 1e8)
    near = log_uniform(rng, 1e-3, 1e4) / t_end**a
    return (near if rng.random() < 0.5 and 1e-8 <= near <= 1e8 else rate), t_end


def start(rng, orders):
    """y(0) and y'(0) of a few sizes."""
    highest = orders.max(axis=0)
    rows = rng.uniform(-1, 1, (2, highest.size)) * 10 ** rng.uniform(-2, 2, (2, 1))
    return rows * [np.ones_like(highest), highest > 1]


def shorter(truth, t_end):
    """The end where no pole turns or grows for too long, None where that is before 1e-8."""
    for z, _, _ in truth.poles:
        size, turn = float(z.real), float(np.cos(z.imag))
        left = _GROWTH / turn if turn > 1e-9 else _PERIODS if abs(turn) * _PERIODS < 40 else np.inf
        t_end = min(t_end, float(np.exp(np.clip(np.log(left) - size, -700, 700))))
    return t_end if t_end >= 1e-8 else None


def finished(rng, kind, truth, t_end, **more):
    """A problem with an end and a tolerance, None where it has no end."""
    t_end = shorter(truth, t_end)
    rtol = log_uniform(rng, 1e-11, 1e-3)
    if t_end is None:
        return None
    return Problem(kind, truth, t_end, rtol, n_forces=len(truth.forces), **more)


def forces(rng, d, size, number, t_end=0.0):
    """Forces (t - start)**power that reach some `size` by t_end; from 0, or jumps, with t_end 0."""
    out = []
    for _ in range(number):
        power = float(rng.choice([0.0, 0.0, 0.5, 1.0, 2.0, rng.uniform(0.0, 3.0)]))
        factor = size * (t_end**-power if t_end else 1.0)
        out.append(Force(0.0, power, tuple((rng.uniform(-1, 1, d) * factor).tolist())))
    return out


def scale(truth, t_end):
    """A size of forces that y feels: y times the rates, or the rate of a whole run."""
    rate = max(np.abs(truth.matrix).max(), t_end ** -truth.orders.max())
    return float(rate * np.abs(truth.start[0]).max())


def one_order(rng, kind="one order"):
    """Relaxation, oscillation or growth, and often a force."""
    a = order(rng)
    rate, t_end = rate_and_end(rng, a)
    orders = np.array([[a]])
    sign = -1.0 if rng.random() < 0.85 else 1.0
    truth = Truth(orders, np.ones((1, 1)), np.array([[sign * rate]]), start(rng, orders))
    if rng.random() < 0.3:
        truth = replace(truth, forces=forces(rng, 1, scale(truth, t_end), 1, t_end))
    return finished(rng, kind, truth, t_end)


def several_terms(rng):
    """Two to four terms; orders may nearly meet."""
    n = int(rng.integers(2, 5))
    orders = np.sort([order(rng) for _ in range(n)])
    if np.diff(orders).min() == 0:
        return None
    coefficients = np.append([log_uniform(rng, 1e-3, 1e3) for _ in range(n - 1)], 1.0)
    rate, t_end = rate_and_end(rng, orders[-1])
    start_rows = start(rng, orders[:, None])
    truth = Truth(orders[:, None], coefficients[:, None], np.array([[-rate]]), start_rows)
    if rng.random() < 0.3:
        truth = replace(truth, forces=forces(rng, 1, scale(truth, t_end), 1, t_end))
    return finished(rng, "several terms", truth, t_end)


def basis(rng, d):
    """Coordinates: those of the components, turned, or skew."""
    which = rng.random()
    if which < 0.2:
        return np.eye(d)
    turned = np.linalg.qr(rng.normal(size=(d, d)))[0]
    return turned if which < 0.7 else turned @ (np.eye(d) + np.triu(rng.uniform(-2, 2, (d, d)), 1))


def same_order(rng, kind, core, a, t_end):
    """A system of one order with that matrix in some basis."""
    d = core.shape[0]
    turned = basis(rng, d)
    matrix = core if np.array_equal(turned, np.eye(d)) else turned @ core @ np.linalg.inv(turned)
    orders = np.full((1, d), a)
    truth = Truth(orders, np.ones((1, d)), matrix, start(rng, orders))
    if rng.random() < 0.4:
        truth = replace(truth, forces=forces(rng, d, scale(truth, t_end), 1, t_end))
    return finished(rng, kind, truth, t_end)


def system(rng):
    """Two or three components of one order: real rates of any sizes, or a stable turning pair."""
    a, d = order(rng), int(rng.integers(2, 4))
    rate, t_end = rate_and_end(rng, a)
    spread = 10 ** -rng.uniform(0, rng.choice([1.0, 4.0, 12.0]), d)
    core = np.diag(-rate * spread)
    if rng.random() < 0.5 and a < 1.9:
        angle = rng.uniform(1.02 * a * np.pi / 2, 3.1)
        core[:2, :2] = rate * np.array(
            [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
        )
    return same_order(rng, "system", core, a, t_end)


def jordan(rng):
    """An eigenvalue of two or three equal ones with one direction."""
    a, d = order(rng), int(rng.integers(2, 4))
    rate, t_end = rate_and_end(rng, a)
    core = -rate * (np.eye(d) + np.diag(10 ** rng.uniform(-2, 1, d - 1), 1))
    return same_order(rng, "Jordan block", core, a, t_end)


def incommensurate(rng):
    """Another order in each component: triangular, or two of them coupled both ways."""
    d = int(rng.integers(2, 4))
    orders = np.array([[order(rng) for _ in range(d)]])
    rate, t_end = rate_and_end(rng, orders.max())
    sizes = rate * 10 ** rng.uniform(-3, 0, (d, d))
    matrix = np.triu(sizes * rng.uniform(-1, 1, (d, d)), 1) - np.diag(np.diag(sizes))
    if d == 2 and rng.random() < 0.5:
        matrix[1, 0] = -np.sign(matrix[0, 1]) * sizes[1, 0]
    truth = Truth(orders, np.ones((1, d)), matrix, start(rng, orders))
    if rng.random() < 0.4:
        truth = replace(truth, forces=forces(rng, d, scale(truth, t_end), 1, t_end))
    return finished(rng, "incommensurate", truth, t_end)


def forced(rng):
    """Forces alone from rest, or beside a solution that is over soon."""
    drawn = [one_order, several_terms, system, incommensurate][rng.integers(4)](rng)
    if drawn is None:
        return None
    truth, t_end = drawn.truth, drawn.t_end
    if rng.random() < 0.5:
        truth = replace(truth, start=truth.start * [[0.0], [0.0]])
    size = log_uniform(rng, 1e-2, 1e2) * scale(drawn.truth, drawn.t_end)
    truth = replace(truth, forces=forces(rng, truth.d, size, int(rng.integers(1, 4)), t_end))
    return replace(drawn, kind="forced", truth=truth, n_forces=len(truth.forces))


def begun(rng, truth, t_end, times):
    """Constant forces that begin at those times."""
    size = log_uniform(rng, 1e-1, 1e1) * scale(truth, t_end)
    out = []
    for begin in times:
        amplitudes = tuple((rng.uniform(-1, 1, truth.d) * size).tolist())
        out.append(Force(float(begin), 0.0, amplitudes))
    return out


def broken(rng):
    """Make jumps at times in `breaks`, a few of them next to each other or to the ends."""
    drawn = [one_order, one_order, several_terms, system][rng.integers(4)](rng)
    if drawn is None:
        return None
    times = drawn.t_end * rng.uniform(0, 1, int(rng.integers(1, 5)))
    if rng.random() < 0.3:
        times[-1] = drawn.t_end * log_uniform(rng, 1e-9, 1e-1)
    if rng.random() < 0.3:
        times = np.append(times, times[0] * (1 + log_uniform(rng, 1e-9, 1e-1)))
    times = np.unique(times[(times > 0) & (times < drawn.t_end)])
    fs = [*drawn.truth.forces, *begun(rng, drawn.truth, drawn.t_end, times)]
    truth, closed = replace(drawn.truth, forces=fs), bool(rng.random() < 0.5)
    breaks, count = tuple(times.tolist()), len(fs)
    return replace(drawn, kind="breaks", truth=truth, n_forces=count, breaks=breaks, closed=closed)


def jumping(rng):
    """Make a jump that stays and is not in `breaks`."""
    drawn = [one_order, one_order, several_terms, system][rng.integers(4)](rng)
    if drawn is None:
        return None
    fs = [
        *drawn.truth.forces,
        *begun(rng, drawn.truth, drawn.t_end, [drawn.t_end * rng.uniform(0.001, 0.99)]),
    ]
    truth = replace(drawn.truth, forces=fs)
    return replace(drawn, kind="jump not told", truth=truth, n_forces=len(fs))


def window(rng):
    """Make a force that acts for a time and is not in `breaks`; a solver may miss it."""
    drawn = one_order(rng)
    if drawn is None:
        return None
    begin, width = drawn.t_end * rng.uniform(0.01, 0.9), drawn.t_end * log_uniform(rng, 1e-4, 1e-1)
    size = log_uniform(rng, 1e-1, 1e1) * scale(drawn.truth, drawn.t_end)
    fs = [*drawn.truth.forces, Force(begin, 0.0, (size,)), Force(begin + width, 0.0, (-size,))]
    truth = replace(drawn.truth, forces=fs)
    return replace(drawn, kind="window not told", truth=truth, n_forces=len(fs))


def watched_window(rng):
    """The same with steps that cannot pass over it."""
    drawn = window(rng)
    if drawn is None:
        return None
    begin, end = (force.start for force in drawn.truth.forces[-2:])
    if end - begin < 1e-3 * drawn.t_end:
        return None
    if "max_step" not in signature(hd.solve).parameters:
        return drawn
    return replace(drawn, kind="window, max_step", max_step=(end - begin) / 2)


def given_steps(rng):
    """Schemes of given steps on what only decays, for what they say of themselves."""
    drawn = [one_order, several_terms, system][rng.integers(3)](rng)
    if (
        drawn is None
        or drawn.truth.forces
        or any(np.cos(z.imag) > 0 for z, *_ in drawn.truth.poles)
    ):
        return None
    scheme = SCHEMES[rng.integers(len(SCHEMES))]
    n_steps = int(log_uniform(rng, 100, 3000))
    return replace(drawn, kind="given steps", scheme=scheme, n_steps=n_steps)


def relay(rng):
    """A jump in y that the solution passes through: -k sign(y - level)."""
    above = rng.random() < 0.6
    a = order(rng, 1 + 1e-13, 2.0) if above else order(rng, 0.05, 1.0)
    t_end = log_uniform(rng, 1e-8, 1e8)
    y0, level = (
        rng.uniform(0.2, 1.0) * rng.choice([-1, 1]),
        rng.choice([0.0, rng.uniform(-0.2, 0.2)]),
    )
    rate = log_uniform(rng, 0.1, 100.0) / t_end**a
    k = rate * log_uniform(rng, 0.05, 1.0) * (rng.choice([-1, 1]) if above else -1)
    orders, drift = np.array([[a]]), -np.sign(y0) * rate * rng.uniform(0.3, 2.0)
    rows = np.array([[y0], [rng.uniform(-1, 1) / t_end * above]])
    pushes = [] if above and rng.random() < 0.5 else [Force(0.0, 0.0, (float(drift),))]
    truth = Truth(orders, np.ones((1, 1)), np.array([[-rate]]), rows, pushes)
    found = switched(truth, k, level, t_end)
    if found is None:
        return None
    rtol, moved = log_uniform(rng, 1e-10, 1e-3), []
    for change in (rtol, -rtol):
        other = [replace(f, amplitudes=(f.amplitudes[0] * (1 - change),)) for f in pushes]
        other = switched(
            replace(truth, start=rows * (1 + change), forces=other), k, level, found[1]
        )
        moved.append(other and other[0])
    if None in moved:
        return None
    made = Problem("relay", *found, rtol, len(pushes))
    return replace(made, relay=(float(k), float(level)), perturbed=tuple(moved))


def switched(truth, k, level, t_end, most=6):
    """The truth with the relay's jumps among its forces, and an end; None where one is grazed."""
    side = np.sign(truth.start[0, 0] - level)
    truth, last = pushed(truth, 0.0, -k * side), 0.0
    for _ in range(most):
        found = crossing(truth, level, side, last, t_end)
        if found is None or found == np.inf:
            return found and (truth, t_end)
        before, last = last, found
        truth, side = pushed(truth, last, 2 * k * side), -side
    return replace(truth, forces=truth.forces[:-1]), before + 0.99 * (last - before)


def pushed(truth, begin, size):
    """The truth with another constant force on the first component, from a time on."""
    return replace(truth, forces=[*truth.forces, Force(float(begin), 0.0, (float(size),))])


def crossing(truth, level, side, last, t_end):
    """When y leaves this side of a level: inf for never, None where it nearly does or barely."""
    u = np.unique(np.concatenate([np.geomspace(1e-6, 1, 60), np.linspace(0.005, 1, 200)]))
    t = last + (t_end - last) * u
    gap = side * (truth(t)[:, 0] - level)
    first = int(np.argmax(gap <= 0)) if np.any(gap <= 0) else gap.size
    high, inner = gap[:first].max(initial=0.0), gap[1 : first - 1]
    dips = inner[(inner <= gap[: first - 2]) & (inner <= gap[2:first])] if first > 2 else inner
    if first == 0 or np.any(dips < 0.01 * high):
        return None
    if first == gap.size:
        return np.inf if gap[-1] > 0.01 * high else None
    left, right = t[first - 1 : first + 1]
    if (gap[first - 1] - gap[first]) * (t_end - last) < 0.01 * high * (right - left):
        return None
    while left < (left + right) / 2 < right:
        inside = np.linspace(left, right, 30)
        below = np.append(side * (truth(inside[1:-1])[:, 0] - level) <= 0, True)
        left, right = inside[np.argmax(below) : np.argmax(below) + 2]
    return float(right)


def sliding(rng):
    """A jump in y that the solution runs into and stays on for good."""
    a, t_end = order(rng, 0.05, 1.0), log_uniform(rng, 1e-8, 1e8)
    y0, rate = float(rng.uniform(0.2, 1.0)), log_uniform(rng, 1e-2, 10.0) / t_end**a
    k = rate * log_uniform(rng, 0.5, 30.0)
    rows, push = np.array([[y0], [0.0]]), Force(0.0, 0.0, (float(k * rng.uniform(-0.8, 0.8)),))
    truth = Truth(np.array([[a]]), np.ones((1, 1)), np.array([[-rate]]), rows, [push])
    truth = pushed(truth, 0.0, -k)
    reached = crossing(truth, 0.0, 1.0, 0.0, t_end)
    if reached is None or reached == np.inf:
        return None
    made = Problem("sliding", truth, t_end, log_uniform(rng, 1e-10, 1e-3), 1)
    return replace(made, relay=(float(k), 0.0), settles=reached)


SCHEMES = (
    "ExplicitCaputo()", "ExplicitCaputo()", "Adams(1)", "Adams(2)", "Adams(3)", "L1()", "L2()",
    "L2Sigma()", "BDF(2)", "BDF(3)", "ProductTrapezoid()",
)  # fmt: skip
# Three in ten plain, the others with something that comes on, jumps or holds.
KINDS = (
    one_order, several_terms, system, jordan, incommensurate, forced, broken, broken, jumping,
    one_order, several_terms, system, jordan, incommensurate, window, watched_window, relay,
    relay, sliding, given_steps,
)  # fmt: skip
