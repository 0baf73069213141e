"""
A nerve that memory makes bistable
==================================

The FitzHugh-Nagumo nerve is one oscillator whose friction has memory and depends on the state. If
the order of inertia is below 1.818, its rest is stable. At 1.75 the nerve still fires if it starts
far from rest. At 1.6 it never fires, and at 1.9 it fires from every start.
"""

import matplotlib.pyplot as plt
import numpy as np

import hereditary as hd

fig, axes = plt.subplots(3, 1, figsize=(7, 5), sharex=True, layout="constrained")
fires = {}
for ax, beta in zip(axes, (1.6, 1.75, 1.9), strict=True):
    for x0 in (0.1, 0.9):
        sol = hd.solve(hd.scenes.fitzhugh_nagumo(beta=beta, x0=x0), 150.0, rtol=1e-7)
        hd.plots.oscillogram(sol, ax, lw=1, label=f"x(0) = {x0}")
        swing = np.ptp(sol.y[sol.t > 120])
        assert not 0.1 < swing < 2  # at rest, or firing
        fires[beta, x0] = bool(swing > 2)
    ax.set(title=f"order of inertia {beta}", ylim=(-2.5, 2.5))
for ax in axes[:-1]:
    ax.set_xlabel("")
for ax in axes[1:]:
    ax.get_legend().remove()
plt.show()
assert [pair for pair, yes in fires.items() if yes] == [(1.75, 0.1), (1.9, 0.1), (1.9, 0.9)]
