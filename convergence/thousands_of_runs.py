"""Thousands of short runs: members of an epidemic by a tolerance, and fits, beside SciPy.

A fractional SIR epidemic of order 0.9 with drawn rates of infection and of recovery, to t = 100,
with a row for each day. Its members are solved to rtol = 1e-6 by `ensemble` and by a loop of
`solve`. SciPy's LSODA solves the epidemic of order 1, whose right-hand side is compiled too. It is
called by a loop of `solve_ivp`, and by one of `odeint`, which runs no Python between its steps.
Errors are the largest of all rows of 100 members, over the size of the component. Three parameters
are fitted to 50 days of an epidemic, the order among them or not. Claims:

* on one core a member of `ensemble` takes at most 0.4 of the time of a call of `solve`;
* and at most the time of a call of `solve_ivp` with LSODA, at a smaller error;
* results do not depend on the number of threads, in any bit;
* a fit by `fit` takes at most twice as long as SciPy's `least_squares` over `solve_ivp`.
"""

import time

import numba
import numpy as np
from _study import Claim, chosen, curves, fastest, study
from scipy.integrate import odeint, solve_ivp
from scipy.optimize import least_squares

import hereditary as hd

DAYS, START, RTOL = np.arange(0.0, 101.0), [0.999, 0.001, 0.0], 1e-6
CHECKED = 100
FITTED = np.arange(1.0, 51.0)
RATES = {"infection": 0.4, "recovery": 0.1}


def epidemic(t, y, p):
    infected = p[0] * y[0] * y[1]
    return np.array([-infected, infected - p[1] * y[1], p[1] * y[1]])


compiled = numba.njit(epidemic)


def sir(order=0.9, infection=0.4, recovery=0.1, first=1e-3):
    rates = [infection, recovery]
    return hd.Equation(hd.Caputo(order), epidemic, [1.0 - first, first, 0.0], params=rates)


def by_ensemble(params, rtol=RTOL, threads=1):
    return hd.ensemble(sir(), DAYS[-1], params=params, rtol=rtol, t_eval=DAYS, threads=threads).y


def by_solve(params):
    equation, how = sir(), {"rtol": RTOL, "t_eval": DAYS}
    return np.array([hd.solve(equation, DAYS[-1], params=row, **how).y for row in params])


def by_solve_ivp(params, rtol=RTOL):
    how = {"method": "LSODA", "t_eval": DAYS, "rtol": rtol, "atol": 1e-3 * rtol}
    runs = [solve_ivp(compiled, (0, DAYS[-1]), START, args=(row,), **how) for row in params]
    return np.array([run.y.T for run in runs])


def by_odeint(params, rtol=RTOL):
    how = {"tfirst": True, "rtol": rtol, "atol": 1e-3 * rtol}
    return np.array([odeint(compiled, START, DAYS, args=(row,), **how) for row in params])


def drawn(size):
    rng = np.random.default_rng(82)
    return np.column_stack([rng.uniform(0.2, 0.6, size), rng.uniform(0.05, 0.2, size)])


WAYS = {
    "ensemble, one core": by_ensemble,
    "ensemble, all cores": lambda params: by_ensemble(params, threads=None),
    "loop of solve": by_solve,
    "loop of solve_ivp, order 1": by_solve_ivp,
    "loop of odeint, order 1": by_odeint,
}


def runs(quick):
    """Rows of all ways and numbers of members; a claim that threads change no bit."""
    sizes = (10, 30) if quick else (10, 100, 1000, 10_000)
    few = drawn(sizes[0] if quick else CHECKED)
    truths = by_ensemble(few, 1e-10), by_odeint(few, 1e-11)
    for by, way in WAYS.items():
        truth = truths["order 1" in by]
        error = np.abs(way(few) - truth).max(axis=(0, 1)) / np.abs(truth).max(axis=(0, 1))
        for size in sizes:
            if size > 1000 and "ensemble" not in by:
                continue  # ten times as long as the one before
            seconds, _ = fastest(lambda size=size, way=way: way(drawn(size)), 3)
            row = {"what": "members", "by": by, "members": size, "seconds": f"{seconds:.3g}"}
            yield row | {"error": f"{error.max():.1e}", "runs": size}
    same = np.array_equal(by_ensemble(few, threads=1), by_ensemble(few, threads=3))
    yield Claim("one and three threads give equal bits, 1 if so", float(same), at_least=1.0)


def fits(quick):
    """Rows of fits of three parameters to 50 days, by `fit` and by SciPy."""
    counts = np.random.default_rng(1).normal(0.0, 2e-3, FITTED.size)
    guess = {"infection": 0.3, "recovery": 0.15}
    for by, order, third in (
        ("fit, order 0.9, first infected", 0.9, {"first": 2e-3}),
        ("fit, order among them", 0.9, {"order": 0.8}),
        ("fit, order 1, first infected", 1.0, {"first": 2e-3}),
    ):
        data = hd.solve(sir(order), 50.0, rtol=1e-9, t_eval=FITTED).y[:, 1] + counts
        model = sir if "order" in third else (lambda order=order, **rest: sir(order, **rest))
        bounds = {"order": (0.3, 1.0)} if "order" in third else {"first": (1e-5, 0.1)}
        bounds |= {"infection": (0.01, 3.0), "recovery": (0.001, 1.0)}

        def fitted(data=data, model=model, third=third, bounds=bounds):
            start = guess | third
            return hd.fit(model, FITTED, data, start, observe=[1], bounds=bounds, rtol=RTOL)

        seconds, found = fastest(fitted, 3)
        error = max(abs(found.parameters[name] / true - 1) for name, true in RATES.items())
        row = {"what": "fit", "by": by, "members": 1, "seconds": f"{seconds:.3g}"}
        yield row | {"error": f"{error:.1e}", "runs": found.n_runs}
    calls = [0]

    def residuals(p):
        calls[0] += 1
        start = [1.0 - p[2], p[2], 0.0]
        how = {"method": "LSODA", "t_eval": FITTED, "rtol": RTOL, "atol": 1e-9}
        return solve_ivp(compiled, (0, 50.0), start, args=(p[:2],), **how).y[1] - data

    def by_scipy():
        calls[0] = 0
        low, high = [0.01, 0.001, 1e-5], [3.0, 1.0, 0.1]
        return least_squares(residuals, [0.3, 0.15, 2e-3], bounds=(low, high), x_scale="jac")

    seconds, found = fastest(by_scipy, 3)
    error = np.abs(found.x[:2] / list(RATES.values()) - 1).max()
    by = "least_squares over solve_ivp, order 1"
    row = {"what": "fit", "by": by, "members": 1, "seconds": f"{seconds:.3g}"}
    yield row | {"error": f"{error:.1e}", "runs": calls[0]}


def measure(quick):
    began = time.perf_counter()
    found = [*runs(quick), *fits(quick)]
    return [*found, Claim("this study [s]", time.perf_counter() - began)]


def claims(rows):
    members = chosen(rows, what="members")
    each = {row["by"]: row["seconds"] / row["members"] for row in members if row["members"] >= 1000}
    each = each or {row["by"]: row["seconds"] / row["members"] for row in members}
    own, error = each["ensemble, one core"], {row["by"]: row["error"] for row in members}
    yield Claim("a member, of a call of solve", own / each["loop of solve"], 0.4)
    scipy = "loop of solve_ivp, order 1"
    yield Claim("a member, of a call of solve_ivp of order 1", own / each[scipy], 1.0)
    yield Claim("its error, of that of solve_ivp", error["ensemble, one core"] / error[scipy], 1.0)
    odes = own / each["loop of odeint, order 1"]
    yield Claim("a member, of a call of odeint of order 1", odes)
    most = max(row["members"] for row in members)
    cores = chosen(members, by="ensemble, all cores", members=most)[0]["seconds"]
    yield Claim("10,000 members on all cores [s]", cores * 10_000 / most)
    found = {row["by"]: row for row in chosen(rows, what="fit")}
    theirs = found["least_squares over solve_ivp, order 1"]
    for by in ("fit, order 0.9, first infected", "fit, order 1, first infected"):
        ratio = found[by]["seconds"] / theirs["seconds"]
        yield Claim("a fit, of least_squares over solve_ivp", ratio, 2.0, where=by)
    with_order = found["fit, order among them"]["seconds"] / theirs["seconds"]
    yield Claim("a fit of the order too, of least_squares over solve_ivp", with_order)


if __name__ == "__main__":
    draw = curves("members", "seconds", ("by",), title="SIR epidemics to t = 100, rtol 1e-6")
    study(measure, claims, lambda rows: draw(chosen(rows, what="members")))
