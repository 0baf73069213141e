"""Schemes, one file each, and what a scheme of your own needs (docs/extending.md)."""

from .equation.system import System
from .given.plan import Plan
from .given.uniform_plan import uniform_plan
from .given.weights import weighed
from .stepping.scheme import Scheme, check_smoothness
from .support.checks import within

__all__ = ["Plan", "Scheme", "System", "check_smoothness", "uniform_plan", "weighed", "within"]
