"""Axes and their labels."""

import matplotlib.pyplot as plt

# Names of the scenes' parameters in figures; scaled quantities have no unit.
LABELS = {
    "alpha": r"order $\alpha$ [-]",
    "beta": r"order of inertia $\beta$ [-]",
    "gamma": r"order of friction $\gamma$ [-]",
    "friction": r"friction $\lambda$ [-]",
    "omega": r"spring frequency $\omega$ [1/time]",
    "spring_speed": r"spring speed $b$ [-]",
    "adhesion": r"adhesion $c$ [-]",
}


def made(ax):
    """Given axes, or new ones."""
    return plt.subplots(layout="constrained")[1] if ax is None else ax


def label(name):
    """How an axis of that name is labelled."""
    return LABELS.get(name, name)
