"""Responses of viscoelastic models stay within the tolerance of a run.

The problems are the strain under a stress that starts with a step, and the stress under an
oscillating strain, at t = 3. The rows have the relative error, the number of steps, and the time of
a run that makes the kernel and fits it.
The creep compliance and the operator on the function of time are exact to 1e-11.
"""

from functools import partial

import numpy as np
from _study import Claim, curves, fastest, study

import hereditary as hd
from hereditary.viscoelastic import (
    SpringPot,
    burgers,
    dashpot,
    kelvin_voigt,
    maxwell,
    poynting_thomson,
    spring,
    zener,
)

MODELS = {
    "spring-pot": lambda: SpringPot(2.0, 0.3),
    "Maxwell, two orders": lambda: maxwell(SpringPot(2.0, 0.8), SpringPot(3.0, 0.3)),
    "Maxwell, classical": lambda: maxwell(spring(2.0), dashpot(3.0)),
    "Kelvin-Voigt": lambda: kelvin_voigt(spring(2.0), SpringPot(6.0, 0.4)),
    "Kelvin-Voigt, classical": lambda: kelvin_voigt(spring(2.0), dashpot(3.0)),
    "Zener": lambda: zener(spring(1.0), spring(4.0), SpringPot(4.0, 0.6)),
    "Poynting-Thomson": lambda: poynting_thomson(spring(4.0), spring(2.0), SpringPot(2.0, 0.7)),
    "Burgers": lambda: burgers(spring(4.0), dashpot(5.0), spring(2.0), SpringPot(2.0, 0.7)),
}
END = 3.0


def step(t, strain):
    return 1.0


def waves(t, stress):
    return 0.5 * np.cos(2 * t)


def strain(made, rtol):
    return hd.solve(made().strain_equation(step), END, rtol=rtol)


def stress(made, rtol):
    return hd.solve(made().stress_equation(waves), END, rtol=rtol)


def measure(quick):
    rows = []
    for name, made in MODELS.items():
        model = made()
        known = {
            strain: model.creep(END),
            stress: hd.derivative([END], lambda s: 0.25 * np.sin(2 * s), model.operator)[0],
        }
        for respond, value in known.items():
            for rtol in (1e-4, 1e-7) if quick else 10.0 ** -np.arange(3.0, 10.0):
                seconds, sol = fastest(partial(respond, made, rtol), 3)
                rows.append(
                    {
                        "response": respond.__name__,
                        "model": name,
                        "rtol": f"{rtol:.0e}",
                        "error": f"{max(abs(sol.y[-1, 0] / value - 1), 1e-16):.2e}",
                        "steps": sol.stats["n_steps"],
                        "modes": sol.stats["n_modes"],
                        "seconds": f"{seconds:.3f}",
                    }
                )
    return rows


def claims(rows):
    for row in rows:
        where = {"where": f"{row['model']}, {row['rtol']:g}", "small": True}
        yield Claim(
            f"error of the {row['response']} over rtol", row["error"] / row["rtol"], 1, **where
        )
    yield Claim("seconds of a run at the most", max(row["seconds"] for row in rows))
    yield Claim("seconds of a run, the middle one", float(np.median([r["seconds"] for r in rows])))


if __name__ == "__main__":
    study(measure, claims, curves("seconds", "error", ("model",), ("response",)))
