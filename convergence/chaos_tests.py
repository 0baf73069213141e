"""Exponents, the 0-1 test and power spectra, compared on orbits whose nature is known.

* The 0-1 test tells chaos and cycles of the logistic map, and of orbits with memory and without;
  no verdict of `lyapunov` contradicts it.
"""

import matplotlib.pyplot as plt
import numpy as np
from _study import Claim, chosen, study

import hereditary as hd


def driven(t, x, p):
    return p[0] * np.cos(p[1] * t) - p[2] * x - p[3] * x**3


def duffing(beta, gamma, friction, force, stiffness):
    terms = hd.Caputo(beta) + friction * hd.Caputo(gamma)
    return hd.Equation(terms, driven, [0.1, 0.0], params=[force, 1.2, stiffness, 1.0])


# equation, component, time of the orbit, and what is known of it
ORBITS = {
    "Lorenz": (hd.scenes.lorenz(), 2, 1000.0, "chaotic"),
    "Lorenz, order 0.995": (hd.scenes.lorenz(alpha=0.995, rho=35.0), 2, 1000.0, None),
    "Lorenz, order 0.99": (hd.scenes.lorenz(alpha=0.99), 2, 400.0, "falls to its equilibrium"),
    "Duffing, double well": (duffing(2.0, 1.0, 0.3, 0.5, -1.0), 0, 4000.0, "chaotic"),
    "Duffing, weak force": (duffing(2.0, 1.0, 0.3, 0.2, -1.0), 0, 3000.0, "regular"),
    "Duffing, orders 1.9, 0.9": (duffing(1.9, 0.9, 0.3, 0.2, -1.0), 0, 3000.0, "regular"),
    "hardening, orders 1.8, 0.8": (duffing(1.8, 0.8, 0.3, 0.5, 1.0), 0, 3000.0, "regular"),
}


def logistic(r):
    x, found = 0.3, []
    for _ in range(2500):
        x = r * x * (1 - x)
        found.append(x)
    return np.array(found[500:])


def row(name, known, verdict, k, peaks):
    return {"orbit": name, "known": known or "", "exponent": verdict, "K": k, "lines": peaks}


def measure(quick):
    spectra = {}
    for r, known in ((3.5, "regular"), (3.83, "regular"), (3.9, "chaotic"), (4.0, "chaotic")):
        found = hd.zero_one_test(logistic(r))
        yield row(f"logistic map, r = {r:g}", known, "", f"{found.k:.3f}", "")
    for name, (equation, component, t_end, known) in ORBITS.items():
        if quick and "weak" not in name:
            continue
        orbit = hd.solve(equation, t_end, rtol=1e-7)
        late = 0.2 * t_end
        try:
            k = f"{hd.zero_one_test(orbit, component=component, transient=late).k:.3f}"
        except ValueError:
            k = "too few maxima"
        spectra[name] = hd.power_spectrum(orbit, component=component, transient=late)
        strong = spectra[name].peaks
        strong = strong[strong["amplitude"] > 0.02 * strong["amplitude"].max(initial=0.0)]
        # at T = 400 the late slope of a chaotic orbit was below three standard errors
        t_end = 400 if quick else 4000
        exponent = hd.lyapunov(equation, float(t_end), 200 * t_end)
        told = f"{exponent.slope[0]:.1g}, {exponent.verdict}"
        yield row(name, known, told, k, len(strong))
    yield draw(spectra)


def draw(spectra):
    figure, axes = plt.subplots(len(spectra), 1, figsize=(7, 1.7 * len(spectra)), squeeze=False)
    figure.set_layout_engine("constrained")
    for ax, (name, found) in zip(axes[:, 0], spectra.items(), strict=True):
        ax.semilogy(found.omega, np.maximum(found.power, 1e-12), lw=0.6)
        ax.plot(found.peaks["omega"], np.full(found.peaks.size, found.power.max()), "v", ms=4)
        ax.set(xlim=(0, 16 if "Lorenz" in name else 6), title=name, ylabel="power")
        ax.title.set_fontsize(9)
    axes[-1, 0].set(xlabel=r"$\omega$")
    return figure


def claims(rows):
    for kind, limit in (("chaotic", {"at_least": 0.8}), ("regular", {"at_most": 0.2})):
        mine = chosen(rows, known=kind)
        for told in mine:
            yield Claim(f"K of {kind} orbits", told["K"], **limit, where=told["orbit"])
        against = ("growth",) if kind == "regular" else ("decay", "neutral")
        wrong = sum(any(word in told["exponent"] for word in against) for told in mine)
        yield Claim(f"verdicts against {kind} orbits", wrong, 0)


if __name__ == "__main__":
    study(measure, claims)
