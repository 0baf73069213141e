"""
A Volterra equation, and a past before the start
================================================

Two equations that are not of the library's form, written in it.
"""

import matplotlib.pyplot as plt
import numpy as np
from scipy.special import gamma

import hereditary as hd

# %%
# **A Volterra equation of the second kind**, ``y(t) = cos t - int_0^t K(t - s) y(s) ds``. With z'
# = y, z(0) = 0, the integral is a memory term of z that the right-hand side reads: one extra
# component.

kernel = hd.TemperedPowerLaw(0.5, 1.0)


def from_memory(t, z, memory):
    return np.cos(t) - memory[0]


volterra = hd.Equation(hd.Caputo(1), from_memory, 0.0, memory=hd.Memory(kernel, 1))
z = hd.solve(volterra, 10.0, 8000, scheme=hd.L1())
y = z(z.t, 1)[:, 0]

# %%
# **A given past**, y = 1 + t from t = -1 to 0, adds a known force to ``D^0.6 y = -y``: what the
# derivative that begins at -1 has gathered before 0.

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
fig, (left, right) = plt.subplots(1, 2, figsize=(10, 4), layout="constrained")
left.plot(z.t, y)
left.set(xlabel="$t$", ylabel="$y$", title="Volterra")
past = np.linspace(-1, 0, 50)
(line,) = right.plot(given.t, given.y[:, 0], label="with its past")
right.plot(past, 1 + past, ":", color=line.get_color())
right.plot(none.t, none.y[:, 0], label="without")
right.set(xlabel="$t$", ylabel="$y$", title="a past before the start")
right.legend()
plt.show()
assert given.y[-1, 0] < none.y[-1, 0]
