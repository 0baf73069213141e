"""Systems of order 1 and below: their orders and initial values in one wording."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..equation.equation import Equation
from ..equation.operators import Caputo
from ..support.checks import real_array, refuse


def coupled(
    d: int, alpha: Any, rhs: Callable, y0: ArrayLike, params: ArrayLike, jac: Callable
) -> Equation:
    """Make ``D^alpha y = rhs`` with d components and one alpha or one for each of them."""
    orders = real_array("alpha", alpha)
    if orders.shape not in ((), (d,)):
        required = f"be one number or one for each of the {d} components"
        refuse("alpha", required, f"shape {orders.shape}")
    if np.any(orders <= 0) or np.any(orders > 1):
        remedy = "orders above 1 need y'(0) too, write an Equation for them"
        refuse("alpha", "lie in (0, 1]", orders.tolist(), remedy)
    start = real_array("y0", y0)
    if start.shape != (d,):
        refuse("y0", f"hold one number for each of the {d} components", f"shape {start.shape}")
    return Equation(Caputo(orders), rhs, start, params=params, jac=jac)
