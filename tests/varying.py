"""Orders that vary in time, and forces to go with them."""

import numpy as np


def alpha(t):
    return 0.5 + 0.3 * np.sin(t)


def beta(t):
    return 1.5 + 0.3 * np.cos(t)


def decay(t, y):
    return np.cos(t) - y


def swing(t, y):
    return np.array([np.sin(y[1]) - y[0] ** 3 + np.cos(t), y[0] * y[1] - 2.0 * y[1]])
