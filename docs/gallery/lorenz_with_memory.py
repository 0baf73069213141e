"""
Lorenz with memory, and why restarted memory lies
=================================================

A published algorithm for exponents calls the solver afresh at each renormalisation, so that the
memory begins anew. For the Lorenz system of order 0.99 that finds chaos where the equation comes
to rest.
"""

import matplotlib.pyplot as plt

import hereditary as hd

equation = hd.scenes.lorenz(alpha=0.99)  # sigma 10, rho 28, b 8/3
orbit = hd.solve(equation, 100.0, n_steps=20_000)

fig, ax = plt.subplots(figsize=(6, 4), layout="constrained")
ax.plot(orbit.y[:, 0], orbit.y[:, 2], lw=0.4)
ax.set(xlabel="x", ylabel="z", title="the orbit spirals into an equilibrium")

# %%
# With the memory kept the largest exponent tends to 0 from below, as it must on an orbit that
# comes to rest like a power of t. Restarted every 0.05 it is that of a chaotic attractor which
# this equation does not have.

kept = hd.lyapunov(equation, 100.0, 20_000, transient=20.0)
restarted = hd.lyapunov(equation, 100.0, 20_000, transient=20.0, mode="restart", renorm=0.05)
print("kept:", kept.exponents[0], " restarted:", restarted.exponents[0])
assert kept.exponents[0] < 0 < restarted.exponents[0]

fig, ax = plt.subplots(figsize=(7, 4), layout="constrained")
for result, name in ((kept, "memory kept"), (restarted, "memory restarted")):
    ax.plot(result.times, result.trace[:, 0], label=name)
ax.axhline(0, color="0.6", lw=0.8)
ax.set(xlabel="T", ylabel="largest exponent up to T", ylim=(-0.5, 1.2))
ax.legend()
plt.show()
