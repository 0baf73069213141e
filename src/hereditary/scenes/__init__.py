"""Scenes (floor 6): named parameter sets, each returning an `Equation`."""

from .linear import oscillator, relaxation
from .stick_slip import PRINTED_WELL, stick_slip, sticking_intervals, well_coefficients

__all__ = [
    "PRINTED_WELL",
    "oscillator",
    "relaxation",
    "stick_slip",
    "sticking_intervals",
    "well_coefficients",
]
