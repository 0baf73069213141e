"""
A population that reacts late
=============================

In Mackey and Glass's equation a population of cells is renewed by those that were there a time tau
ago. Here its rate of change has memory too. For a short delay the population comes to rest. With
the delay come cycles, whose periods double, and irregular motion.
"""

import matplotlib.pyplot as plt
import numpy as np

import hereditary as hd


def renewed(t, y, late):
    return 2 * late[0] / (1 + late[0] ** 9.65) - y


def population(tau):
    return hd.Equation(hd.Caputo(0.95), renewed, 0.5, memory=hd.Delay(tau, past=0.5))


def maxima(tau):
    sol = hd.solve(population(tau), 150.0, rtol=1e-5)
    _, values = hd.maxima(sol, transient=100.0)
    return {"y": values if values.size else sol.y[-1], "status": sol.status}


delays = np.append(np.arange(0.3, 1.7, 0.05), np.linspace(1.7, 2.5, 97))
table = hd.sweep(maxima, {"tau": delays}, progress=False)
assert table.success.all()

fig, (left, right) = plt.subplots(1, 2, figsize=(11, 4.5), layout="constrained")
hd.plots.bifurcation(table, "y", left, ms=1.5, ylabel="maxima of y from t = 100 on")
sol = hd.solve(population(2.2), 150.0, rtol=1e-6)
hd.plots.phase_portrait(sol, right, delay=2.2, lw=0.5)
plt.show()

# %%
# The delayed value against the present one takes the place of a phase plane. The state of a delay
# equation is the solution over a whole delay, which the figure shows from two sides only.


def different(tau):
    """Count the maxima that differ by more than 0.02."""
    row = table["y"][np.abs(delays - tau).argmin()]
    return 1 + int((np.diff(np.sort(row[np.isfinite(row)])) > 0.02).sum())


print("maxima that differ:", [different(tau) for tau in (0.3, 1.0, 1.4)])
assert [different(tau) for tau in (0.3, 1.0, 1.4)] == [1, 1, 2]
assert different(2.4) > 5
