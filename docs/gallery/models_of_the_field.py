"""
A nerve that memory makes bistable
==================================

FitzHugh and Nagumo's nerve as one oscillator whose friction has memory and depends on the state.
Below an order of inertia of 1.818 its rest is stable, yet a large start fires on.
"""

import matplotlib.pyplot as plt
import numpy as np

import hereditary as hd

fig, axes = plt.subplots(1, 3, figsize=(11, 3.5), sharey=True, layout="constrained")
for ax, beta in zip(axes, (1.6, 1.75, 1.9), strict=True):
    swings = []
    for x0 in (0.1, 0.9):
        sol = hd.solve(hd.scenes.fitzhugh_nagumo(beta=beta, x0=x0), 150.0, rtol=1e-7)
        t = np.linspace(0, 150, 3000)
        ax.plot(t, sol(t)[:, 0], lw=1, label=f"x(0) = {x0}")
        swings.append(np.ptp(sol.y[sol.t > 120]) > 1)
    ax.set(title=f"order of inertia {beta}", xlabel="$t$")
    print(beta, "fires from a large and from a small start:", *swings)
axes[0].set_ylabel("$x$")
axes[0].legend()
plt.show()
