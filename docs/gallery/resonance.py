"""
Resonance of a Duffing oscillator
=================================

The steady response to a periodic force, followed through its turning points by harmonic balance,
and the backbone.
"""

import matplotlib.pyplot as plt
import numpy as np

import hereditary as hd


def spring(t, x, p):
    return p[1] * np.cos(p[0] * t) - x - p[2] * x**3


terms = hd.Caputo(1.95) + 0.1 * hd.Caputo(0.9)
equation = hd.Equation(terms, spring, [0.0, 0.0], params=[1.0, 0.3, 0.5])
response = hd.frequency_response(equation, np.linspace(0.4, 2.4, 201))
assert response.complete
print("jumps of a slow sweep at", response.turning)

axes = hd.plots.amplitude_and_phase(response)

# %%
# The peaks of curves for ever larger forces make up the backbone: the spring hardens.

omegas = np.linspace(0.6, 2.2, 81)
fig, ax = plt.subplots(figsize=(7, 4), layout="constrained")
backbone = []
for force in (0.05, 0.1, 0.15, 0.2, 0.25):
    curve = hd.frequency_response(equation.replace(params=[1.0, force, 0.5]), omegas)
    backbone.append(curve.peak())
    hd.plots.frequency_response(curve, ax)
ax.plot(*np.transpose(backbone), "o-", color="0.3", label="backbone")
ax.legend()
plt.show()
