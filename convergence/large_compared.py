"""Large systems, compared with other ways to solve them and with the limits of the machine.

* Order 1: a Brusselator of 40 components to t = 10, against SciPy's Radau and LSODA: `Collocation`
  is as accurate in less time than Radau.
* Memory as further states: D^0.7 u = u_xx on 40 points against ``BDF(2)``. The modes of a sum of
  exponentials are given to SciPy's BDF as components.
* Reaction and diffusion, D^0.7 u = u_xx + 5 (u - u**3) on 1,000 points: implicit-explicit steps,
  which need no derivative, against Newton's method.
* Modes of 10^5 components are read and advanced in 3 to 4 times the time that their bytes take to
  be copied.
"""

import numpy as np
import scipy.sparse as sp
from _study import Claim, chosen, curves, fastest, study
from scipy.integrate import solve_ivp
from scipy.special import gamma

import hereditary as hd
from hereditary.compiled.reference import by_reference
from hereditary.exact import mittag_leffler
from hereditary.given.fixed_stepper import FixedStepper
from hereditary.given.signatures import HISTORY_TABLES, MEMORY
from hereditary.given.steps import UniformSteps

ALPHA, POINTS = 0.7, 20


def brusselator(t, y, dy, p):
    n = y.size // 2
    c = (n + 1) ** 2 / 50
    for i in range(n):
        u, v = y[2 * i], y[2 * i + 1]
        left, right = (y[2 * i - 2] if i > 0 else 1.0), (y[2 * i + 2] if i < n - 1 else 1.0)
        low, high = (y[2 * i - 1] if i > 0 else 3.0), (y[2 * i + 3] if i < n - 1 else 3.0)
        dy[2 * i] = 1 + u * u * v - 4 * u + c * (left - 2 * u + right)
        dy[2 * i + 1] = 3 * u - u * u * v + c * (low - 2 * v + high)


def vectorised(t, y):
    dy, u, v, c = np.empty_like(y), y[::2], y[1::2], (POINTS + 1) ** 2 / 50
    wide, high = np.concatenate([[1.0], u, [1.0]]), np.concatenate([[3.0], v, [3.0]])
    dy[::2] = 1 + u * u * v - 4 * u + c * (wide[:-2] - 2 * u + wide[2:])
    dy[1::2] = 3 * u - u * u * v + c * (high[:-2] - 2 * v + high[2:])
    return dy


def jacobian(t, y):
    u, v, c = y[::2], y[1::2], (POINTS + 1) ** 2 / 50
    own, crossed = np.empty(2 * POINTS), np.zeros((2, 2 * POINTS - 1))
    own[::2], own[1::2] = 2 * u * v - 4 - 2 * c, -u * u - 2 * c
    crossed[0, ::2], crossed[1, ::2] = u * u, 3 - 2 * u * v
    far = np.full(2 * POINTS - 2, c)
    parts = [far, crossed[1], own, crossed[0], far]
    return sum(np.diag(part, k - 2) for k, part in enumerate(parts))


def brusselator_rows(quick):
    x = np.arange(1, POINTS + 1) / (POINTS + 1)
    y0 = np.stack([1 + np.sin(2 * np.pi * x), np.full(POINTS, 3.0)], axis=1).ravel()
    how = {"jac": jacobian, "method": "Radau"}
    truth = solve_ivp(vectorised, (0, 10), y0, rtol=1e-12, atol=1e-12, **how).y[:, -1]
    equation = hd.Equation(hd.Caputo(1.0), brusselator, y0, bandwidth=(2, 2))
    for rtol in (1e-4,) if quick else (1e-3, 1e-4, 1e-6, 1e-8, 1e-10):
        ways = {
            name: lambda name=name, rtol=rtol: solve_ivp(
                vectorised, (0, 10), y0, name, rtol=rtol, atol=rtol, jac=jacobian
            ).y[:, -1]
            for name in ("Radau", "LSODA")
        }
        ways["Collocation"] = lambda rtol=rtol: hd.solve(equation, 10.0, rtol=rtol).y[-1]
        for name, run in ways.items():
            seconds, found = fastest(run, 1 if quick else 5, within=2)
            yield row("Brusselator", name, 40, seconds, np.abs(found - truth).max())


def laplacian(d):
    parts = np.array([1.0, -2.0, 1.0]) * (d + 1.0) ** 2
    return sp.diags_array(parts, offsets=[-1, 0, 1], shape=(d, d)).tocsr()


def states_rows(quick):
    """u = u(0) + sum_i c_i z_i with z_i' = -s_i z_i + A u, c and s of J^alpha's kernel."""
    d = 10 if quick else 40
    wave = np.sin(np.pi * np.arange(1, d + 1) / (d + 1))
    rate = (2 * (d + 1) * np.sin(np.pi / (2 * d + 2))) ** 2
    truth, matrix = mittag_leffler(-rate, ALPHA, 1.0) * wave, laplacian(d)
    fit = hd.fit_exponentials(hd.PowerLaw(1 - ALPHA), 1e-5, 2.0, 1e-5)
    rates, weights = fit.rates, fit.weights / gamma(ALPHA)
    sums = sp.kron(weights[None], sp.eye_array(d)).tocsr()
    lines = sp.kron(np.ones((rates.size, 1)), matrix).tocsr()
    jac = (sp.kron(-sp.diags_array(rates), sp.eye_array(d)) + lines @ sums).tocsc()

    def states(t, z):
        return jac @ z + np.tile(matrix @ wave, rates.size)

    def by_scipy():
        z0, how = np.zeros(d * rates.size), {"rtol": 1e-6, "atol": 1e-9, "jac": lambda t, z: jac}
        return wave + sums @ solve_ivp(states, (0, 1), z0, "BDF", **how).y[:, -1]

    equation = hd.Equation(hd.Caputo(ALPHA), None, wave, linear=matrix)
    how = {"scheme": hd.BDF(2), "save_every": 1000, "estimate": False}
    ways = {
        "SciPy's BDF, modes as states": by_scipy,
        "BDF(2)": lambda: hd.solve(equation, 1.0, 1000, **how).y[-1],
        "Collocation": lambda: hd.solve(equation, 1.0, rtol=1e-6).y[-1],
    }
    for name, run in ways.items():
        seconds, found = fastest(run, 1 if quick else 5, within=2)
        yield row("memory as states", name, d, seconds, np.abs(found - truth).max())


def reaction(t, u, du, p):
    for i in range(u.size):
        du[i] = 5.0 * (u[i] - u[i] ** 3)


def reaction_rows(quick):
    d = 50 if quick else 1000
    start = 0.1 * np.sin(np.pi * np.arange(1, d + 1) / (d + 1))
    how = {"linear": laplacian(d), "bandwidth": (0, 0)}
    equation = hd.Equation(hd.Caputo(ALPHA), reaction, start, **how)
    truth = hd.solve(equation, 1.0, rtol=1e-9).y[-1]
    for n in (200,) if quick else (250, 500, 1000, 2000):
        for scheme in (hd.BDF(2), hd.IMEX(hd.BDF(2))):
            how = {"scheme": scheme, "save_every": n, "estimate": False}
            run = lambda n=n, how=how: hd.solve(equation, 1.0, n, **how).y[-1]  # noqa: E731
            seconds, found = fastest(run, 1 if quick else 5, within=2)
            name = f"{scheme!r}".replace("scheme=", "") + f", N = {n}"
            yield row("reaction", name, d, seconds, np.abs(found - truth).max())


def bandwidth(quick):
    """Time of a block's reading and advancing of the modes over that of copying their bytes."""
    d = 2000 if quick else 100_000
    system = hd.Equation(hd.Caputo(ALPHA), None, np.ones(d), linear=sp.eye_array(d)).system
    stepper = FixedStepper(system, hd.L1(), hd.SumOfExponentials(), UniformSteps(1e-3), 1000)
    memory, march, groups = stepper.memory, stepper._march, np.zeros(d, dtype=np.int64)
    march.pieces[:] = 1e-3
    parts = (memory.tables, HISTORY_TABLES), (memory.arrays, MEMORY)
    arrays = [by_reference(*part) for part in parts]

    def exchange():
        memory.exchange(march.lag, march.pieces, 32, groups, *arrays)

    held = np.concatenate([part.ravel() for part in (*memory.arrays, march.lag, march.pieces)])
    other = np.empty_like(held)
    taken, copied = (fastest(call, 5)[0] for call in (exchange, lambda: np.copyto(other, held)))
    return taken / copied, 1e9 * taken / 32 / d


def row(problem, way, d, seconds, error):
    told = {"d": d, "ms": f"{1e3 * seconds:.3g}", "error": f"{error:.2g}"}
    return {"problem": problem, "way": way, **told}


def measure(quick):
    for part in (brusselator_rows, states_rows, reaction_rows):
        yield from part(quick)
    limit, nanoseconds = bandwidth(quick)
    yield Claim("modes of a component, a step [ns]", nanoseconds)
    yield Claim("time of modes over that of copying their bytes", limit, 5)


def claims(rows):
    ours = chosen(rows, problem="Brusselator", way="Collocation")
    for row in chosen(rows, problem="Brusselator", way="Radau"):
        best = min((own["ms"] for own in ours if own["error"] <= row["error"]), default=np.inf)
        where = f"error {row['error']:g}"
        yield Claim("Collocation's time over Radau's", best / row["ms"], 1, where=where)


def draw(rows):
    rows = [row | {"way": row["way"].split(", N")[0]} for row in rows]
    return curves("error", "ms", ("way",), ("problem",))(rows)


if __name__ == "__main__":
    study(measure, claims, draw)
