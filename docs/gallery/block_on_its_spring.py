r"""
A block on its spring, moving
=============================

A block rests in a row of wells, and a spring pulls it at a constant speed. Without memory its slips
are irregular. With memory of inertia and friction they repeat.

.. math:: D^\beta x + 0.25\, D^\gamma x + x = t + 8 \sum_n a_n \sin n x
"""

import matplotlib.pyplot as plt
import numpy as np
from PIL import Image

import hereditary as hd
from hereditary.scenes.stick_slip import PRINTED_WELL

T_END, FRAMES, FINE = 62.0, 120, 30
ORDERS = {"without memory, orders 2 and 1": (2, 1), "with memory, 1.8 and 0.8": (1.8, 0.8)}

t = np.linspace(0.0, T_END, FINE * FRAMES + 1)
orbits = []
for beta, gamma in ORDERS.values():
    block = hd.scenes.stick_slip(beta=beta, gamma=gamma, adhesion=8.0)
    sol = hd.solve(block, T_END, rtol=1e-8)
    orbits.append((sol(t)[:, 0], sol(t, 1)[:, 0]))

# %%
# The picture moves with the pull. The hills are the potential of the wells.

LENGTH = 7.0  # of the spring at rest, in the picture
s = np.linspace(-8.0, 8.0, 400)
coil = np.linspace(0.0, 1.0, 27)
zigzag = 0.12 * (-1.0) ** np.arange(27) * ((coil > 0.1) & (coil < 0.9))


def hills(x):
    """Return the potential at places x (n,), scaled for the picture."""
    n = np.arange(1, 8)
    return 0.25 * np.cos(np.outer(x, n)) @ (PRINTED_WELL / n)


plt.style.use(hd.plots.STYLE)
fig, axes = plt.subplots(2, 2, figsize=(8, 4.4), dpi=80, layout="constrained", facecolor="white")
artists = []
for (left, right), title, color in zip(axes, ORDERS, ("C1", "C0"), strict=True):
    (ground,) = left.plot([], [], color="0.5")
    (spring,) = left.plot([], [], color="0.5", lw=1)
    (mass,) = left.plot([], [], "s", color=color, ms=13)
    left.plot(LENGTH, 0.9, ">", color="0.5", ms=9)
    left.set(xlim=(-7.6, 7.6), ylim=(-0.6, 1.2), xticks=[], yticks=[], title=title)
    (trace,) = right.plot([], [], color=color, lw=1)
    (point,) = right.plot([], [], "o", color=color, ms=6)
    right.set(xlim=(-7.6, 4.2), ylim=(-4.5, 7.0), ylabel="velocity")
    artists.append((ground, spring, mass, trace, point))
axes[1, 1].set(xlabel="lead over the pull")


def draw(k):
    """Move blocks, springs and hills to time t[k]."""
    for (x, v), (ground, spring, mass, trace, point) in zip(orbits, artists, strict=True):
        lead = x - t
        top = hills(x[k])[0] + 0.18
        ground.set_data(s, hills(s + t[k]))
        spring.set_data(lead[k] + (LENGTH - lead[k]) * coil, top + (0.9 - top) * coil + zigzag)
        mass.set_data([lead[k]], [top])
        trace.set_data(lead[: k + 1], v[: k + 1])
        point.set_data([lead[k]], [v[k]])
    fig.canvas.draw()


frames = []
for frame in range(FRAMES + 1):
    draw(FINE * frame)
    fig.set_layout_engine("none")  # places stay as in the first frame
    frames.append(Image.fromarray(np.asarray(fig.canvas.buffer_rgba())).convert("RGB"))
palette = frames[-1].quantize(16)
first, *others = (frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames)
first.save("block_on_its_spring.gif", append_images=others, duration=70, loop=0)

# %%
# .. image:: /made/scripts/block_on_its_spring.gif
#    :alt: A block on its spring beside its phase portrait, without memory and with memory
#
# With memory the slips have the period 4 pi of two wells. Without memory they have no such period.

late = np.linspace(25.0, T_END - 4 * np.pi, 200)
without, with_memory = (
    np.ptp(np.interp(late + 4 * np.pi, t, x) - np.interp(late, t, x)) for x, _ in orbits
)
print(f"change from one period to the next: {without:.2f} without, {with_memory:.2f} with memory")
assert with_memory < 0.1 * without
