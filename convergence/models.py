"""Models of the literature, compared with thresholds, exact solutions and periods from elsewhere.

For each model one number is measured on orbits that `Collocation` solves, and set beside one that
does without this library. These are zeros of a characteristic function, a Hill determinant, a power
series, a published value. A threshold is measured by the growth rate of small oscillations at
orders, or a stiffness, to both sides of it. It is where a straight line through them is 0. Claims:
thresholds agree to 1e-3, values to 1e-8, rough Heston's to 1e-2 with a published Padé approximant,
[GatheralRadoicic2023].
"""

import matplotlib.pyplot as plt
import numpy as np
from _study import Claim, study
from model_references import (
    airy_series,
    mathieu_edges,
    nerve_at_rest,
    onset,
    riccati_series,
    selkov_onset,
)

import hereditary as hd

scenes = hd.scenes


def growth(equation, t_end, rest=0.0):
    """Growth rate of an oscillation, from its extrema in the second half of a run."""
    sol = hd.solve(equation, t_end, rtol=1e-10)
    t = np.linspace(0.4 * t_end, t_end, 6000)
    x = sol(t)[:, 0] - rest
    top = 1 + np.flatnonzero((x[1:-1] - x[:-2]) * (x[2:] - x[1:-1]) < 0)
    swings = np.abs(np.diff(x[top]))  # from a maximum to a minimum: free of a slow tail
    return float(np.polyfit(t[top][1:], np.log(swings), 1)[0])


def threshold(rate, near, apart):
    """Place where a growth rate is 0, from a straight line through two places."""
    low, high = (rate(near + side * apart) for side in (-1, 1))
    return near - apart + 2 * apart * low / (low - high)


def selkov(alpha):
    return growth(scenes.selkov(alpha, y0=(0.6 + 1e-5, 0.6 / 0.44)), 400.0, 0.6)


def duffing(beta):
    return growth(scenes.van_der_pol_duffing(beta, 0.8, cubic=0.0, x0=1e-6), 120.0)


X_REST, *AT_REST = nerve_at_rest()


def nerve(beta):
    return growth(scenes.fitzhugh_nagumo(beta, x0=X_REST + 1e-6), 300.0, X_REST)


def mathieu(stiffness):
    return growth(scenes.mathieu(stiffness=stiffness), 600.0)


def begins(*linear):
    """Order of inertia at which a linear oscillator begins to oscillate."""
    return float(onset(*linear)[0])


def last(equation, t_end):
    """Value at the end of a run."""
    return float(hd.solve(equation, t_end, rtol=1e-11).y[-1, 0])


def period():
    """Period of the classical van der Pol oscillator, from maxima late in a run."""
    sol = hd.solve(scenes.van_der_pol_duffing(2.0, 1.0, cubic=0.0), 120.0, rtol=1e-10)
    times, _ = hd.maxima(sol, transient=60.0)
    return float((times[-1] - times[0]) / (times.size - 1))


def heston():
    """Real part of the rough Heston equation's solution at t = 3, a = 3 - i/2."""
    a, nu, rho, rate = 3 - 0.5j, 0.4, -0.65, 1.0
    coefficients = -0.5 * a * (a + 1j), 1j * rho * nu * a - rate, 0.5 * nu**2
    return float(hd.solve(scenes.riccati(0.7, *coefficients), 3.0, rtol=1e-9).y[-1, 0].real)


def measure(quick):
    """Rows of models: number, value measured, reference, its kind, how far they may be apart."""
    edges = mathieu_edges(0.3, 0.1, 0.5, (0.0586, 0.3414))
    onset_at, hill = "order of onset", "Hill determinant"
    airy = scenes.van_der_pol_airy(friction=0.0, x0=1.0)
    found = [
        ("selkov", onset_at, threshold(selkov, 0.905, 0.01),
         selkov_onset(0.08, 0.6), "Matignon", 1e-3),
        ("van_der_pol_duffing", onset_at, threshold(duffing, 1.337, 0.01),
         begins(-1.0, 1.0, 0.8, [1.3, 1.2]), "zeros", 1e-3),
        ("van_der_pol_duffing, classical", "period", period(),
         6.663286859, "integration in many digits", 1e-8),
        ("van_der_pol_airy", "x(5)", last(airy, 5.0), airy_series(1.8, 5.0), "series", 1e-8),
        ("fitzhugh_nagumo", onset_at, threshold(nerve, 1.818, 0.01),
         begins(*AT_REST, 1.0, [1.8, 0.9]), "zeros", 1e-3),
        ("mathieu, lower edge", "stiffness", threshold(mathieu, 0.0481, 0.001),
         edges[0], hill, 1e-3),
        ("mathieu, upper edge", "stiffness", threshold(mathieu, 0.329, 0.001),
         edges[1], hill, 1e-3),
        ("riccati", "y(0.5)", last(scenes.riccati(0.75), 0.5),
         riccati_series(0.75, 0.5), "series", 1e-8),
        ("riccati, rough Heston", "Re h(3)", heston(), -2.520564, "approximant", 1e-2),
    ]  # fmt: skip
    for model, number, value, reference, kind, within in found:
        yield {
            "model": model,
            "number": number,
            "measured": f"{value:.10g}",
            "reference": f"{reference:.10g}",
            "by": kind,
            "within": within,
        }


def draw(rows):
    """Draw an orbit of each model, with memory and without."""
    figure, axes = plt.subplots(2, 3, figsize=(12, 6), layout="constrained")
    orders = (
        lambda t: 0.97 - 0.03 * np.cos(0.1 * t),
        lambda t: 0.95 - 0.03 * np.sin(0.1 * t),
    )
    a, plain = r"$\alpha$ =", "classical"
    cases = {
        "Selkov": (80, scenes.selkov(), f"{a} 1",
                   scenes.selkov(orders, time_scale=2.0), "orders vary, time scale 2"),
        "FitzHugh-Nagumo": (60, scenes.fitzhugh_nagumo(), plain,
                            scenes.fitzhugh_nagumo(1.75, 0.9), "orders 1.75, 0.9"),
        "van der Pol-Duffing": (40, scenes.van_der_pol_duffing(2.0, 1.0), plain,
                                scenes.van_der_pol_duffing(1.6, 0.8), "orders 1.6, 0.8"),
        "van der Pol-Airy": (30, scenes.van_der_pol_airy(2.0, 1.0), plain,
                             scenes.van_der_pol_airy(), "orders 1.8, 0.8"),
        "Mathieu": (90, scenes.mathieu(gamma=1.0), "friction of order 1",
                    scenes.mathieu(gamma=0.3), "of order 0.3"),
        "Riccati": (6, scenes.riccati(1.0), f"{a} 1", scenes.riccati(0.5), f"{a} 0.5"),
    }  # fmt: skip
    for ax, (title, (t_end, one, first, other, second)) in zip(
        axes.flat, cases.items(), strict=True
    ):
        t = np.linspace(0, t_end, 1500)
        for equation, name in ((one, first), (other, second)):
            sol = hd.solve(equation, t_end, rtol=1e-6)
            ax.plot(t, sol(t)[:, 0], lw=1, label=name)
        ax.set(title=title, xlabel="t")
        ax.set_ylim(top=ax.get_ylim()[1] + 0.2 * np.ptp(ax.get_ylim()))  # room for the legend
        ax.legend(fontsize="x-small", loc="upper left", ncols=2)
    return figure


def claims(rows):
    for row in rows:
        apart, number = abs(row["measured"] - row["reference"]), row["number"]
        text = "thresholds" if number in ("order of onset", "stiffness") else "values"
        text = "rough Heston's value" if row["within"] == 1e-2 else text
        yield Claim(f"{text} apart", apart, row["within"], where=row["model"], small=True)


if __name__ == "__main__":
    study(measure, claims, draw)
