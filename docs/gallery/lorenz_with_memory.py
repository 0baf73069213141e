"""
Lorenz with memory, and why restarted memory lies
=================================================

A published algorithm for exponents restarts the solver at each renormalisation, so that the memory
is lost. For the Lorenz system of order 0.99 it finds chaos, although the solution comes to rest.
"""

# sphinx_gallery_thumbnail_number = 2
import matplotlib.pyplot as plt
import numpy as np

import hereditary as hd

equation = hd.scenes.lorenz(alpha=0.99)  # sigma 10, rho 28, b 8/3
orbit = hd.solve(equation, 100.0, rtol=1e-8)

# x = y = -sqrt(b (rho - 1)) and z = rho - 1 at the equilibrium
t = np.linspace(0.0, 100.0, 10_000, endpoint=False)
distance = np.linalg.norm(orbit(t) - [-np.sqrt(72), -np.sqrt(72), 27], axis=1)

fig, (left, right) = plt.subplots(1, 2, figsize=(8, 4.4), layout="constrained")
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
times, restarted = np.array(
    [
        (2.76, 0.205),
        (3.78, 0.087),
        (5.18, 0.141),
        (7.08, 0.089),
        (9.72, 0.047),
        (13.32, 0.105),
        (18.28, 0.259),
        (25.06, 0.494),
        (34.38, 0.603),
        (47.14, 0.713),
        (64.66, 0.790),
        (88.7, 0.822),
        (121.66, 0.865),
        (166.86, 0.889),
        (228.86, 0.907),
        (313.92, 0.917),
        (387.52, 0.911),
    ]
).T
print("kept:", kept.exponents[0].round(3), " restarted:", restarted[-1])
early = np.interp(100.0, kept.times, kept.trace[:, 0])
assert early < -0.06 < kept.exponents[0] < -0.02
assert restarted[-1] > 0.8

fig, ax = plt.subplots(figsize=(7, 4), layout="constrained")
ax.plot(kept.times, kept.trace[:, 0], label="memory kept")
ax.plot(times, restarted, "o-", ms=4, label="memory restarted")
ax.axhline(0, color="0.6", lw=0.8)
ax.set(xlabel="T", ylabel="largest exponent up to T", ylim=(-0.5, 1.2))
ax.legend()
plt.show()
