"""
A memory kernel from measured data
==================================

Relaxation data of a polymer, a table of times and values, become a memory kernel. It is a sum of
exponentials with positive weights, as accurate as the data.
"""

import matplotlib.pyplot as plt
import numpy as np

import hereditary as hd

t = np.geomspace(1e-3, 1e2, 60)
law = hd.MittagLeffler(0.6, 2.0)
measured = law(t) * np.random.default_rng(7).normal(1.0, 0.01, t.size)  # an instrument's table

fit = hd.fit_exponentials(hd.TabulatedKernel(t, measured), 1e-3, 1e2, 0.01)
print(fit.n_modes, "exponentials, the largest relative misfit", round(fit.max_error, 3))
assert np.min(fit.weights) > 0
assert fit.max_error < 0.05
assert np.abs(fit(t) / law(t) - 1).max() < 0.03

# %%
# The friction of one oscillator has this kernel, the friction of the other the kernel that made the
# data.


def spring(t, x):
    return -4.0 * x


def oscillator(kernel):
    terms = hd.Caputo(2) + 1.5 * hd.Memory(kernel, 1)
    return hd.Equation(terms, spring, [1.0, 0.0])


by_data, by_law = (hd.solve(oscillator(kernel), 10.0, rtol=1e-6) for kernel in (fit, law))
fig, (left, right) = plt.subplots(1, 2, figsize=(8, 4.4), layout="constrained")
left.loglog(t, measured, ".", label="data")
left.loglog(t, fit(t), label=f"{fit.n_modes} exponentials")
left.set(xlabel="$t$", ylabel="$K$")
left.legend()
hd.plots.oscillogram(by_law, right, label="law", lw=1.5)
hd.plots.oscillogram(by_data, right, label="data", ls="--", lw=1.5)
right.set(title="")
plt.show()
difference = np.abs(by_data.y - by_law(by_data.t)).max()
print(f"largest difference of the motions: {difference:.1g}")
assert difference < 0.02
