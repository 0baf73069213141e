r"""
Stick and slip with dry friction
================================

A block on a belt sticks until its spring pulls harder than the friction holds, slips back, and
sticks again. Memory of the motion damps the slips.

.. math:: \dot x = v, \qquad D^\alpha v = -x + \frac{\operatorname{sign}(V - v)}{1 + 1.5 |V - v|}
"""

import matplotlib.pyplot as plt
import numpy as np

import hereditary as hd

BELT, T_END = 0.2, 40.0


def block(t, y):
    relative = BELT - y[1]
    return np.array([y[1], -y[0] + np.sign(relative) / (1 + 1.5 * abs(relative))])


def relative_speed(t, y):
    return BELT - y[1]


# %%
# The block sticks in the grey spans, which ``sol.stats["slides"]`` lists.

plt.style.use(hd.plots.STYLE)
fig, axes = plt.subplots(2, 1, figsize=(8, 4.4), sharex=True, layout="constrained")
for ax, alpha in zip(axes, (1.0, 0.7), strict=True):
    equation = hd.Equation(hd.Caputo([1.0, alpha]), block, [0.0, BELT])
    sol = hd.solve(equation, T_END, switches=relative_speed)
    assert sol.success
    hd.plots.oscillogram(sol, ax)
    ax.set(title=rf"$\alpha = {alpha:g}$", ylabel="", xlabel="")
    ax.legend(ax.lines, ["$x$", "$v$"], loc="lower right")
axes[-1].set_xlabel("$t$")
plt.show()
