"""Equations with orders that vary, and their solutions."""

import math

import numpy as np

import hereditary as hd


def alpha(t):
    """An order in (0, 1]."""
    return 0.5 + 0.3 * np.sin(t)


def beta(t):
    """An order in (1, 2]."""
    return 1.5 + 0.3 * np.cos(t)


def forced_below(t, y):
    a = 0.5 + 0.3 * math.sin(t)
    return 6 / math.gamma(4 - a) * t ** (3 - a) + 1 + t**3 - y


def forced_above(t, y):
    b = 1.5 + 0.3 * math.cos(t)
    return 6 / math.gamma(4 - b) * t ** (3 - b) + 1 + 2 * t + t**3 - y


def forced_both(t, y):
    b, a = 1.5 + 0.3 * math.cos(t), 0.5 + 0.3 * math.sin(t)
    lower = 6 / math.gamma(4 - a) * t ** (3 - a) + 2 / math.gamma(2 - a) * t ** (1 - a)
    return 6 / math.gamma(4 - b) * t ** (3 - b) + 0.5 * lower + 1 + 2 * t + t**3 - y


BOTH = [hd.Caputo(beta), 0.5 * hd.Caputo(alpha)]
# Equations with the solutions 1 + v t + t**3, and v.
MADE = {
    "below one": (lambda: hd.Equation(hd.Caputo(alpha), forced_below, 1.0), 0),
    "above one": (lambda: hd.Equation(hd.Caputo(beta), forced_above, [1.0, 2.0]), 2),
    "both": (lambda: hd.Equation(BOTH, forced_both, [1.0, 2.0]), 2),
}
