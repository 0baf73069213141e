"""Delays: errors are within the tolerance; given steps and a published scheme beside it.

D^alpha y = k y(t - 1), with y = 1 up to 0, is a sum of powers of t - j. The runs end at t = 10.
Beside them is the predictor-corrector of Bhalekar and Daftardar-Gejji, in NumPy, whose sums cost
O(N^2). Mackey and Glass's equation of order 0.95 has known values at t = 20 and 60. An equation of
order 1 is compared with the method of steps by polynomials in 30 digits.
Claims:

* errors are below the tolerance, from 1e-4 to 1e-11, for orders from 0.7 to 1.5, and to 1e-8 for
  0.3;
* a tolerance of 1e-4 has a quarter of the error of the predictor-corrector with 4,000 steps, or
  less;
* pasts with a jump, with corners and of 201 noisy data are met to the tolerance;
* a row without a derivative carries jumps on over 20 delays;
* networks of phase oscillators with 10 and 60 delays err by less than the tolerance;
* they take fewer than 150 and 500 steps to t = 10;
* so do drawn systems of 1 to 20 delays and of orders from 0.3 to 1.9;
* ten thousand short delays cost less than 500 times as much as ten.
"""

import warnings
from functools import partial

import mpmath
import numpy as np
from _study import Claim, chosen, curves, fastest, study
from problems import MACKEY_GLASS, delayed_growth, delayed_growth_at, mackey_glass
from scipy.special import gamma

import hereditary as hd

T_END = 10.0
CASES = [(alpha, k) for alpha in (0.3, 0.7, 1.0, 1.5) for k in (-2.0, 0.5)]
TOLERANCES = [1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10, 1e-11]
SCHEMES = [hd.ExplicitCaputo(), hd.L1(), hd.Adams(), hd.BDF(2)]


def predictor_corrector(alpha, k, n_steps):
    """Rows of Bhalekar and Daftardar-Gejji's scheme, whose delay is a multiple of h."""
    h = T_END / n_steps
    m = round(1.0 / h)
    n = np.arange(n_steps + 2.0)
    unit, powers = h**alpha / gamma(alpha + 2), n ** (alpha + 1)
    inner = powers[2:] + powers[:-2] - 2 * powers[1:-1]
    first = powers[:-1] - (n[:-1] - alpha) * n[1:] ** alpha
    y, f = np.ones(n_steps + 1), np.full(n_steps + 1, k)
    for i in range(n_steps):
        past = first[i] * f[0] + (inner[:i][::-1] @ f[1 : i + 1] if i else 0.0)
        f[i + 1] = k * (y[i + 1 - m] if i + 1 >= m else 1.0)  # known: no prediction is needed
        y[i + 1] = 1.0 + unit * (past + f[i + 1])
    return y


def classical(t_end):
    """y(t_end) of y' = -y + y(t - 1) / 2, y = 1 up to 0, by Taylor polynomials of 30 digits."""
    with mpmath.workdps(40):
        parts, n_parts, degree = [[mpmath.mpf(1)]], 16, 24
        before, y = [parts[0]] * n_parts, mpmath.mpf(1)
        for _ in range(round(t_end)):
            now, h = [], mpmath.mpf(1) / n_parts
            for i in range(n_parts):
                c = [y]
                for q in range(degree):
                    delayed = before[i][q] if q < len(before[i]) else mpmath.mpf(0)
                    c.append((-c[q] + delayed / 2) / (q + 1))
                now.append(c)
                y = mpmath.polyval(c[::-1], h)
            before = now
        return float(y)


def measure(quick):
    return [*(row for case in CASES for row in rows_of(*case, quick)), *others(quick)]


def rows_of(alpha, k, quick):
    """Rows of one equation, by all methods."""
    given, rows, times = delayed_growth(alpha, k), [], np.linspace(0.25, T_END, 40)
    known = delayed_growth_at(alpha, k, times)
    size = np.abs(known).max()

    def add(method, seconds, values, rtol="", n=""):
        error = float(np.abs(values - known).max() / size)
        row = {"alpha": alpha, "k": k, "method": method, "rtol": rtol, "n": n}
        rows.append(row | {"error": f"{error:.2e}", "ms": round(1e3 * seconds, 3)})

    for rtol in TOLERANCES[:: 3 if quick else 1]:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", hd.SolveWarning)  # order 0.3 beyond 1e-9
            if not hd.solve(given, T_END, rtol=rtol).success:
                continue
        seconds, sol = fastest(partial(hd.solve, given, T_END, rtol=rtol), within=0.3)
        add("Collocation", seconds, sol(times)[:, 0], rtol=rtol)
    for n in (400, 800) if quick else (400, 800, 1600, 4000):
        how = {"t_eval": times, "estimate": False}
        for scheme in SCHEMES:
            run = partial(hd.solve, given, T_END, n, scheme=scheme, **how)
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", hd.StabilityWarning)
                seconds, sol = fastest(run, within=0.3)
            add(repr(scheme), seconds, sol.y[:, 0], n=n)
        if alpha <= 1:
            seconds, y = fastest(partial(predictor_corrector, alpha, k, n), within=0.3)
            values = np.interp(times, np.linspace(0.0, T_END, n + 1), y)
            add("predictor-corrector", seconds, values, n=n)
    return rows


def others(quick):
    """Claims of equations that are no sums of powers."""
    found = hd.solve(mackey_glass(), 60.0, rtol=1e-9, t_eval=list(MACKEY_GLASS)).y[:, 0]
    error = float(np.abs(found - list(MACKEY_GLASS.values())).max())
    half = hd.Equation(hd.Caputo(1), lambda t, y, z: 0.5 * z[0] - y, 1.0, memory=hd.Delay(1.0))
    known = classical(T_END)
    apart = abs(hd.solve(half, T_END, rtol=1e-11).y[-1, 0] - known) / abs(known)
    return [
        Claim("error of Mackey and Glass's equation, rtol 1e-9", error, at_most=2e-8, small=True),
        Claim("error of the equation of order 1, rtol 1e-11", apart, at_most=1e-11, small=True),
        *pasts(),
        jumps_carried_on(),
        *networks(),
        *drawn_systems(10 if quick else 60),
        *large_network(),
        *infection(),
        *epidemic(),
        *short_delays(),
    ]


def pasts():
    """Claims of y' = y(t - 1) from pasts that are no polynomials, over the first delay."""
    data, times = 1 + 0.3 * np.random.default_rng(0).normal(size=201), np.linspace(-1, 0, 201)
    known = {
        "a jump": (lambda t: 1.0 if t > -0.37 else 0.0, 0.37),
        "corners": (lambda t: abs(np.sin(12 * t)), (7 - np.cos(12 - 3 * np.pi)) / 12),
        "data": (lambda t: np.interp(t, times, data), np.trapezoid(data, times)),
    }
    for name, (past, integral) in known.items():
        given = hd.Equation(hd.Caputo(1), lambda t, y, z: z[0], 0.0, memory=hd.Delay(1.0, past))
        for rtol in (1e-4, 1e-8):
            error = abs(hd.solve(given, 1.0, rtol=rtol).y[-1, 0] - integral) / integral
            where = f"{name}, rtol {rtol:g}"
            yield Claim(
                "error of a past over tolerance", error / rtol, at_most=1.0, where=where, small=True
            )


def jumps_carried_on():
    """Claim of p = p(t - 1) / 2 + cos t, which jumps at each delay."""
    given = hd.Equation(
        0 * hd.Caputo(1),
        lambda t, p, z: 0.5 * z[0] + np.cos(t) - p,
        1.35,
        memory=hd.Delay(1.0, 0.7),
    )
    known = 0.7 * 0.5**20 + sum(0.5**k * np.cos(19.5 - k) for k in range(20))
    error = abs(hd.solve(given, 19.5, rtol=1e-8).y[-1, 0] - known)
    return Claim("error of a difference equation, rtol 1e-8", error, at_most=1e-8, small=True)


def network(n):
    """Five phase oscillators with n delayed couplings, drawn with a fixed seed."""
    random = np.random.default_rng(1)
    target, source = random.integers(0, 5, n), random.integers(0, 5, n)
    speed, taus = random.normal(1.0, 0.3, 5), random.uniform(0.5, 1.5, n)

    def phases(t, y, late):
        slope = speed.copy()
        for k in range(n):
            slope[target[k]] += 0.6 * np.sin(late[k, source[k]] - y[target[k]])
        return slope

    start, memory = random.uniform(0.0, 6.0, 5), [hd.Delay(tau) for tau in taus]
    return hd.Equation(hd.Caputo([1.0] * 5), phases, start, memory=memory)


def networks():
    """Claims of networks with many delays."""
    for n, most in ((10, 150), (60, 500)):
        given = network(n)
        fine, sol = (hd.solve(given, T_END, rtol=rtol) for rtol in (1e-9, 1e-6))
        times = np.linspace(0.0, T_END, 40)
        error = np.abs(sol(times) - fine(times)).max() / np.abs(fine.y).max()
        where = f"{n} delays, rtol 1e-6"
        yield Claim("error over tolerance", error / 1e-6, at_most=1.0, where=where, small=True)
        steps = sol.stats["n_steps"]
        yield Claim("steps of a network", steps, at_most=most, where=where, small=True)


def coupled(t, y, late, p):
    """Components that decay, beside late[k] of the delays; p as in `drawn`."""
    d, n = y.size, int(p[0])
    out = -p[1 : 1 + d] * y
    for k in range(n):
        gain, target, source = p[4 + 3 * k : 7 + 3 * k]
        out[int(target)] += gain * np.tanh(late[k, int(source)])
    return out


def drawn(random):
    """A system of 1 to 3 components, whose orders, delays, couplings and pasts are drawn."""
    d, n = random.integers(1, 4), random.integers(1, 21)
    orders = np.sort(random.uniform(0.3, 1.9, d))
    decay, start = np.append(random.uniform(0.5, 2.0, d), np.zeros(3 - d)), random.normal(1, 0.5, d)
    edges = [random.normal(0.0, n**-0.5, n), random.integers(0, d, n), random.integers(0, d, n)]
    params = np.concatenate([[n], decay, np.transpose(edges).ravel()])

    def moving(t):
        return start * np.cos(3 * t) + 0.3 * t * t

    past = random.choice([None, moving, 0.0])
    memory = [hd.Delay(tau, past) for tau in random.uniform(0.3, 3.0, n)]
    y0 = np.stack([start, np.zeros(d)])[: 1 + int(orders.max() > 1)].squeeze()
    return hd.Equation(
        hd.Caputo(orders if d > 1 else orders[0]), coupled, y0, params, memory=memory
    )


def drawn_systems(n):
    """Claims of n systems whose delays are drawn."""
    random, times = np.random.default_rng(7), np.linspace(0.2, T_END, 50)
    worst = {1e-4: 0.0, 1e-6: 0.0}
    for _ in range(n):
        given = drawn(random)
        fine = hd.solve(given, T_END, rtol=1e-8)
        for rtol in worst:
            apart = np.abs(hd.solve(given, T_END, rtol=rtol)(times) - fine(times)).max(axis=0)
            worst[rtol] = max(worst[rtol], float((apart / np.abs(fine.y).max(axis=0)).max()) / rtol)
    for rtol, error in worst.items():
        where = f"{n} drawn systems, rtol {rtol:g}"
        yield Claim("error over tolerance", error, at_most=1.0, where=where, small=True)


def large_network():
    """Claim of the time of 100 phase oscillators with 477 delays, on 200 given steps."""
    random, n, n_delays = np.random.default_rng(3), 100, 477
    target, source = random.integers(0, n, n_delays), random.integers(0, n, n_delays)
    speed = random.normal(1.0, 0.3, n)

    def phases(t, y, late):
        slope = speed.copy()
        for k in range(n_delays):
            slope[target[k]] += 0.3 * np.sin(late[k, source[k]] - y[target[k]])
        return slope

    memory = [hd.Delay(tau) for tau in random.uniform(0.2, 2.0, n_delays)]
    given = hd.Equation(hd.Caputo(1.0), phases, random.uniform(0.0, 6.0, n), memory=memory)
    run = partial(hd.solve, given, T_END, 200, estimate=False)
    yield Claim("seconds of 477 delays, 200 given steps", fastest(run, within=0.3)[0])


def immune_reaction(t, y, late):
    """Virus, plasma cells, antibodies and damage of Marchuk's model."""
    virus, cells, antibodies, damage = y
    share = 1.0 if damage <= 0.1 else (1.0 - damage) * 10 / 9
    return np.array(
        [
            (2.0 - 0.8 * antibodies) * virus,
            share * 1e4 * late[0, 2] * late[0, 0] - 0.5 * (cells - 1.0),
            0.17 * (cells - antibodies) - 8.0 * antibodies * virus,
            300.0 * virus - 0.12 * damage,
        ]
    )


def infection():
    """Claims of Marchuk's model, whose past has a ramp of 1e-6 before the start."""

    def past(t):
        return np.array([max(0.0, 1e-6 + t), 1.0, 1.0, 0.0])

    given = hd.Equation(
        hd.Caputo([1.0] * 4), immune_reaction, past(0.0), memory=hd.Delay(0.5, past)
    )
    atol = np.array([1e-12, 1.0, 1.0, 1.0])  # the virus falls to 5e-15, and grows again
    fine = hd.solve(given, 60.0, rtol=1e-9, atol=1e-9 * atol)
    run = partial(hd.solve, given, 60.0, rtol=1e-6, atol=1e-6 * atol)
    seconds, sol = fastest(run, within=0.3)
    times = np.linspace(0.0, 60.0, 200)
    error = np.abs(sol(times) - fine(times)).max(axis=0) / np.abs(fine.y).max(axis=0)
    where = "immune reaction"
    yield Claim("error over tolerance", error.max() / 1e-6, at_most=1.0, where=where, small=True)
    yield Claim("seconds of the immune reaction to t = 60", seconds)


def seirs(t, y, late):
    """Susceptible, exposed, infectious, recovered; immunity fades after 42, latency is 0.15."""
    s, e, i, r = y
    faded, caught = late[0], late[1]
    infected = 0.308 * caught[0] * caught[2] / caught.sum() * np.exp(-0.006 * 0.15)
    returned = 0.04 * faded[2] * np.exp(-0.006 * 42)
    new = 0.308 * s * i / (s + e + i + r)
    return np.array(
        [
            0.33 - 0.006 * s - new + returned,
            new - infected - 0.006 * e,
            infected - 0.106 * i,
            0.04 * i - returned - 0.006 * r,
        ]
    )


def epidemic():
    """Claim of a model with a long and a short delay, and reported times."""
    memory = [hd.Delay(42.0), hd.Delay(0.15)]
    given = hd.Equation(hd.Caputo([1.0] * 4), seirs, [15.0, 0.0, 2.0, 3.0], memory=memory)
    times = np.linspace(0.0, 350.0, 200)
    fine = hd.solve(given, 350.0, rtol=1e-9)(times)
    seconds, sol = fastest(partial(hd.solve, given, 350.0, rtol=1e-6), within=0.3)
    error = np.abs(sol(times) - fine).max() / np.abs(fine).max()
    yield Claim("error over tolerance", error / 1e-6, at_most=1.0, where="SEIRS", small=True)
    yield Claim("seconds of the SEIRS model to t = 350", seconds)
    for n in (10, 20, 60):
        run = partial(hd.solve, network(n), T_END, rtol=1e-6)
        yield Claim(f"seconds of a network of {n} delays", fastest(run, within=0.3)[0])


def short_delays():
    """Claim of the cost of a delay that is short beside the run."""
    given = hd.Equation(hd.Caputo(1), lambda t, y, z: -z[0], 1.0, memory=hd.Delay(0.01))
    hd.solve(given, 0.02)
    (few, _), (many, _) = (
        fastest(partial(hd.solve, given, 0.01 * n, rtol=1e-6), within=0.3) for n in (10, 10_000)
    )
    yield Claim("time of 10,000 delays over that of 10", many / few, at_most=500.0)


def claims(rows):
    for row in rows:
        if row["method"] == "Collocation" and (row["alpha"] > 0.3 or row["rtol"] >= 1e-8):
            where = f"order {row['alpha']:g}, k = {row['k']:g}, rtol {row['rtol']:g}"
            over = row["error"] / row["rtol"]
            yield Claim("error over tolerance", over, at_most=1.0, where=where, small=True)
    for alpha, k in CASES:
        own = chosen(rows, alpha=alpha, k=k)
        beside = chosen(own, method="predictor-corrector")
        if not beside:
            continue
        loose = chosen(own, method="Collocation")[0]
        where, last = f"order {alpha:g}, k = {k:g}", beside[-1]
        fewer = "error of the predictor-corrector with 4,000 steps over that of rtol 1e-4"
        yield Claim(fewer, last["error"] / loose["error"], at_least=4.0, where=where)
        yield Claim(
            "time of rtol 1e-4 over that of the other", loose["ms"] / last["ms"], where=where
        )


if __name__ == "__main__":
    figure = curves("ms", "error", lines=("method",), panels=("alpha", "k"))
    study(measure, lambda rows: list(claims(rows)), figure)
