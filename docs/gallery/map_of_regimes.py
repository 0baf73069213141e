"""
A map of regimes
================

The map shows how a stick-slip oscillator with memory moves, for each speed of the pull and strength
of the wells.
"""

import math

import matplotlib.pyplot as plt
import numpy as np

import hereditary as hd


def regime(spring_speed, adhesion):
    equation = hd.scenes.stick_slip(spring_speed=spring_speed, adhesion=adhesion)
    sol = hd.solve(equation, 200.0, rtol=1e-6)
    found = hd.classify(sol, period=2 * math.pi / spring_speed)
    return {"regime": found.regime, "certainty": found.certainty, "status": sol.status}


grid = {"adhesion": np.linspace(0.5, 13.0, 26), "spring_speed": np.linspace(0.4, 3.0, 26)}
table = hd.sweep(regime, grid, progress=False)

fig, ax = plt.subplots(figsize=(7, 5), layout="constrained")
hd.plots.regime_map(table, ax=ax)
plt.show()

# %%
# A pale cell has an uncertain verdict: thresholds are varied, and the certainty is the share of the
# variations that agree. ``store="map"`` would keep every finished point in a file, so that a long
# sweep can continue after it was stopped.

assert table.success.all()
print("regimes:", ", ".join(np.unique(table["regime"])))
assert table["regime"][0, -1] == "sliding"  # shallow wells, fast pull
assert np.mean(table["regime"][13:] == "stick-slip, periodic") > 0.9  # deep wells
