"""
Convergence of your own scheme
==============================

A scheme is one small class. Histories, events, resuming, tangents and tables of convergence then
work without further code.
"""

from dataclasses import dataclass
from functools import partial
from typing import ClassVar

import matplotlib.pyplot as plt
import numpy as np

import hereditary as hd
from hereditary.schemes import Scheme, check_smoothness, uniform_plan, weighed

# %%
# The solution is a line on each step, and the equation holds at t_n + theta h. L1 is theta = 1.


@dataclass(frozen=True)
class Lines(Scheme):
    """Lines on each step, the equation at t_n + theta h."""

    theta: float = 0.75
    solve: ClassVar[str] = "newton"
    orders = 0.0, 1.0

    def order(self, alpha: float, smoothness: str = "smooth") -> float:
        """Order of convergence at a fixed time."""
        check_smoothness(smoothness)
        return 2 - alpha if smoothness == "smooth" else 1.0

    def plan(self, equation, h):
        """Tables and convolution for an equation with step h."""
        terms = partial(weighed, h=h, theta=self.theta)
        return uniform_plan(equation, h, self.theta, terms)


# %%
# The test is ``D^0.6 y = -y``, whose exact solution is a Mittag-Leffler function. It starts like
# t^0.6, so the order at the end is 1 for both schemes, and only the constant differs.

equation = hd.scenes.relaxation(0.6)
exact = hd.exact.relaxation(0.6)
fig, ax = plt.subplots(figsize=(6, 4), layout="constrained")
last = []
for scheme in (Lines(0.75), hd.L1(), hd.BDF(2)):
    counts = [100, 200, 400, 800, 1600]
    ends = [hd.solve(equation, 2.0, n, scheme=scheme).y[-1, 0] for n in counts]
    errors = np.abs(np.array(ends) - exact(2.0)[0])
    order = np.log2(errors[-2] / errors[-1])
    last.append((order, errors[-1]))
    ax.loglog(counts, errors, "o-", label=f"{scheme!r}, order {order:.2f}")
ax.set(xlabel="steps", ylabel="error at t = 2")
ax.legend()
plt.show()
(own, error), (l1, error_of_l1), (bdf, _) = last
assert np.allclose([own, l1, bdf], [1.0, 1.0, 2.0], rtol=0, atol=0.05)
assert 0.45 < error / error_of_l1 < 0.55

# %%
# Papers print the table of the largest error at all times. The steps next to the singular start
# determine this error.

table = hd.convergence_table(equation, 2.0, [100, 200, 400], scheme=Lines(), exact=exact)
print(table.to_markdown())
assert abs(table.slope - 0.6) < 0.1
