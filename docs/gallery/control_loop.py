"""
A fractional PID control loop
=============================

A PI^lambda D^mu controller holds a plant ``D^0.9 y + y = u`` to a reference. The derivative of the
error is memory that the right-hand side reads.
"""

import matplotlib.pyplot as plt
import numpy as np

import hereditary as hd

# %%
# Three components: the plant; the integral of order 0.6 of the error; the reference, here a ramp
# that is held from t = 2 on, whose slope is known, so that its derivative of order 0.4 is memory
# as that of y is.


def loop(t, y, memory, p):
    error = y[2] - y[0]
    control = p[0] * error + p[1] * y[1] + p[2] * (memory[0, 2] - memory[0, 0])
    return np.array([control - y[0], error, 0.5 if t < 2.0 else 0.0])


def controlled(proportional, integral, derivative):
    return hd.Equation(
        hd.Caputo([0.9, 0.6, 1.0]),
        loop,
        [0.0, 0.0, 0.0],
        params=[proportional, integral, derivative],
        memory=hd.Caputo(0.4),
    )


fig, ax = plt.subplots(figsize=(8, 4), layout="constrained")
for gains, name in (((2.0, 0.0, 0.0), "P"), ((2.0, 3.0, 0.0), "PI"), ((2.0, 3.0, 0.8), "PID")):
    sol = hd.solve(controlled(*gains), 10.0, rtol=1e-8, breaks=[2.0])
    assert sol.success
    ax.plot(
        sol.t, sol.y[:, 0], label=f"{name}, error at the end {abs(sol.y[-1, 2] - sol.y[-1, 0]):.1e}"
    )
ax.plot(sol.t, sol.y[:, 2], "--", color="0.5", label="reference")
ax.set(xlabel="$t$", ylabel="plant")
ax.legend()
plt.show()
