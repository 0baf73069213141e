"""
Viscoelastic bodies: Bagley-Torvik's plate and Zener's solid
============================================================

The first body is a plate in a Newtonian fluid, ``A x'' + B D^1.5 x + C x = f``. The second is a
solid whose stress has memory.
"""

import matplotlib.pyplot as plt
import numpy as np

import hereditary as hd


def pushed(t, x):
    return 8.0 * (t < 1.0) - x


plate = hd.Equation(1.0 * hd.Caputo(2) + 0.5 * hd.Caputo(1.5), pushed, [0.0, 0.0])
motion = hd.solve(plate, 30.0, rtol=1e-10, breaks=[1.0])
_, tops = hd.maxima(motion)
print("tops of its swings:", tops.round(3))
assert np.all(tops[1:] < 0.45 * tops[:-1])

fig, ax = plt.subplots(figsize=(7, 3.5), layout="constrained")
hd.plots.oscillogram(motion, ax)
ax.set(title="Bagley-Torvik, pushed for one time unit")

# %%
# Zener's solid is ``sigma + tau**a D^a sigma = E eps + (E + E_1) tau**a D^a eps``. The strain is a
# ramp and then constant. Stress and strain are two components, and the rate of the strain is known.

A, TAU, E, E_1 = 0.6, 1.0, 1.0, 4.0


def solid(t, y, memory):
    ramp = 1.0 if t < 0.5 else 0.0
    stress = E * y[1] + (E + E_1) * TAU**A * memory[0, 1] - y[0]
    return np.array([stress / TAU**A, ramp])


equation = hd.Equation(hd.Caputo([A, 1.0]), solid, [0.0, 0.0], memory=hd.Caputo([0.3, A]))
held = hd.solve(equation, 20.0, rtol=1e-8, breaks=[0.5])
assert held.success
fig, ax = plt.subplots(figsize=(7, 3.5), layout="constrained")
hd.plots.oscillogram(held, ax, components=0)
ax.axhline(E * 0.5, color="0.6", lw=0.8)
ax.set(title="Zener's solid, strain ramped and held", ylabel="stress")
plt.show()

# %%
# The stress relaxes to ``E eps`` like a power of t: long after the ramp a large part of the excess
# remains.

excess = held(np.array([0.5, 10.0, 20.0]))[:, 0] - E * 0.5
print(f"at the end {excess[2] / excess[0]:.3f} of the excess after the ramp remain")
assert excess[2] > 0.1 * excess[0]
assert abs(np.log2(excess[1] / excess[2]) - A) < 0.05  # t^-A
