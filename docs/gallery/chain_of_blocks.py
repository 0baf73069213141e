"""
A chain of stick-slip blocks
============================

Springs couple fifty blocks, which are pulled at one speed. The wells of each block have a different
strength. This is a model of a fault. Many slips are small; the largest runs through the chain.
"""

import matplotlib.pyplot as plt
import numpy as np

import hereditary as hd

strengths = np.random.default_rng(1).uniform(20, 100, 50)
chain = hd.scenes.stick_slip_chain(50, adhesion=strengths)
sol = hd.solve(chain, 100.0, rtol=1e-6, t_eval=np.linspace(0.0, 100.0, 1001))
assert sol.success

slips = hd.scenes.slips(sol)
fig, (left, right) = plt.subplots(1, 2, figsize=(8, 4.4), layout="constrained")
image = left.pcolormesh(sol.t, np.arange(50), (sol.y - sol.t[:, None]).T, rasterized=True)
left.set(xlabel="$t$", ylabel="block", title="place less the mean pull")
fig.colorbar(image, ax=left)
sizes = np.sort(slips.size)[::-1]
right.loglog(sizes, np.arange(1, sizes.size + 1), ".")
right.set(xlabel="size of a slip", ylabel="slips of this size or larger")
plt.show()

largest = slips.size.argmax()
print(f"{sizes.size} slips, their median {np.median(sizes):.2g}, the largest {sizes[0]:.4g}")
assert slips.first[largest] == 0
assert slips.last[largest] == 49
assert np.median(sizes) < 0.001 * sizes[0]
