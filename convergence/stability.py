"""Where every scheme stays bounded, and what hard cases do to its accuracy.

* ``D^alpha y = -K y``, alpha <= 1: L1, L2, L2Sigma and ProductTrapezoid are bounded up to K h^alpha
  = 1e6; above order 1 L1 alone is.
* ExplicitCaputo leaves at its `step_limit`, ProductTrapezoid above order 1 at
  Gamma(beta+2) / (4 abs(eta(-1-beta))), Adams up to order 1 at Gamma(alpha+2).
* Without damping, 10^4 periods keep the amplitude, but for L1, which is of first order there.
* Errors are continuous at orders 1 and 2, and rounding stays invisible at N = 1e7.
* At orders 0.02 and 0.05 the solution at t = 1 is right to 1e-6. Steps are uniform, and for L1 and
  L2Sigma also graded. L2 on steep meshes is wrong without a sign of it.
"""

import warnings

import numpy as np
from _study import Claim, chosen, curves, side_by_side, study
from scipy.special import gamma, zeta

import hereditary as hd
from hereditary import exact
from hereditary.given.schemes import bdf

EXPLICIT, TRAPEZOID = hd.ExplicitCaputo(), hd.ProductTrapezoid()
ADAMS = [hd.Adams(), hd.Adams(corrections=3)]
UP_TO_ONE = [EXPLICIT, hd.L1(), hd.L2(), hd.L2Sigma(), *ADAMS, TRAPEZOID]
UP_TO_TWO = [EXPLICIT, hd.L1(), *ADAMS, TRAPEZOID]
GRADED = [hd.L1(), hd.L2(), hd.L2Sigma()]
RATIOS = np.geomspace(0.1, 1e6, 22)


def decay(t, y, dy, params):
    """-K y."""
    dy[0] = -params[0] * y[0]


def start(order):
    """y(0) = 1 and, above order 1, y'(0) = 0."""
    return 1.0 if order <= 1 else [1.0, 0.0]


def solve(scheme, order, rate, t_end, n=None, y0=None, **options):
    y0 = start(order) if y0 is None else y0
    equation = hd.Equation(hd.Caputo(order), decay, y0, params=(float(rate),))
    return hd.solve(equation, t_end, n, scheme=scheme, **options)


def row(case, scheme, order, parameter, value, bound="", status=""):
    return {
        "case": case,
        "scheme": repr(scheme),
        "order": repr(order),
        "parameter": parameter,
        "value": f"{value:.9g}",
        "bound": bound if isinstance(bound, str) else f"{bound:.6g}",
        "verdict": str(status),
    }


def measure_stiff(quick):
    """Largest K h^order on the grid up to which all runs are bounded by y(0), and what is left."""
    rows = []
    for order in (0.3, 0.6, 0.9, 1.05, 1.2, 1.5, 1.8, 1.95, 2.0)[:: 4 if quick else 1]:
        for scheme in UP_TO_ONE if order <= 1 else UP_TO_TWO:
            reached, worst = 0.0, ""
            for ratio in RATIOS[:: 3 if quick else 1]:
                sol = solve(scheme, order, ratio, 400.0, 400)
                # the undamped explicit scheme swings by 1 / sqrt(1 - K h^2 / 4)
                if not np.abs(sol.y).max() <= (1 + 1e-9 if order <= 1 else 12):
                    worst = f"not beyond: {sol.status}"
                    break
                reached = ratio
            rows.append(
                row("bounded", scheme, order, "K h^order up to", reached, "", worst or "all")
            )
    for order in (0.3, 0.6, 0.9, 1.0):
        for scheme in (*GRADED, TRAPEZOID):
            left = np.abs(solve(scheme, order, 1e6, 400.0, 400).y[-10:]).max()
            true = exact.relaxation(order, 1e6)(390.0)[0]
            rows.append(row("left at 1e6", scheme, order, "400 steps", left, f"exact {true:.2g}"))
    return rows


def outgrows(scheme, order, ratio, n):
    """Whether the last quarter of a run outgrows all before it by more than 1 per cent."""
    y = np.abs(solve(scheme, order, ratio, float(n), n).y[:, 0])
    return y.size <= n or not y[3 * n // 4 :].max() <= 1.01 * y[: 3 * n // 4].max()


def closed_form(scheme, order):
    """K h^order at which a mode leaves the unit circle: at -1, for Adams at 1."""
    if isinstance(scheme, hd.ExplicitCaputo):
        equation = hd.Equation(hd.Caputo(order), decay, start(order), params=(1.0,))
        return scheme.step_limit(equation, 1.0) ** order
    if isinstance(scheme, hd.Adams):
        return gamma(order + 2) if order <= 1 else ""  # odd sweeps: they contract below it
    if isinstance(scheme, hd.ProductTrapezoid):
        eta = (1 - 2 ** (2 + order)) * zeta(-1 - order)
        return gamma(order + 2) / 4 / abs(eta)
    return ""


def measure_limits(quick):
    rows = []
    orders = [0.05, 0.1, 0.2, 0.3, 0.5, 0.7, 0.8, 0.9, 0.95, 1.0]
    above = [1.05, 1.1, 1.2, 1.4, 1.5, 1.6, 1.8, 1.9, 1.95, 2.0]
    for scheme in (EXPLICIT, *ADAMS, TRAPEZOID):
        for order in (above if scheme == TRAPEZOID else orders + above)[:: 5 if quick else 1]:
            low, high = 1e-3, 1e3
            for _ in range(8 if quick else 14):
                middle = np.sqrt(low * high)
                if outgrows(scheme, order, middle, 500 if quick else 4000):
                    high = middle
                else:
                    low = middle
            bound = closed_form(scheme, order)
            rows.append(row("limit", scheme, order, "K h^order", np.sqrt(low * high), bound))
    return rows


def measure_long(quick):
    """Amplitude and phase, relative to the exact ones, after many periods of 2 pi."""
    rows = []
    for order, periods in ((2.0, 10_000), (1.9999, 10_000), (1.999, 1000)):
        periods = periods // 100 if quick else periods
        for per in (100, 200, 400) if order == 2 else (400,):
            # a period after each hundredth of the run: the phase is followed from one to the next
            count = min(100, periods)
            last = np.arange(1, count + 1) * (periods // count) * per
            steps = (last[:, None] - per + (per // 20) * np.arange(1, 21)).ravel()
            t = steps * (2 * np.pi / per)
            true = phasors(t, exact.relaxation(order, 1.0, [1.0, 0.0])(t)[:, 0])
            for scheme in UP_TO_TWO:
                sol = solve(scheme, order, 1.0, t[-1], int(steps[-1]), t_eval=t)
                x = np.zeros(t.size)  # a run that ends early has decayed to nothing
                x[: sol.y.shape[0]] = sol.y[:, 0]
                phase = np.unwrap(np.angle(phasors(t, x) / true))[-1]
                size = abs(phasors(t, x, 1 + phase / t[-1])[-1] / true[-1])
                what = f"{periods} periods of {per} steps"
                rows.append(row("amplitude", scheme, order, what, size, 1.0, sol.status))
                rows.append(
                    row("phase", scheme, order, what, phase if size > 1e-3 else np.nan, 0.0)
                )
    return rows


def measure_sector(quick):
    """What is left late of D^beta y = -K y by BDF(p) just inside its sector, and just outside.

    The scheme refuses the outside; its table of limits is lifted for the measurement.
    """
    rows, table = [], bdf._LARGEST_ORDER
    ratios = 10.0 ** np.arange(-1, 6.5, 0.5 if quick else 0.1)
    cases = ((2, 2.0), (3, 1.90), (3, 1.93), (4, 1.67), (4, 1.70), (5, 1.39), (5, 1.42))
    for p, order in (*cases, (6, 1.10), (6, 1.20)):
        inside = order <= table[p - 1]
        bdf._LARGEST_ORDER = (2.0,) * 6
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            runs = (
                solve(hd.BDF(p), order, ratio, 3000.0, 3000, history=hd.FFT()) for ratio in ratios
            )
            left = max(np.abs(run.y[-300:]).max() for run in runs)
        bdf._LARGEST_ORDER = table
        rows.append(row("sector", hd.BDF(p), order, "inside" if inside else "outside", left))
    return rows


def phasors(t, x, frequency=1.0):
    """c in x = Re(c exp(i frequency t)) from each period of 20 samples."""
    turn = np.exp(-1j * frequency * t).reshape(-1, 20)
    mean, image = (x.reshape(-1, 20) * turn).mean(axis=1), (turn**2).mean(axis=1)
    return 2 * (mean - image * mean.conj()) / (1 - np.abs(image) ** 2)


def measure_near_integers(quick):
    """Largest error on [0, 5] with 2,000 steps; above order 1 with y'(0) = 0.5."""
    rows = []
    for k in (2, 8) if quick else (1, 2, 3, 4, 6, 8, 10, 12, 14):
        for side, order in (("1-", 1 - 10.0**-k), ("1+", 1 + 10.0**-k), ("2-", 2 - 10.0**-k)):
            y0 = 1.0 if order <= 1 else [1.0, 0.5]
            for scheme in UP_TO_ONE if order <= 1 else UP_TO_TWO:
                sol = solve(scheme, order, 1.0, 5.0, 2000, y0)
                error = np.abs(sol.y - exact.relaxation(order, 1.0, y0)(sol.t)).max()
                rows.append(row(f"near {side}", scheme, order, k, error, "", sol.status))
    return rows


def measure_many(quick):
    """Error at t = 20 with 1e7 steps, and with 1e5."""
    rows = []
    few, many = (10**3, 10**4) if quick else (10**5, 10**7)
    for scheme, order in (
        *((EXPLICIT, order) for order in (0.6, 1.8)),
        *((hd.L1(), order) for order in (0.6, 1.2, 1.8)),
        (hd.Adams(), 1.8),
        (TRAPEZOID, 1.8),
    ):
        true = exact.relaxation(order, 1.0, start(order))(20.0)[0]
        error = {}
        for n in (few, many):
            history = hd.SumOfExponentials(1e-13)
            sol = solve(scheme, order, 1.0, 20.0, n, save_every=n, history=history)
            error[n] = abs(sol.y[-1, 0] - true)
        rows.append(
            row("many", scheme, order, f"N = {many:.0e}", error[many], error[few], sol.status)
        )
    return rows


def measure_small(quick):
    """Errors at t = 1 and at all times; uniform steps are graded ones of exponent 1."""
    rows = []
    n = 300 if quick else 10_000
    for order in (0.02, 0.05):
        true = exact.relaxation(order, 1.0)
        for scheme in UP_TO_ONE:
            for exponent in (1, 2, 5, 10, 20, 40) if scheme in GRADED else (1,):
                mesh = {"n": n} if exponent == 1 else {"mesh": hd.graded(n, float(exponent))}
                sol = solve(scheme, order, 1.0, 1.0, **mesh)
                off = np.abs(sol.y - true(sol.t))
                for case, error, bound in (("end", off[-1, 0], 1e-6), ("all", off.max(), 1e-2)):
                    verdict = f"{sol.status}, {'below' if error < bound else 'above'}"
                    rows.append(row(case, scheme, order, exponent, error, bound, verdict))
    return rows


def measure(quick):
    parts = (
        measure_stiff,
        measure_limits,
        measure_long,
        measure_near_integers,
        measure_many,
        measure_small,
        measure_sector,
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", hd.StabilityWarning)
        return [found for part in parts for found in part(quick)]


def claims(rows):
    yield from bounds(rows)
    yield from accuracy(rows)
    sector = {kind: chosen(rows, case="sector", parameter=kind) for kind in ("inside", "outside")}
    inside = max(row["value"] for row in sector["inside"])
    yield Claim("BDF inside its sector: left of y(0) after 3,000 steps", inside, 1, small=True)
    outside = min(row["value"] for row in sector["outside"])
    yield Claim("BDF just outside it: grown times", outside, at_least=1e6, small=True)


def bounds(rows):
    for scheme in map(repr, (*GRADED, TRAPEZOID)):
        for row in chosen(rows, case="bounded", scheme=scheme):
            if row["order"] <= 1 or scheme == "L1()":
                orders = "orders up to 1" if row["order"] <= 1 else "L1 above order 1"
                text, where = f"bounded up to K h^alpha, {orders}", f"{scheme}, {row['order']:g}"
                yield Claim(text, row["value"], at_least=0.99e6, where=where)
    for row in chosen(rows, case="limit"):
        if row["bound"] != "":
            off, where = abs(row["value"] / row["bound"] - 1), f"order {row['order']:g}"
            yield Claim(f"{row['scheme']} leaves off its closed form", off, 0.01, where=where)


def accuracy(rows):
    for side in ("1-", "1+", "2-"):
        near = chosen(rows, case=f"near {side}")
        worst = max(row["value"] for row in near)
        yield Claim("largest error at orders near 1 and 2", worst, 0.01, where=side)
        for scheme in map(repr, UP_TO_ONE):
            ends = [row["value"] for row in chosen(near, scheme=scheme) if row["parameter"] >= 6]
            if ends:
                jump, where = max(ends) / min(ends) - 1, f"{side}, {scheme}"
                yield Claim("errors within 1e-6 of 1 and 2 differ by", jump, 0.05, where=where)
    for scheme in map(repr, UP_TO_TWO):
        finest = chosen(rows, case="amplitude", scheme=scheme, order=2.0)[-1]
        if scheme != "L1()":
            text = "order 2, finest steps: amplitude off by"
            yield Claim(text, abs(finest["value"] - 1), 1e-4, where=scheme)
    for row in chosen(rows, case="many"):
        where = f"{row['scheme']}, order {row['order']:g}"
        allowed = max(row["bound"] / 50, 1e-11)
        text = "error at N = 1e7 over what N = 1e5 allows"
        yield Claim(text, row["value"] / allowed, 1, where=where)
    for row in chosen(rows, case="end"):
        if row["scheme"] != "L2()" or row["parameter"] == 1:
            where = f"{row['scheme']}, order {row['order']:g}, mesh exponent {row['parameter']:g}"
            yield Claim("error at t = 1, orders 0.02 and 0.05", row["value"], 1e-6, where=where)


def draw(rows):
    rows = [row | {"steps": row["parameter"]} for row in rows]
    for row in rows:
        if row["case"] == "amplitude":
            row["steps"] = int(row["parameter"].split()[3])
            row["value"] = max(abs(row["value"] - row["bound"]), 1e-9)  # as far as printed
    lines = {"lines": ("scheme",)}
    limits = {"ylabel": "K h^order, measured (marks), theory (dotted)", "title": "Largest stable"}
    limits |= {"log": "y", "line": "", "of": {"case": "limit"}}
    drift = {"ylabel": "drift of the amplitude", "title": "Order 2, 10,000 periods"}
    small = {"ylabel": "largest error", "title": "Order 0.05", "xlabel": "exponent of the mesh"}
    return side_by_side(
        curves("order", ("value", "bound"), **lines, **limits),
        curves("steps", "value", of={"case": "amplitude", "order": 2.0}, **lines, **drift),
        curves("steps", "value", of={"case": "all", "order": 0.05}, **lines, **small),
    )(rows)


if __name__ == "__main__":
    study(measure, claims, draw)
