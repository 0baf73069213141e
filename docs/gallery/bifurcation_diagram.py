"""
A bifurcation diagram
=====================

The figure shows the last maxima of a driven Duffing oscillator with memory against the force.
Periods double, chaos follows, and a window of period 3 interrupts it. A sweep calls one function at
every value, on all cores. Lists of maxima may have different lengths.
"""

import matplotlib.pyplot as plt
import numpy as np

import hereditary as hd

PERIOD = 2 * np.pi / 1.2


def maxima(force):
    equation = hd.scenes.duffing(
        beta=1.98, gamma=0.98, friction=0.3, stiffness=-1.0, force=force, frequency=1.2, x0=0.5
    )
    sol = hd.solve(equation, 120 * PERIOD, rtol=1e-6)
    _, values = hd.maxima(sol, transient=80 * PERIOD)
    return {"x": values, "status": sol.status}


table = hd.sweep(maxima, {"force": np.linspace(0.2, 0.5, 451)}, progress=False)
assert table.success.all()

fig, ax = plt.subplots(figsize=(8, 5), layout="constrained")
hd.plots.bifurcation(table, "x", ax, ms=1, ylabel="maxima of x after 80 periods")
plt.show()


def different(force):
    """Count the maxima that differ by more than 0.01."""
    row = table["x"][np.abs(table.axes["force"] - force).argmin()]
    return 1 + int((np.diff(np.sort(row[np.isfinite(row)])) > 0.01).sum())


counts = [different(force) for force in (0.2, 0.3, 0.31, 0.376, 0.45)]
print("maxima that differ:", counts[:4])
assert counts[:4] == [1, 2, 4, 3]
assert counts[4] > 10

# %%
# With memory a motion approaches its cycle like a power of t, not exponentially. Points that seem
# to scatter around a branch may still move towards it. Compare with a later transient before you
# call them chaos.

spread = np.ptp(table["x"][0][np.isfinite(table["x"][0])])
print(f"spread of maxima at the smallest force: {spread:.1e}")
assert 1e-7 < spread < 1e-5
