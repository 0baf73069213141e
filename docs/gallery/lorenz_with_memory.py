"""
Lorenz with memory, and why restarted memory lies
=================================================

A published algorithm for exponents restarts the solver at each renormalisation, so that the memory
is lost. For the Lorenz system of order 0.99 it finds chaos, although the solution comes to rest.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import hereditary as hd

equation = hd.scenes.lorenz(alpha=0.99)  # sigma 10, rho 28, b 8/3
orbit = hd.solve(equation, 100.0, rtol=1e-8)

# x = y = -sqrt(b (rho - 1)) and z = rho - 1 at the equilibrium
t = np.linspace(0.0, 100.0, 10_000, endpoint=False)
distance = np.linalg.norm(orbit(t) - [-np.sqrt(72), -np.sqrt(72), 27], axis=1)

fig, (left, right) = plt.subplots(1, 2, figsize=(10, 4), layout="constrained")
hd.plots.phase_portrait(orbit, left, components=[0, 2], lw=0.4)
left.set(xlabel="x", ylabel="z", title="the orbit spirals into an equilibrium")
right.semilogy(t, distance, lw=0.6)
right.set(xlabel="t", ylabel="distance from the equilibrium")

# from t = 20 on the largest distance in ten time units is about half of the one before
largest = distance.reshape(10, 1000).max(axis=1)[2:]
assert np.all(largest[1:] < 0.6 * largest[:-1])
assert largest[-1] < 0.02

# %%
# With the full memory the largest exponent is at first the rate at which these swings decay. Later
# they decay like a power of t, and the exponent tends to 0 from below. If the memory is restarted
# every 0.02, the result is the exponent of a chaotic attractor, which this equation does not have.
# The values are those of the study ``convergence/restarting.py``.

kept = hd.lyapunov(equation, 400.0, 80_000, transient=20.0)
results = Path("../../convergence/results/restarting.csv")  # from docs/gallery in a clone
rows = np.genfromtxt(results, None, delimiter=",", skip_header=1, names=True, encoding="utf-8")
chosen = (rows["case"] == "trace") & (rows["mode"] == "restart") & (rows["interval"] == "0.02")
restarted = rows[chosen & (rows["t"] <= 400.0)]
print("kept:", kept.exponents[0], " restarted:", restarted["lambda_1"][-1])
early = np.interp(100.0, kept.times, kept.trace[:, 0])
assert early < -0.06 < kept.exponents[0] < -0.02
assert restarted["lambda_1"][-1] > 0.8

fig, ax = plt.subplots(figsize=(7, 4), layout="constrained")
ax.plot(kept.times, kept.trace[:, 0], label="memory kept")
ax.plot(restarted["t"], restarted["lambda_1"], label="memory restarted")
ax.axhline(0, color="0.6", lw=0.8)
ax.set(xlabel="T", ylabel="largest exponent up to T", ylim=(-0.5, 1.2))
ax.legend()
plt.show()
