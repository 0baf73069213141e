"""
A fractional PID control loop
=============================

A PI^lambda D^mu controller holds a plant ``D^0.9 y + y = u`` to a reference. The derivative of the
error is memory that the right-hand side reads.
"""

import matplotlib.pyplot as plt
import numpy as np

import hereditary as hd

# %%
# There are three components: the plant, the integral of order 0.6 of the error, and the reference,
# here a ramp up to t = 2. The slope of the reference is known, so its derivative of order 0.4 is
# memory too.


def loop(t, y, memory, p):
    error = y[2] - y[0]
    control = p[0] * error + p[1] * y[1] + p[2] * (memory[0, 2] - memory[0, 0])
    return np.array([control - y[0], error, 0.5 if t < 2.0 else 0.0])


def controlled(proportional, integral, derivative):
    return hd.Equation(
        hd.Caputo([0.9, 0.6, 1.0]),
        loop,
        [0.0, 0.0, 0.0],
        params=[proportional, integral, derivative],
        memory=hd.Caputo(0.4),
    )


fig, ax = plt.subplots(figsize=(8, 4), layout="constrained")
errors = []
for gains, name in (((2.0, 0.0, 0.0), "P"), ((2.0, 3.0, 0.0), "PI"), ((2.0, 3.0, 0.8), "PID")):
    sol = hd.solve(controlled(*gains), 10.0, rtol=1e-8, breaks=[2.0])
    y = sol(np.array([2.0, 5.0, 10.0]))
    errors.append(y[:, 2] - y[:, 0])
    name = f"{name}, error at the end {errors[-1][-1]:.1e}"
    hd.plots.oscillogram(sol, ax, components=0, label=name, lw=1.5)
hd.plots.oscillogram(sol, ax, components=2, label="reference", ls="--", color="0.5")
ax.set(ylabel="plant", title="")
plt.show()

# %%
# Without an integral an error of 1/3 remains. With it the error continues to fall. The derivative
# makes the error smaller while the reference moves.

p, pi, pid = errors
assert abs(p[2] - 1 / 3) < 0.01
assert max(pi[2], pid[2]) < 0.05
assert pi[2] < 0.8 * pi[1]
assert pid[0] < 0.97 * pi[0]
