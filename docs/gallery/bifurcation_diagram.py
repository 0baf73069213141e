"""
A bifurcation diagram
=====================

The last maxima of a driven Duffing oscillator with memory against the force. A sweep calls one
function at every value, on all cores; lists of maxima may have different lengths.
"""

import matplotlib.pyplot as plt
import numpy as np

import hereditary as hd

PERIOD = 2 * np.pi / 1.2


def maxima(force):
    equation = hd.scenes.duffing(
        beta=1.98, gamma=0.98, friction=0.3, stiffness=-1.0, force=force, frequency=1.2, x0=0.5
    )
    sol = hd.solve(equation, 120 * PERIOD, n_steps=120 * 200, scheme=hd.BDF(2))
    _, values = hd.maxima(sol, transient=80 * PERIOD)
    return {"x": values, "status": sol.status}


table = hd.sweep(maxima, {"force": np.linspace(0.2, 0.5, 151)}, progress=False)
assert table.success.all()

fig, ax = plt.subplots(figsize=(8, 5), layout="constrained")
hd.plots.bifurcation(table, "x", ax, ylabel="maxima of x after 80 periods")
plt.show()

# %%
# With memory a motion reaches its cycle like a power of t, not exponentially: points that seem to
# scatter around a branch may still be on their way. Compare a later transient before calling them
# chaos.

smallest = [np.ptp(row[np.isfinite(row)]) for row in table["x"]]
print(f"spread of maxima at the smallest force: {smallest[0]:.1e}")
