"""Schemes, one file each, and what a scheme of your own needs (docs/extending.md)."""

from ..equation.system import System
from ..support.checks import within
from .derivative_form import derivative_plan
from .scheme import Plan, Scheme, check_smoothness
from .weights import weighed

__all__ = [
    "Plan",
    "Scheme",
    "System",
    "check_smoothness",
    "derivative_plan",
    "weighed",
    "within",
]
