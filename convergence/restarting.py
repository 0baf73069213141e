"""Cutting the memory at every renormalisation reports chaos where the solution comes to rest.

The Lorenz system of order 0.99 (sigma 10, rho 28, b 8/3) from (0.1, 0.1, 0.1) converges to an
equilibrium.

* Memory kept: the exponents are the same to 1e-9 for intervals from 0.02 to 5 and the automatic
  one. The verdict is a decay, and the leading one tends to 0 from below.
* Memory restarted: the leading exponent exceeds 0.8 at interval 0.02. There it is the classical one
  times the factor renorm**(alpha-1) / Gamma(1+alpha). It is negative from interval 0.5 on.
* Restarted, the sum at short intervals is this factor times the divergence, which has no limit. At
  long ones it is that of ln |E_alpha(mu renorm**alpha)| / renorm over the equilibrium's eigenvalues
  mu.
"""

from typing import Any, NamedTuple

import matplotlib.pyplot as plt
import numpy as np
from _study import Study, check
from pymittagleffler import mittag_leffler
from scipy.special import gamma

import hereditary as hd
from hereditary.analysis.growth import assess
from hereditary.equation.system import displaced
from hereditary.given.fixed_stepper import FixedStepper
from hereditary.given.steps import UniformSteps

ALPHA, INTERVALS = 0.99, (0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0)
STEP, T_END, TRANSIENT = 0.005, 100.0, 20.0
DIVERGENCE = -41 / 3
CLASSICAL = 0.9056  # leading exponent at alpha = 1
SIDE = np.sqrt(72.0)
EQUILIBRIUM = np.array([SIDE, SIDE, 27.0])
JACOBIAN = np.array([[-10.0, 10.0, 0.0], [1.0, -1.0, -SIDE], [SIDE, SIDE, -8 / 3]])
# colours and marks that the colour-blind can tell apart (Okabe and Ito)
KEPT, CUT, OTHER = "#0072B2", "#D55E00", "#009E73"


def factor(alpha, interval):
    """What short intervals multiply classical exponents by."""
    return interval ** (alpha - 1) / gamma(1 + alpha)


def at_equilibrium(alpha, interval):
    """Sum of the exponents that restarting gives at the equilibrium."""
    powers = (np.linalg.eigvals(JACOBIAN) * interval**alpha).astype(complex)
    growth = [mittag_leffler(z, alpha=alpha, beta=1.0) for z in powers]
    return np.log(np.abs(growth)).sum() / interval


class Restarted(NamedTuple):
    """Exponents of a run whose memory is cut off at every renormalisation.

    They are not exponents of the equation. Fields are those of `hd.LyapunovResult`.
    """

    exponents: np.ndarray
    times: np.ndarray
    trace: np.ndarray
    slope: np.ndarray
    slope_stderr: np.ndarray
    verdict: str
    y: np.ndarray
    settings: dict[str, Any]
    mode: str = "restart"


def restarted(
    equation, t_end, n_steps, k, scheme, history=None, renorm=None, transient=0.0, window=0.5,
    directions=None,
):  # fmt: skip
    """Compute exponents of orders up to 1, f without t, by restarting the equation every `renorm`.

    This is the published algorithm: the last values become initial ones, and the memory is lost.
    """
    h, d = t_end / n_steps, equation.d
    steps = UniformSteps(h)
    if directions is None:
        directions = np.random.default_rng(0).normal(size=(d, d))[:, :k]
    phi, y, logs, n = np.linalg.qr(directions)[0], equation.y0[0], [], 0
    ends = [*range(round(renorm / h), n_steps, round(renorm / h)), n_steps]
    for end in ends:
        run = displaced(equation.system, y[None]), scheme, history or hd.SumOfExponentials(), steps
        stepper = FixedStepper(*run, end - n, phi)
        while stepper.n < end - n and stepper.failure is None:
            stepper.advance(end - n, keep=False)
        if stepper.failure:
            raise RuntimeError(f"{equation}: {stepper.failure}")
        phi, r = np.linalg.qr(stepper.tangent)
        logs.append(np.log(np.abs(np.diag(r))))
        y, n = stepper.y, end
    times, growth = h * np.array(ends), np.cumsum(logs, axis=0)
    later = times > transient + h / 2
    growth = growth[later] - (growth[~later][-1] if transient else 0.0)
    times = times[later]
    trace = growth / (times - transient)[:, None]
    late = assess(times, growth, window, 20, "none")
    settings = {"h": h, "renorm": renorm}
    errors = late.slope, late.slope_stderr, str(late.verdicts[0])
    return Restarted(trace[-1], times, trace, *errors, y, settings)


def run(mode, interval, h, t_end, alpha=ALPHA, k=3, transient=0.0):
    how = hd.scenes.lorenz(alpha=alpha), t_end, round(t_end / h), k
    more = {"scheme": hd.Adams(), "renorm": interval, "transient": transient}
    return restarted(*how, **more) if mode == "restart" else hd.lyapunov(*how, **more, verify=False)


def row(case, result, t, exponents, alpha=ALPHA, law=""):
    interval = result.settings["renorm"]
    exponents = [*exponents, np.nan, np.nan][:3]
    off = np.abs(np.abs(result.y) - EQUILIBRIUM).max()
    return {
        "case": case,
        "alpha": alpha,
        "mode": result.mode,
        "h": f"{result.settings['h']:.6g}",
        "interval": "auto" if interval is None else f"{interval:g}",
        "t": f"{t:.6g}",
        **{f"lambda_{i}": f"{value:.15g}" for i, value in enumerate(exponents, 1)},
        "sum": f"{sum(exponents):.9g}",
        "law": law and f"{law:.9g}",
        "off_rest": f"{off:.2g}",
        "verdict": str(result.verdict),
    }


def measure_traces(quick):
    """Running exponents at times spaced evenly in the logarithm."""
    rows = []
    lasts = (20.0, 100.0) if quick else (1000.0, 1000.0)
    for mode, interval, t_end, k in (
        ("restart", 0.02, lasts[0], 1),
        ("restart", 0.5, lasts[1], 1),
        ("tangent", 0.5, lasts[1], 3),
    ):
        result = run(mode, interval, STEP, t_end, k=k)
        wanted = np.geomspace(2.0, t_end, 60)
        for i in np.unique(np.searchsorted(result.times, wanted * (1 - 1e-12))):
            rows.append(row("trace", result, result.times[i], result.trace[i]))
    return rows


def measure_intervals(quick):
    """Exponents from t = 20 to 100 over the interval, also at half the step."""
    rows = []
    for h in (STEP,) if quick else (STEP, STEP / 2):
        for mode in ("tangent", "restart"):
            intervals = (0.02, 0.5, 5.0) if quick else INTERVALS
            for interval in (*intervals, None) if mode == "tangent" else intervals:
                result = run(mode, interval, h, T_END, transient=TRANSIENT)
                law = "" if mode == "tangent" else at_equilibrium(ALPHA, interval)
                rows.append(row("interval", result, T_END, result.exponents, law=law))
    return rows


def measure_sums(quick):
    """Restarted sums where the interval is short, sixteen steps or more in each."""
    rows = []
    for alpha in (0.99, 0.9):
        for interval in (0.1, 0.02) if quick else (0.2, 0.1, 0.05, 0.02, 0.01, 0.005, 0.002):
            h = interval / max(16, round(interval / STEP))
            result = run("restart", interval, h, 10.0, alpha)
            law = factor(alpha, interval) * DIVERGENCE
            rows.append(row("sum", result, 10.0, result.exponents, alpha, law))
    return rows


def chosen(rows, case, mode, **settings):
    return [
        r
        for r in rows
        if r["case"] == case
        and r["mode"] == mode
        and all(r[key] == value for key, value in settings.items())
    ]


def check_kept(rows):
    for h in sorted({r["h"] for r in rows if r["case"] == "interval"}):
        mine = chosen(rows, "interval", "tangent", h=h)
        found = np.array([[r[f"lambda_{i}"] for i in (1, 2, 3)] for r in mine])
        spread = np.ptp(found, axis=0).max()
        check(f"memory kept, h {h:g}: {len(mine)} intervals within {spread:.0e}", spread < 1e-9)
        verdicts = {r["verdict"] for r in mine}
        check(f"verdicts {sorted(verdicts)}", verdicts <= {"algebraic decay", "neutral"})
        off = mine[0]["off_rest"]
        check(f"orbit within {off:g} of the equilibrium at t = 100 (0.01)", off < 0.01)
    last = chosen(rows, "trace", "tangent")[-1]
    text = f"leading exponent {last['lambda_1']:.4f} over t = {last['t']:g}, t times it"
    product = last["t"] * last["lambda_1"]
    check(f"{text} {product:.1f} (between -20 and 0)", -20 < product < 0)


def check_restarted(rows, quick):
    for r in chosen(rows, "interval", "restart"):
        value = r["lambda_1"]
        text = f"restarted every {r['interval']:g}, h {r['h']:g}: {value:+.3f}"
        if r["interval"] == 0.02:
            check(f"{text} (above 0.8)", value > 0.8)
            check(f"orbit {r['off_rest']:g} off the equilibrium (above 1)", r["off_rest"] > 1)
        elif r["interval"] >= 0.5:
            check(f"{text} (below 0)", value < 0)
            deviation = r["sum"] / r["law"] - 1
            text = f"sum {r['sum']:.4f}, off the formula at rest by {deviation:.2%}"
            check(f"{text} (0.5%)", abs(deviation) < 0.005)
    value = chosen(rows, "trace", "restart", interval=0.02)[-1]["lambda_1"]
    law = factor(ALPHA, 0.02) * CLASSICAL
    text = f"restarted every 0.02, long run: {value:.3f}, factor times classical {law:.3f}"
    check(f"{text} (0.05)", abs(value - law) < 0.05, quick)
    for r in chosen(rows, "sum", "restart"):
        if r["interval"] <= 0.02:
            deviation = r["sum"] / r["law"] - 1
            text = f"alpha {r['alpha']:g}, interval {r['interval']:g}: sum {r['sum']:.3f}"
            check(
                f"{text}, off the factor times the divergence by {deviation:.2%} (0.3%)",
                abs(deviation) < 0.003,
            )


def draw(rows):
    figure, axes = plt.subplots(1, 3, figsize=(12, 4.4), layout="constrained")
    draw_traces(axes[0], rows)
    draw_intervals(axes[1], rows)
    draw_sums(axes[2], rows)
    figure.get_layout_engine().set(wspace=0.06)
    for ax in axes:
        ax.set_xscale("log")
        ax.grid(alpha=0.3)
        ax.legend(fontsize=8)
    return figure


def draw_traces(ax, rows):
    for mode, interval, color, line, label in (
        ("restart", 0.02, CUT, "-", "memory restarted every 0.02"),
        ("restart", 0.5, OTHER, "--", "memory restarted every 0.5"),
        ("tangent", 0.5, KEPT, "-", "memory kept"),
    ):
        mine = chosen(rows, "trace", mode, interval=interval)
        t, rate = [r["t"] for r in mine], [r["lambda_1"] for r in mine]
        ax.plot(t, rate, line, color=color, lw=2 if mode == "tangent" else 1.4, label=label)
    ax.axhline(0.0, color="k", lw=0.8)
    ax.set(xlabel="$t$", ylabel=r"$\lambda_1$ up to $t$", ylim=(-0.2, 1.3))
    ax.set_title(r"Lorenz, $\rho = 28$, $\alpha = 0.99$", fontsize=10)


def draw_intervals(ax, rows):
    steps = sorted({r["h"] for r in rows if r["case"] == "interval"}, reverse=True)
    for h, fill in zip(steps, ("none", None), strict=False):
        for mode, color, marker, label in (
            ("restart", CUT, "s", "memory restarted"),
            ("tangent", KEPT, "o", "memory kept"),
        ):
            mine = [r for r in chosen(rows, "interval", mode, h=h) if r["interval"] != "auto"]
            x, y = [r["interval"] for r in mine], [r["lambda_1"] for r in mine]
            size = 8 if fill else 4
            style = {"ms": size, "mfc": fill or color, "lw": 1, "color": color}
            ax.plot(x, y, marker + "-", label=f"{label}, h {h:g}", **style)
    ax.axhline(0.0, color="k", lw=0.8)
    ax.set(xlabel="interval of renormalisation", ylabel=r"$\lambda_1$ from $t$ = 20 to 100")
    ax.set_ylim(-0.2, 1.3)
    ax.set_title(r"The same, over the interval", fontsize=10)


def draw_sums(ax, rows):
    for alpha, color, marker in ((0.99, CUT, "s"), (0.9, OTHER, "^")):
        mine = chosen(rows, "sum", "restart", alpha=alpha)
        mine += [r for r in chosen(rows, "interval", "restart", alpha=alpha) if r["interval"] > 0.2]
        x, y = [r["interval"] for r in mine], [-r["sum"] for r in mine]
        ax.plot(x, y, marker, ms=5, color=color, label=rf"restarted, $\alpha$ = {alpha:g}")
        intervals = np.geomspace(min(x), max(x), 60)
        at_rest = [-at_equilibrium(alpha, interval) for interval in intervals]
        ax.plot(intervals, at_rest, "-", lw=1, color=color)
        ax.plot(intervals, -DIVERGENCE * factor(alpha, intervals), ":", lw=1.4, color=color)
    ax.plot([], [], "k-", lw=1, label="formula at rest")
    ax.plot([], [], "k:", lw=1.4, label=r"$\tau^{\alpha-1} / \Gamma(1+\alpha)$ times divergence")
    ax.set(yscale="log", xlabel=r"interval of renormalisation $\tau$")
    ax.set_yticks([2, 5, 10, 20], ["2", "5", "10", "20"])
    ax.minorticks_off()
    ax.set_ylabel("minus the sum of the exponents")
    ax.set_title("Sums are functions of the interval", fontsize=10)


def measure(quick):
    return [*measure_traces(quick), *measure_intervals(quick), *measure_sums(quick)]


def main():
    study = Study(__file__, __doc__)
    study.write(measure(study.quick))
    rows = study.read()
    check_kept(rows)
    check_restarted(rows, study.quick)
    study.save(draw(rows))


if __name__ == "__main__":
    main()
