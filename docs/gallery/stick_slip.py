"""
Stick-slip with memory, and its exponents
=========================================

A spring pulls a load over a chain of wells. The load sticks in a well, slips over the next
barriers, and sticks again. Inertia and friction have memory: ``D^1.8 x + 0.25 D^0.8 x + x = t + 50
sum_n a_n sin(n x)``.
"""

import matplotlib.pyplot as plt
import numpy as np

import hereditary as hd

equation = hd.scenes.stick_slip()  # beta 1.8, gamma 0.8, speed 1, adhesion 50
orbit = hd.solve(equation, 100.0, rtol=1e-8)

fig, (left, right) = plt.subplots(1, 2, figsize=(8, 4.4), layout="constrained")
hd.plots.oscillogram(orbit, left)
hd.plots.phase_portrait(orbit, right)

first, second = hd.scenes.sticking_intervals(orbit)
print("sticks at first and at last for", *(round(end - begin, 2) for begin, end in (first, second)))
assert second[0] - first[1] < 5  # the time of the slip
assert min(first[1] - first[0], second[1] - second[0]) > 40

# %%
# Is it chaotic? The largest Lyapunov exponent, with the full memory, is negative here and
# proportional to 1 / T. So it measures the length of the run and is not a rate. The verdict says
# this.

exponents = hd.lyapunov(equation, 400.0, n_steps=64_000)
print(exponents.exponents.round(3), exponents.verdict)
assert exponents.verdict == "neutral"
quarter = np.interp(100.0, exponents.times, exponents.trace[:, 0])
assert 3 < quarter / exponents.exponents[0] < 5

fig, ax = plt.subplots(figsize=(7, 3.5), layout="constrained")
ax.plot(exponents.times, exponents.trace[:, 0])
ax.axhline(0, color="0.6", lw=0.8)
ax.set(xlabel="T", ylabel="largest exponent up to T")
plt.show()
