"""
A memory kernel from measured data
==================================

Relaxation data of a polymer, a table of times and values, become a memory kernel: a sum of
exponentials with positive weights, as close as the data are.
"""

import matplotlib.pyplot as plt
import numpy as np

import hereditary as hd

t = np.geomspace(1e-3, 1e2, 60)
noise = np.random.default_rng(7).normal(1.0, 0.01, t.size)
measured = hd.MittagLeffler(0.6, 2.0)(t) * noise  # stands for an instrument's table

kernel = hd.TabulatedKernel(t, measured)
fit = hd.fit_exponentials(kernel, 1e-3, 1e2, 0.01)
print(fit.n_modes, "exponentials, the largest relative misfit", round(fit.max_error, 3))

# %%
# An oscillator whose friction remembers by that kernel, beside one with the kernel behind the
# data.


def spring(t, x):
    return -4.0 * x


def oscillator(kernel):
    terms = hd.Caputo(2) + 1.5 * hd.Memory(kernel, 1)
    return hd.Equation(terms, spring, [1.0, 0.0])


by_data, by_law = (
    hd.solve(oscillator(kernel), 10.0, 4000) for kernel in (fit, hd.MittagLeffler(0.6, 2.0))
)
fig, (left, right) = plt.subplots(1, 2, figsize=(10, 4), layout="constrained")
left.loglog(t, measured, ".", label="data")
left.loglog(t, fit(t), label=f"{fit.n_modes} exponentials")
left.set(xlabel="$t$", ylabel="$K$")
left.legend()
right.plot(by_law.t, by_law.y[:, 0], label="law")
right.plot(by_data.t, by_data.y[:, 0], "--", label="data")
right.set(xlabel="$t$", ylabel="$x$")
right.legend()
plt.show()
print("largest difference of the motions:", np.abs(by_data.y - by_law.y).max())
assert np.abs(by_data.y - by_law.y).max() < 0.02
