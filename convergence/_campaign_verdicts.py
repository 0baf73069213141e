"""How a run of a campaign's problem is judged.

The tolerance of a component at a time is 1.01 rtol times its largest size so far. If it begins at
0, the hundredth is of its largest size over the run. For y' the tolerance is rtol times its largest
size, and 0.04 rtol / T times the size of y. The largest size is up to the end of a step out of 0 or
out of a break. For systems and relays the tolerance is multiplied by what perturbed initial values
and forces amplify. What rounding of the matrix, of forces and times moves y by is added.
"""

import contextlib
import time
import warnings
from dataclasses import replace

import numpy as np
from _laplace_truth import second_opinion

# Relative rounding of numbers in the right-hand side and of times.
_ROUNDING, _TICK = 1e-15, 4.5e-16
# Shares of a run after which a change may be made that grows until a later time.
_LATER = np.array([0.25, 0.5, 0.75])
# Sizes beyond which a given-step run that decays has failed, and beyond which y counts as blown up.
_GROSS, _BLOWN_UP = 4.0, 1e100
_JUMPS_IN_TIME = ("jump not told", "window not told", "window, max_step")
_NEVER_TRUE = ("INTERRUPTED", "EVENT", "RHS_FAILED", "ORDER_FAILED")
# A second opinion takes a second where solutions turn or grow longer than this.
_LONG = 120.0
# Terms that the second opinion sums.
_DIGITS = 80
OK, WRONG, SLOPE, NOT_SEEN = "ok", "wrong success", "wrong slope", "not seen"
TRUE, FALSE, REFUSED, CRASH = "true status", "false status", "refused", "crash"
NO_END, UNSURE = "no end", "truth unsure"


def judged(problem, confirm=False):
    """A row: the verdict on a run of the problem, and the numbers behind it."""
    row = {"kind": problem.kind, "verdict": OK, "status": "", "message": "", "ratio": 0.0}
    row |= {"slope_ratio": 0.0, "t_worst": 0.0, "reached": 0.0, "steps": 0, "rtol": problem.rtol}
    began = time.perf_counter()
    try:
        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always")
            sol = problem.solve()
    except (ValueError, TypeError) as error:
        sentence = "must" in str(error) and len(str(error)) < 1000
        return row | {"verdict": REFUSED if sentence else CRASH, "message": _told(error)}
    except Exception as error:
        return row | {"verdict": CRASH, "message": _told(error)}
    row["seconds"] = round(time.perf_counter() - began, 3)
    row |= {"status": sol.status.name, "message": str(sol.message)[:300]}
    row |= {"reached": float(sol.t[-1]) / problem.t_end, "steps": sol.stats["n_steps"]}
    if problem.n_steps is not None:
        return row | {"verdict": _given_steps(problem, sol, told)}
    if sol.t.size > 1:
        row |= measured(problem, sol, confirm)
    if row.pop("doubtful", False):
        return row | {"verdict": UNSURE}
    if not sol.success:
        return row | {"verdict": TRUE if reason_holds(problem, sol) else FALSE}
    fine = max(row["ratio"], row["slope_ratio"]) <= 1 and sol.t[-1] == problem.t_end
    if not fine and problem.kind == "window not told":
        return row | {"verdict": NOT_SEEN}
    if row["ratio"] > 1 or sol.t[-1] != problem.t_end:
        return row | {"verdict": WRONG}
    return row | {"verdict": OK if fine else SLOPE}


def _told(error):
    return f"{type(error).__name__}: {error}"[:300]


def reason_holds(problem, sol):
    """Whether a run that ended early says nothing untrue of the problem.

    At a jump in time that nobody named no run may end.
    """
    name, t = sol.status.name, float(sol.t[-1])
    if name in _NEVER_TRUE:
        return False
    if problem.kind in _JUMPS_IN_TIME and name != "BLOWN_UP":
        jumps = np.array([force.start for force in problem.truth.forces])
        return not np.any(np.abs(jumps - t) <= 1e-3 * problem.t_end)
    if name == "BLOWN_UP":
        later = np.linspace(t, problem.t_end, 200)
        return bool(np.abs(problem.solution(later)).max() > _BLOWN_UP)
    claims = sol.message.replace("if the right-hand side jumps", "")
    claims = claims.replace("may slide or chatter where the right-hand side jumps, or", "")
    if "the right-hand side jumps" in claims:
        jumps = np.array([f.start for f in problem.truth.forces if f.start > 0] + [problem.settles])
        return bool(np.any(np.abs(jumps - t) <= 1e-3 * problem.t_end)) or t >= problem.settles
    return True


def _given_steps(problem, sol, told):
    """What a scheme of given steps says of itself, on a solution that decays.

    It may be as wrong as its step is long, y'(0) times that at first. It must not grow without an
    early end, or a warning with an estimated error above the size of y.
    """
    warned = any(issubclass(w.category, UserWarning) for w in told)
    t = problem.t_end * np.append(np.geomspace(1e-8, 1e-2, 100), np.linspace(0, 1, 300))
    size, largest = np.abs(sol.y), np.abs(problem.solution(np.sort(t)))
    first = np.abs(problem.truth.start[1]) * problem.t_end / problem.n_steps
    bound = _GROSS * (1.01 * largest.max(axis=0) + first)
    fine = bool(np.all(size <= bound))
    if sol.success:
        told_of = warned and (sol.stats["error_estimate"] or 0.0) > 1.0
        return OK if fine else TRUE if told_of else WRONG
    if sol.status.name == "BLOWN_UP":
        return TRUE if not np.all(size <= 1e6 * bound) else FALSE
    return TRUE if warned or sol.status.name not in ("STEP_TOO_LARGE", "ZIGZAG") else FALSE


def points(problem, sol):
    """Times that a run is judged at: nodes, between, inside the first step, around its corners."""
    rng = np.random.default_rng(0)
    n = sol.t.size - 1
    i = np.unique(np.r_[0 : min(n, 4), max(0, n - 2) : n, np.linspace(0, n - 1, 24).astype(int)])
    corners = np.array([*problem.breaks, *(f.start for f in problem.truth.forces), problem.settles])
    corners = np.unique(corners[(corners > 0) & (corners < sol.t[-1])])
    near = np.searchsorted(sol.t, corners)
    i = np.unique(np.clip(np.r_[i, near - 1, near], 0, n - 1))
    lengths = np.diff(sol.t)[i, None]
    inside = sol.t[i, None] + lengths * rng.uniform(0.02, 0.98, (i.size, 2))
    nodes = sol.t[np.unique(np.linspace(0, n, 60).astype(int))]
    first = sol.t[1] * np.geomspace(1e-12, 1, 13)
    parts = [nodes, sol.t[i], inside.ravel(), first, sol.t[-1:]]
    for corner in corners:
        parts.append([np.nextafter(corner, 0), corner, np.nextafter(corner, np.inf)])
        length = sol.t[np.clip(np.searchsorted(sol.t, corner, "right"), 1, n)] - corner
        parts.append(corner + length * np.geomspace(1e-9, 1, 7))
        parts.append(corner - length * np.geomspace(1e-9, 1e-1, 3))
    t = np.unique(np.concatenate(parts))
    return t[(t >= 0) & (t <= sol.t[-1])]


def measured(problem, sol, confirm, left=None):
    """Largest errors over tolerance of y and of y', where, and whether the truth is doubtful.

    Some of the times that are `left` are passed over. There the run agrees with a second way to the
    exact solution and the first does not.
    """
    t = left = points(problem, sol) if left is None else left
    ratio = over_tolerance(problem, sol, t, 0)
    worst = int(np.argmax(ratio.max(axis=1)))
    out = {"ratio": float(ratio.max()), "slope_ratio": 0.0, "t_worst": float(t[worst])}
    if problem.truth.orders.max() > 1:
        slopes = over_tolerance(problem, sol, t, 1)
        out["slope_ratio"] = float(slopes.max())
        if out["ratio"] <= 1 < out["slope_ratio"]:
            out["t_worst"] = float(t[np.argmax(slopes.max(axis=1))])
    wrong = max(out["ratio"], out["slope_ratio"]) > 1  # else two ways agree: the run's is one
    if confirm or wrong:
        off = truth_error(problem, out["t_worst"])
        out |= {"truth_error": off, "doubtful": wrong and bool(off > 0.1 * problem.rtol)}
    if out.get("doubtful") and len(left) > 1 and agrees(problem, sol, out["t_worst"]):
        return measured(problem, sol, confirm, left[left != out["t_worst"]])
    return out


def agrees(problem, sol, t):
    """Whether a run is within its tolerance of the second way to the exact solution at t > 0."""
    truth = problem.truth
    for k in (0, 1) if truth.orders.max() > 1 else (0,):
        judged_there = (truth.orders.max(axis=0) > 1) | (k == 0)
        right = second_opinion(truth, t, k, _DIGITS)
        least = least_sizes(problem, np.linspace(0, t, 50), k)[-1]
        off = np.abs(sol(t, k) - right) / (problem.rtol * (np.abs(right) + least))
        if np.any(off[judged_there] > 1):
            return False
    return True


def least_sizes(problem, t, derivative):
    """Size that counts of a component however small it is at times t, (n, d)."""
    sizes = np.maximum.accumulate(np.abs(problem.solution(t)))
    sizes = np.where(problem.truth.start[0] == 0, sizes[-1], sizes)
    return np.maximum((0.04 / problem.t_end if derivative else 0.01) * sizes, 1e-200)


def over_tolerance(problem, sol, t, derivative):
    """Errors over tolerance at times t, shape (n, d); 0 for y' of components up to order 1."""
    truth = problem.truth
    value = problem.solution(t, derivative)
    size = np.maximum.accumulate(np.abs(value))
    above = truth.orders.max(axis=0) > 1
    for corner in (0.0, *problem.breaks) if derivative else ():
        step = (t >= corner) & (t <= sol.t[np.searchsorted(sol.t[:-1], corner, "right")])
        largest = np.abs(value[step]).max(axis=0, initial=0.0)
        size[step] = np.maximum(size[step], largest)
    size += least_sizes(problem, t, derivative)
    tolerance = problem.rtol * size * amplification(problem, t, derivative, size)
    found = sol(t, derivative)
    error = np.abs(found - value)
    if not derivative:  # rows are to be what the dense output is
        at = np.isin(t, sol.t)
        rows = sol.y[np.searchsorted(sol.t, t[at])]
        error[at] = np.maximum(error[at], np.abs(rows - value[at]))
    error = np.where(above | (derivative == 0), error, 0.0)
    error[~np.isfinite(found) & (above | (derivative == 0))] = np.inf
    beyond = np.any(error > tolerance, axis=1)
    if beyond.any():
        if truth.d > 1:
            tolerance[beyond] *= later_amplification(problem, t[beyond], derivative)
        tolerance[beyond] += allowance(problem, t[beyond], derivative)
    return error / tolerance


def amplification(problem, t, derivative, scale):
    """What relative changes of initial values and forces grow to, over the scale; 1 at least."""
    truth = problem.truth
    if problem.perturbed:
        value = problem.solution(t, derivative)
        moved = [np.abs(other(t, derivative) - value) for other in problem.perturbed]
        return np.maximum(1.0, np.maximum.accumulate(np.max(moved, axis=0) / problem.rtol / scale))
    if truth.d == 1:
        return 1.0
    return np.maximum(1.0, np.abs(truth.shares(t, derivative)).sum(axis=2) / scale)


def later_amplification(problem, t, derivative):
    """What relative changes of y and y' made at a later time grow to; 1 at least.

    Of a Jordan block's solution that is t**2 times an oscillation they are some of what follows.
    """
    truth, out = problem.truth, np.ones((t.size, problem.truth.d))
    least = [least_sizes(problem, t, k) for k in (0, 1)]
    scale = np.maximum(np.abs(problem.solution(t, derivative)), least[derivative])
    unit = replace(truth, start=np.ones((2, truth.d)), forces=())
    for since in _LATER * t[-1]:
        later = t > since
        moved = np.abs(unit.shares(t[later] - since, derivative))
        first = np.searchsorted(t, since)
        sizes = [np.abs(problem.solution(t[[first]], k)[0]) + least[k][first] for k in (0, 1)]
        sizes[1] *= truth.orders.max(axis=0) > 1
        grown = moved @ np.concatenate(sizes) / scale[later]
        out[later] = np.maximum(out[later], grown)
    return out


def allowance(problem, t, derivative):
    """How far rounding of numbers and of times moves the solution: the most of a few draws."""
    found = [np.zeros((t.size, problem.truth.d))]
    for seed in range(1, 4):
        with contextlib.suppress(ValueError):  # poles that cannot be told apart
            found.append(_rounded(problem, t, derivative, seed))
    return np.max(found, axis=0)


def _rounded(problem, t, derivative, seed):
    truth = problem.truth
    rng = np.random.default_rng(seed)

    def rounded(array):
        return array * (1 + _ROUNDING * rng.choice([-1, 1], np.shape(array)))

    forces = [replace(f, amplitudes=tuple(rounded(np.array(f.amplitudes)))) for f in truth.forces]
    coefficients = rounded(truth.coefficients) if len(truth.orders) > 1 else truth.coefficients
    other = replace(truth, matrix=rounded(truth.matrix), coefficients=coefficients, forces=forces)
    before, now, after = truth(np.r_[t * (1 - _TICK), t, t * (1 + _TICK)], derivative).reshape(
        3, t.size, truth.d
    )
    return np.abs(other(t, derivative) - now) + np.abs(after - before)


def truth_error(problem, t):
    """Distance of two ways to the exact solution at t, over its size; nan where it takes long."""
    t, truth = min(t, problem.settles), problem.truth
    turns = [abs(np.exp(float(z.real) + np.log(t or 1e-300))) for z, *_ in truth.poles]
    if t == 0 or max(turns, default=0.0) > _LONG:
        return float("nan")
    derivatives = (0, 1) if truth.orders.max() > 1 else (0,)
    degree = int(60 + 3 * max(turns, default=0.0))
    off = 0.0
    for k in derivatives:
        value = truth(np.array([t]), k)[0]
        scale = np.abs(truth.shares(np.array([t]), k)[0]).sum(axis=1) + 1e-200
        other = second_opinion(truth, t, k, degree)
        off = max(off, float((np.abs(value - other) / scale).max()))
    return off
