"""
Relaxation with an order that varies
====================================

In ``D^alpha(t) y = -y`` the order falls with time: the memory of the body grows longer as it ages.
The order at the present time applies to the whole past.
"""

import matplotlib.pyplot as plt
import numpy as np

import hereditary as hd


def ageing(t):
    return 0.9 - 0.4 * (1 - np.exp(-t / 2))


def decay(t, y):
    return -y


fig, ax = plt.subplots(figsize=(6, 4), layout="constrained")
times = np.geomspace(1e-2, 20.0, 400)
curves = []
for order, name in ((0.9, "0.9"), (0.5, "0.5"), (ageing, "from 0.9 to 0.5")):
    sol = hd.solve(hd.Equation(hd.Caputo(order), decay, 1.0), 20.0, rtol=1e-8)
    curves.append(sol(times)[:, 0])
    ax.loglog(times, curves[-1], label=name)
ax.set(xlabel="$t$", ylabel="$y$")
ax.legend(title="order")

# at first the body decays like the one of order 0.9, at last like the one of order 0.5
early, late, changing = curves
assert np.all(np.abs(changing / early - 1)[times < 0.2] < 0.01)
assert np.all(np.abs(changing / late - 1)[times > 15.0] < 0.02)

# %%
# How accurate are given steps? The errors of L1 are against the run with a tolerance.

equation = hd.Equation(hd.Caputo(ageing), decay, 1.0)
exact = hd.solve(equation, 20.0, rtol=1e-9).y[-1, 0]
counts = np.array([250, 500, 1000, 2000])
errors = [abs(hd.solve(equation, 20.0, n, scheme=hd.L1()).y[-1, 0] - exact) for n in counts]
fig, ax = plt.subplots(figsize=(6, 4), layout="constrained")
ax.loglog(counts, errors, "o-")
ax.loglog(counts, errors[0] * counts[0] / counts, "--", color="0.6", label="first order")
ax.set(xlabel="steps", ylabel="error at the end")
ax.set_xticks(counts, counts)
ax.set_xticks([], minor=True)
ax.legend()
plt.show()
assert np.all(np.abs(np.divide(errors[:-1], errors[1:]) - 2) < 0.1)
