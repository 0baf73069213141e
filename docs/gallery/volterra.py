"""
A Volterra equation, and a past before the start
================================================

Two equations do not have the form of the library. This page rewrites them.
"""

import matplotlib.pyplot as plt
import numpy as np
from scipy.integrate import quad
from scipy.special import gamma

import hereditary as hd

# %%
# **A Volterra equation of the second kind** is ``y(t) + int_0^t K(t - s) y(s) ds = cos t``. With
# z' = y and z(0) = 0, the integral is a memory term of z.

kernel = hd.TemperedPowerLaw(0.5, 1.0)


def driven(t, z):
    return np.cos(t)


volterra = hd.Equation(hd.Caputo(1) + hd.Memory(kernel, 1), driven, 0.0)
z = hd.solve(volterra, 10.0, rtol=1e-8)
t = 10.0 * np.linspace(0.0, 1.0, 1001) ** 3  # y falls like sqrt(t) at first
y = z(t, 1)[:, 0]

# %%
# **A given past**, y = 1 + t from t = -1 to 0, adds a known force to ``D^0.6 y = -y``. The force is
# the part of the derivative from -1 on that comes from times before 0.

ALPHA = 0.6
FACTOR = 1 / gamma(2 - ALPHA)


def remembers(t, y):
    past = FACTOR * ((t + 1) ** (1 - ALPHA) - t ** (1 - ALPHA))
    return -y - past


def forgets(t, y):
    return -y


given, none = (
    hd.solve(hd.Equation(hd.Caputo(ALPHA), rhs, 1.0), 5.0, rtol=1e-9)
    for rhs in (remembers, forgets)
)
fig, (left, right) = plt.subplots(1, 2, figsize=(8, 4.4), layout="constrained")
left.plot(t, y)
left.set(xlabel="$t$", ylabel="$y$", title="Volterra")
past = np.linspace(-1, 0, 50)
right.plot(past, 1 + past, ":", color="C0")
hd.plots.oscillogram(given, right, label="with its past", color="C0", lw=1.5)
hd.plots.oscillogram(none, right, label="without", color="C1", lw=1.5)
right.set(ylabel="$y$", title="a past before the start")
plt.show()

# %%
# Quadrature confirms that both solve their equations.


def remembered(s):
    """y(s) exp(s - 5): the integrand at t = 5 without its power of 5 - s."""
    return z(s, 1)[0] * np.exp(s - 5.0)


def slope(s):
    """y'(s) s^(1 - ALPHA), which has no singularity at 0."""
    s = max(s, 1e-12)
    return given(s, 1)[0] * s ** (1 - ALPHA)


integral = quad(remembered, 0.0, 5.0, weight="alg", wvar=(0.0, -0.5))[0]
derivative = quad(slope, 0.0, 5.0, weight="alg", wvar=(ALPHA - 1, -ALPHA))[0] / gamma(1 - ALPHA)
derivative += FACTOR * (6.0 ** (1 - ALPHA) - 5.0 ** (1 - ALPHA))
residuals = z(5.0, 1)[0] + integral - np.cos(5.0), derivative + given(5.0)[0]
assert np.abs(residuals).max() < 1e-7
print("both residuals are below 1e-7")
assert given.y[-1, 0] < none.y[-1, 0]
