r"""
Oscillators that hear each other late
=====================================

Thirty phase oscillators are coupled along sixty links, each with a delay of its own. With short
delays they agree on a phase. With long ones they do not.

.. math:: \dot\theta_i = \omega_i + K \sum_j \sin(\theta_j(t - \tau_{ij}) - \theta_i)
"""

import matplotlib.pyplot as plt
import numpy as np

import hereditary as hd

N, LINKS, T_END = 30, 60, 60.0
rng = np.random.default_rng(4)
target, source = np.repeat(np.arange(N), LINKS // N), rng.integers(0, N, LINKS)
speed, start = rng.normal(1.0, 0.05, N), rng.uniform(0.0, 2 * np.pi, N)


def phases(t, y, late):
    slope = speed.copy()
    for k in range(LINKS):
        slope[target[k]] += 0.4 * np.sin(late[k, source[k]] - y[target[k]])
    return slope


# %%
# The size of the mean of exp(i theta) is 1 if all phases agree.

plt.style.use(hd.plots.STYLE)
fig, ax = plt.subplots(figsize=(8, 3.6), layout="constrained")
t = np.linspace(0.0, T_END, 600)
for longest in (0.2, 3.0):
    memory = [hd.Delay(tau) for tau in rng.uniform(0.1, longest, LINKS)]
    sol = hd.solve(hd.Equation(hd.Caputo([1.0] * N), phases, start, memory=memory), T_END)
    assert sol.success
    agreement = np.abs(np.exp(1j * sol(t)).mean(axis=1))
    ax.plot(t, agreement, label=f"delays of 0.1 to {longest:g}")
ax.set(xlabel="$t$", ylabel=r"$|\langle e^{i\theta} \rangle|$", ylim=(0, 1.05))
ax.legend()
plt.show()
