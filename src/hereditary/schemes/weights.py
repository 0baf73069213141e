"""Weight rules: what schemes weigh increments with on a uniform mesh (floor 2).

All of them are moments of the kernel ``p t**(p-1)``, 0 <= p < 1, over intervals of one step (t in
units of the step). As p tends to 0 the kernel becomes a point mass at 0: no memory.
"""

import numpy as np

from ..special import mean_exponential, power_differences, power_second_differences
from .scheme import WeightRule


def _exponent(p):
    """The kernel ``t**(p-1)`` is ``t**-a`` with a = 1 - p."""
    return 1 - p if p > 0 else None


def _modal(p, rates, weights, k):
    """Shares of ``b_k = p int_k^(k+1) t**(p-1) dt``."""
    return p * weights * mean_exponential(rates) * np.exp(-rates * k)


def _modal_differences(p, rates, weights, k):
    """Shares of ``b_k - b_(k-1)``."""
    return _modal(p, rates, weights, k - 1) * np.expm1(-rates)


# b_k = (k+1)**p - k**p
FIRST_DIFFERENCES = WeightRule(power_differences, _exponent, _modal)
# b_k - b_(k-1), and b_0 for k = 0
SECOND_DIFFERENCES = WeightRule(power_second_differences, _exponent, _modal_differences)
