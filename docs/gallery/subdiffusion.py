"""
Subdiffusion on a square
========================

The equation is ``D^alpha u = Laplace u`` on the unit square, with u = 0 on the boundary. The method
of lines has 2,500 components, and the matrix is factorised once.
"""

import matplotlib.colors
import matplotlib.pyplot as plt
import numpy as np

import hereditary as hd

POINTS = 50
x = np.arange(1, POINTS + 1) / (POINTS + 1)
spot = np.exp(-200 * ((x[:, None] - 0.35) ** 2 + (x[None, :] - 0.6) ** 2))

top = spot.argmax()
heights, areas, steepness = {}, {}, {}
fig, axes = plt.subplots(2, 3, figsize=(9, 5.6), layout="compressed", sharex=True, sharey=True)
colours = {"norm": matplotlib.colors.LogNorm(1e-3, 1.0), "cmap": "magma"}
square = {"origin": "lower", "extent": (0, 1, 0, 1)}
for row, alpha in zip(axes, (0.5, 1.0), strict=True):
    equation = hd.scenes.subdiffusion(alpha, POINTS, dimensions=2, u0=spot)
    sol = hd.solve(equation, 0.02, 200, scheme=hd.BDF(2), save_every=10)
    assert sol.success
    heights[alpha] = sol.y.max(axis=1)
    steepness[alpha] = 1 - sol.y[:, top + POINTS] / sol.y[:, top]  # drop to the next point
    areas[alpha] = np.mean(sol.y > heights[alpha][:, None] / 2, axis=1)
    for ax, k in zip(row, (0, 5, 20), strict=True):
        u = np.maximum(sol.y[k].reshape(POINTS, POINTS).T, 1e-9)  # a logarithm needs u > 0
        image = ax.imshow(u, **square, **colours)
        ax.set(title=rf"$\alpha$ = {alpha}, t = {sol.t[k]:g}")
        ax.label_outer()
for ax in axes[-1]:
    ax.set(xlabel="x")
for ax in axes[:, 0]:
    ax.set(ylabel="y")
fig.colorbar(image, ax=axes, extend="min", label="u")
plt.show()

# %%
# With memory the spot spreads at once and then very slowly. It keeps a cusp, and its height decays
# nearly like t^-1/2. The lowest mode has a closed form, with which the run agrees.

first, early, late = 1, 5, 20  # t = 0.001, 0.005, 0.02
assert areas[0.5][first] > 2 * areas[1.0][first]  # of the part above half of the height
assert areas[0.5][late] < 1.2 * areas[0.5][early]
assert areas[1.0][late] > 3 * areas[1.0][early]
assert steepness[0.5][late] > 0.8 * steepness[0.5][early]
assert steepness[1.0][late] < 0.4 * steepness[1.0][early]
power = np.log(heights[0.5][late] / heights[0.5][early]) / np.log(late / early)
print("the height falls like t to the power", round(power, 2))
assert -0.5 < power < -0.42

mode = hd.scenes.subdiffusion(0.5, POINTS, dimensions=2)
found = hd.solve(mode, 0.02, 200, scheme=hd.BDF(2)).y[-1]
rate = 2 * (2 * (POINTS + 1) * np.sin(np.pi / (2 * POINTS + 2))) ** 2
exact = hd.exact.mittag_leffler(-rate * 0.02**0.5, 0.5, 1.0) * mode.y0[0]
print(f"largest error of the lowest mode: {np.abs(found - exact).max():.1e}")
assert np.abs(found - exact).max() < 1e-5
