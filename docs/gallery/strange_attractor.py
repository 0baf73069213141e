"""
A strange attractor with memory
===============================

Orbits of the Lorenz system of order 0.99 are drawn to a strange attractor, if the Rayleigh number
is 45. At 28, where the classical system is chaotic, they come to rest.
"""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.collections import LineCollection

import hereditary as hd

equation = hd.scenes.lorenz(alpha=0.99, rho=45.0)
orbit = hd.solve(equation, 120.0, rtol=1e-6)

fig, axes = plt.subplots(1, 2, figsize=(10, 4.6), layout="constrained")
times = np.linspace(10.0, 120.0, 22_000)
y = orbit(times)
speed = np.linalg.norm(np.diff(y, axis=0), axis=1) / np.diff(times)
for ax, (i, j), names in zip(axes, ((0, 2), (0, 1)), ("xz", "xy"), strict=True):
    pieces = np.stack([y[:-1, [i, j]], y[1:, [i, j]]], axis=1)
    lines = LineCollection(pieces, array=speed, cmap="turbo", lw=0.35)
    ax.add_collection(lines)
    ax.autoscale()
    ax.set(xlabel=names[0], ylabel=names[1])
fig.colorbar(lines, ax=axes, label="speed [1/time]")
plt.show()

# %%
# The largest Lyapunov exponent, with the full memory, says that neighbouring orbits separate
# exponentially. So the figure is one of many: an orbit whose start differs in the tenth digit
# has the same attractor, but another way on it after 20 units of time.

found = hd.lyapunov(equation, 200.0, 40_000)
print("largest exponent about", round(found.exponents[0], 1), "-", found.verdict)
assert found.verdict == "exponential growth"
assert 1.0 < found.exponents[0] < 1.4
