"""Schemes, one file each, and what a scheme of your own needs (docs/extending.md)."""

from ..equation.system import System
from ..support.checks import within
from .scheme import Plan, Scheme, check_smoothness
from .uniform_plan import uniform_plan
from .weights import weighed

__all__ = [
    "Plan",
    "Scheme",
    "System",
    "check_smoothness",
    "uniform_plan",
    "weighed",
    "within",
]
