"""
A neuron with memory that fires
===============================

A leaky integrate-and-fire neuron, ``D^alpha v = I - v``, is reset to 0 when v reaches 1. The reset
is a jump of the state: it does not enter the memory of the derivative.
"""

import matplotlib.pyplot as plt
import numpy as np

import hereditary as hd


def fire(t, v):
    return v[0] - 1.0


fire.direction = 1
fire.change = lambda t, v: 0.0 * v


def leaky(t, v):
    return 1.5 - v


fig, ax = plt.subplots(figsize=(8, 4), layout="constrained")
intervals = {}
for alpha in (1.0, 0.8):
    sol = hd.solve(hd.Equation(hd.Caputo(alpha), leaky, 0.0), 12.0, rtol=1e-9, events=fire)
    intervals[alpha] = np.diff(sol.t_events[0], prepend=0.0)
    print(f"alpha = {alpha}: intervals", np.round(intervals[alpha], 3))
    hd.plots.oscillogram(sol, ax, lw=1.5, label=rf"$\alpha$ = {alpha}")
ax.set(ylabel="$v$", title="")
ax.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))
plt.show()

# %%
# Without memory all intervals are log 3. With memory they grow, because the derivative remembers
# every earlier rise, but not the resets.

assert np.allclose(intervals[1.0], np.log(3), rtol=0, atol=1e-7)
assert np.all(np.diff(intervals[0.8]) > 0.1)
