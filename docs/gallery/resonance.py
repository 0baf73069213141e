"""
Resonance of a Duffing oscillator
=================================

Harmonic balance follows the periodic response to a force through its turning points. The peaks for
several forces are the backbone curve.
"""

# sphinx_gallery_thumbnail_number = 2
import matplotlib.pyplot as plt
import numpy as np

import hereditary as hd


def spring(t, x, p):
    return p[1] * np.cos(p[0] * t) - x - p[2] * x**3


terms = hd.Caputo(1.98) + 0.05 * hd.Caputo(0.9)
equation = hd.Equation(terms, spring, [0.0, 0.0], params=[1.0, 0.3, 0.5])
response = hd.frequency_response(equation, np.linspace(0.4, 2.4, 201))
assert response.complete
print("jumps of a slow sweep at", response.turning.round(4))
up, down = response.turning
assert up > down + 0.2

axes = hd.plots.amplitude_and_phase(response)

# %%
# A long run from rest ends on the curve: its last period has the same first harmonic.

run = hd.solve(equation.replace(params=[2.0, 0.3, 0.5]), 100 * np.pi, rtol=1e-8)
t = np.linspace(99 * np.pi, 100 * np.pi, 400, endpoint=False)
found = 2 * abs(np.mean(run(t)[:, 0] * np.exp(-2j * t)))
balanced = response.amplitude[np.abs(response.values - 2.0).argmin(), 0]
print(f"amplitude of the run {found:.5f}, of the balance {balanced:.5f}")
assert abs(found / balanced - 1) < 0.002

# %%
# The peaks for larger and larger forces are the backbone curve. It bends to the right, because the
# spring hardens.

omegas = np.linspace(0.6, 2.2, 161)
fig, ax = plt.subplots(figsize=(7, 4), layout="constrained")
backbone = []
for force in (0.05, 0.1, 0.15, 0.2, 0.25):
    curve = hd.frequency_response(equation.replace(params=[1.0, force, 0.5]), omegas)
    backbone.append(curve.peak())
    hd.plots.frequency_response(curve, ax)
assert np.all(np.diff(backbone, axis=0) > 0)
ax.plot(*np.transpose(backbone), "o-", color="0.3", label="backbone")
ax.legend()
plt.show()
