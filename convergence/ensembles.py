"""Ensembles: one equation for many parameters, by one stepper on each core.

One equation is Duffing's oscillator of orders 1.9 and 0.7, 1,000 steps for each member. Others are
the 512 complex fractional Riccati equations of a rough-volatility model, whose errors are those of
all members at t = 1. Beside it is a loop of `solve`, and the predictor-corrector scheme that one
would write in NumPy for all Riccati equations at once. Its weights are computed beforehand. Claims:

* a loop of `solve` takes at least 1.5 times as long;
* 5,000 members of the oscillator take less than 2.5 s;
* at an error of 5e-4 the Riccati equations take at most twice as long as NumPy's.

A member resets its stepper, which takes Python 0.15 ms. So short runs gain little, and NumPy is
faster where few steps do.
"""

import numpy as np
from _study import Claim, chosen, curves, fastest, study
from scipy.special import gamma

import hereditary as hd

ALPHA, LAMBDA, RHO, NU = 0.62, 0.1, -0.7, 0.33
FREQUENCIES = np.linspace(0.1, 50.0, 512)
STEPS = (50, 100, 200, 400, 800, 1600)
SCHEMES = (hd.Adams(), hd.Adams(corrections=2), hd.BDF(2), hd.ProductTrapezoid())


def duffing(t, x, dx, p):
    dx[0] = p[0] * np.cos(p[1] * t) - x[0] - p[2] * x[0] ** 3


def riccati(t, h, p):
    u = 1j * p[0]
    return 0.5 * (u * u - u) + (u * RHO * NU - LAMBDA) * h + 0.5 * NU * NU * h * h


def riccati_in_numpy(n_steps):
    """Adams' predictor-corrector scheme for all members at once; values at t = 1."""
    h, u = 1.0 / n_steps, 1j * FREQUENCIES
    c0, c1, c2 = 0.5 * (u * u - u), u * RHO * NU - LAMBDA, 0.5 * NU * NU
    n = np.arange(n_steps + 2.0)
    unit = h**ALPHA / gamma(ALPHA + 2)
    predicting = (np.diff(n**ALPHA) * h**ALPHA / gamma(ALPHA + 1))[::-1].copy()
    powers = n ** (ALPHA + 1)
    correcting = (powers[2:] + powers[:-2] - 2 * powers[1:-1])[::-1].copy() * unit
    first = (powers[:-1] - (n[:-1] - ALPHA) * n[1:] ** ALPHA) * unit
    f = np.zeros((n_steps + 1, u.size), complex)
    f[0] = c0
    for k in range(n_steps):
        y = predicting[predicting.size - k - 1 :] @ f[: k + 1]
        y = first[k] * f[0] + unit * (c0 + (c1 + c2 * y) * y)
        if k:
            y += correcting[correcting.size - k :] @ f[1 : k + 1]
        f[k + 1] = c0 + (c1 + c2 * y) * y
    return y


def oscillators(quick):
    """Rows of the oscillator."""
    terms = hd.Caputo(1.9) + 0.2 * hd.Caputo(0.7)
    equation = hd.Equation(terms, duffing, [0.1, 0.2], params=[1.0, 1.0, 1.0])
    size, n_steps = (100, 100) if quick else (5000, 1000)
    params = np.random.default_rng(0).uniform(0.5, 1.2, (size, 3))
    few, rows = params[: size // 25], []
    for scheme in (hd.ExplicitCaputo(), hd.BDF(2)):
        how = {"scheme": scheme, "save_every": n_steps}
        hd.ensemble(equation, 20.0, n_steps, params=params[:2], **how)

        def loop(how=how):
            for row in few:
                hd.solve(equation.replace(params=row), 20.0, n_steps, estimate=False, **how)

        alone, _ = fastest(loop, 3)
        for threads in (1, 2):
            seconds, found = fastest(
                lambda threads=threads, how=how: hd.ensemble(
                    equation, 20.0, n_steps, params=params, threads=threads, **how
                ),
                3,
            )
            rows.append(
                {
                    "equation": "oscillator",
                    "by": f"{scheme!r}, {threads} threads",
                    "n_steps": n_steps,
                    "members": len(found),
                    "error": "",
                    "milliseconds": f"{1e3 * seconds:.3g}",
                    "loop of solve": f"{1e3 * alone * len(params) / len(few):.3g}",
                }
            )
    return rows


def riccatis(quick):
    """Rows of the Riccati equations."""
    steps = STEPS[:2] if quick else STEPS
    equation = hd.Equation(hd.Caputo(ALPHA), riccati, 0j, params=[1.0])
    few = slice(None, None, 256 if quick else 8)
    exact = hd.ensemble(equation, 1.0, rtol=1e-9, params=FREQUENCIES[few]).y[:, -1, 0]
    rows = []

    def add(by, n_steps, seconds, values):
        error = np.abs(values[few] - exact).max()
        rows.append(
            {
                "equation": "Riccati",
                "by": by,
                "n_steps": n_steps,
                "members": values.size,
                "error": f"{error:.2e}",
                "milliseconds": f"{1e3 * seconds:.3g}",
                "loop of solve": "",
            }
        )

    for n_steps in steps:
        add("NumPy", n_steps, *fastest(lambda n=n_steps: riccati_in_numpy(n), 5))
        for scheme in SCHEMES:
            how = {"scheme": scheme, "save_every": n_steps, "params": FREQUENCIES}
            hd.ensemble(equation, 1.0, n_steps, **how)
            seconds, found = fastest(
                lambda n=n_steps, how=how: hd.ensemble(equation, 1.0, n, **how), 5
            )
            if found.success.all():
                add(repr(scheme), n_steps, seconds, found.y[:, -1, 0])
    return rows


def at_error(curve, error):
    """Milliseconds of a curve at an error, between its points."""
    errors, seconds = np.log(np.array(curve)).T
    order = np.argsort(errors)
    return float(np.exp(np.interp(np.log(error), errors[order], seconds[order])))


def measure(quick):
    with np.errstate(all="ignore"):  # the coarsest runs blow up
        return oscillators(quick) + riccatis(quick)


def claims(rows):
    marched = chosen(rows, equation="oscillator")
    for row in marched:
        ratio = row["loop of solve"] / row["milliseconds"]
        yield Claim("a loop of solve takes times as long", ratio, at_least=1.5, where=row["by"])
    seconds = min(row["milliseconds"] for row in marched) / 1e3
    yield Claim("5,000 oscillators, 1,000 steps [s]", seconds, 2.5)
    found: dict[str, list] = {}
    for row in chosen(rows, equation="Riccati"):
        if np.isfinite(row["error"]):
            found.setdefault(row["by"], []).append((row["error"], row["milliseconds"]))
    for error in (2e-2, 5e-3, 2e-3, 5e-4):
        ours = min(at_error(curve, error) for by, curve in found.items() if by != "NumPy")
        limit = np.inf if error > 5e-4 else 2
        ratio = ours / at_error(found["NumPy"], error)
        yield Claim(f"512 Riccati equations at {error:g}, of NumPy's time", ratio, limit)


if __name__ == "__main__":
    draw = curves("milliseconds", "error", ("by",), title="512 Riccati equations")
    study(measure, claims, lambda rows: draw(chosen(rows, equation="Riccati")))
