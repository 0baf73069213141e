"""How the shape of the memory of friction changes the stick-slip of the classical oscillator.

``x'' + 0.25 int_0^t K(t-s) x'(s) ds + x = t + 50 sum_n a_n sin(n x)``, is solved for two kernels.
Their total weight is one, so both are classical friction where the motion is slow. They are an
exponential, and a power law t**-0.8 that is tempered, both of relaxation time tau. By collocation,
rtol = 1e-9.

* As tau tends to 0 the first slip is the classical one, at 45.2716.
* The same orbit comes from the exponential's own ordinary system, to 1e-7 while it sticks.
* An explicit run of 200,000 steps with such kernels takes at most 1.5 times one with Caputo's.
"""

from functools import partial

import matplotlib.pyplot as plt
import numpy as np
from _study import Claim, chosen, in_turns, study
from scipy.integrate import solve_ivp
from scipy.special import rgamma

import hereditary as hd

T_END, RTOL, EXPONENT = 100.0, 1e-9, 0.8
SHOWN = (0.1, 3.0)
COLOURS = {"exponential": "#0072B2", "tempered": "#D55E00"}


def terms(kind, tau):
    """Kernel of total weight 1 but for a factor, and that factor."""
    if kind == "exponential":
        return hd.Prony([1 / tau], [1 / tau]), 1.0
    weight = tau ** (EXPONENT - 1) * rgamma(1 - EXPONENT)
    return hd.TemperedPowerLaw(EXPONENT, 1 / tau), weight


def equation(kind, tau):
    kernel, weight = terms(kind, tau)
    return hd.scenes.stick_slip(beta=2.0, friction=0.25 * weight, resistance=kernel)


def run(kind, tau):
    return hd.solve(equation(kind, tau), T_END, rtol=RTOL, scheme=hd.Collocation())


def row(kind, tau):
    sol = run(kind, tau)
    stays = hd.scenes.sticking_intervals(sol)
    t = np.linspace(0.5 * stays[0][1], 0.7 * stays[0][1], 400)
    return {
        "kernel": kind,
        "tau": f"{tau:.4g}",
        "first_slip": f"{stays[0][1]:.6g}",
        "swing": f"{np.ptp(sol(t, 1)):.3g}",
        "wells_at_end": int(sol.y[-1, 0] // (2 * np.pi)),
        "steps": sol.stats["n_steps"],
        "modes": sol.stats["n_modes"],
        "ms": f"{1e3 * sol.stats['run_seconds']:.3g}",
    }


def distance_to_ordinary(tau):
    """Largest difference to the ordinary system of an exponential kernel, on t <= 40."""
    eq = equation("exponential", tau)

    def slopes(t, state):
        x, v, z = state
        return [v, eq.system.rhs(t, np.array([x]))[0] - 0.25 * z / tau, v - z / tau]

    times = np.linspace(0.1, 40, 200)
    exact = solve_ivp(
        slopes, (0, 40), [0.2, 0.3, 0.0], method="DOP853", t_eval=times, rtol=1e-12, atol=1e-12
    )
    return np.abs(run("exponential", tau)(times)[:, 0] - exact.y[0]).max()


def cost(quick):
    """Time of an explicit run with kernels in both terms over that with Caputo's derivatives."""
    inertia = hd.TemperedPowerLaw(0.8, 0.01)
    both = hd.scenes.stick_slip(inertia=inertia, resistance=hd.TemperedPowerLaw(0.8, 0.1))
    n = 2_000 if quick else 200_000
    equations = {"Caputo": hd.scenes.stick_slip(), "kernels": both}
    calls = {k: partial(hd.solve, eq, T_END, n, save_every=100) for k, eq in equations.items()}
    best = in_turns(calls, 2 if quick else 9)
    return best["kernels"] / best["Caputo"]


def draw(rows):
    figure, axes = plt.subplots(1, 3, figsize=(13, 4), layout="constrained")
    t = np.geomspace(1e-2, 30, 300)
    for style, tau in zip(("-", "--"), SHOWN, strict=True):
        for kind, colour in COLOURS.items():
            kernel, weight = terms(kind, tau)
            axes[0].loglog(
                t, weight * kernel(t), style, color=colour, label=rf"{kind}, $\tau$ = {tau:g}"
            )
            sol = run(kind, tau)
            times = np.linspace(0, T_END, 4000)
            axes[1].plot(times, sol(times)[:, 0], style, color=colour, lw=0.9)
    axes[0].set(xlabel="$t$", ylabel="$K(t)$", title="Memory of friction", ylim=(1e-4, 100))
    axes[0].legend(fontsize=8)
    classical = hd.solve(
        hd.scenes.stick_slip(beta=2.0, gamma=1.0), T_END, rtol=RTOL, scheme=hd.Collocation()
    )
    axes[1].plot(times, classical(times)[:, 0], color="0.6", lw=0.9, zorder=0, label="no memory")
    axes[1].set(xlabel="$t$", ylabel="$x$", title="Oscillograms")
    axes[1].legend(fontsize=8)
    for kind, colour in COLOURS.items():
        mine = chosen(rows, kernel=kind)
        axes[2].loglog(
            [r["tau"] for r in mine], [r["swing"] for r in mine], "o-", ms=3, color=colour
        )
    axes[2].set(
        xlabel=r"relaxation time $\tau$",
        ylabel=r"range of $\dot x$",
        title="Swings left halfway to the first slip",
    )
    return figure


def measure(quick):
    taus = np.geomspace(1e-3, 30, 4 if quick else 25)
    yield from (row(kind, tau) for kind in COLOURS for tau in taus)
    off = max(distance_to_ordinary(tau) for tau in SHOWN)
    yield Claim("distance from the ordinary system", off, 1e-7, small=True)
    yield Claim("an explicit run with kernels, times one with Caputo's terms", cost(quick), 1.5)


def claims(rows):
    off = abs(rows[0]["first_slip"] - 45.2716)
    yield Claim("first slip at tau = 0.001, off the classical one", off, 0.02, small=True)


if __name__ == "__main__":
    study(measure, claims, draw)
