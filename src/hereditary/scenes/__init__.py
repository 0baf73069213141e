"""Scenes: named parameter sets, each returning an `Equation`."""

from .chaotic import lorenz, rabinovich_fabrikant, rossler
from .linear import oscillator, relaxation
from .oscillating import brusselator, duffing, van_der_pol, van_der_pol_airy
from .stick_slip import PRINTED_WELL, stick_slip, sticking_intervals, well_coefficients

__all__ = [
    "PRINTED_WELL",
    "brusselator",
    "duffing",
    "lorenz",
    "oscillator",
    "rabinovich_fabrikant",
    "relaxation",
    "rossler",
    "stick_slip",
    "sticking_intervals",
    "van_der_pol",
    "van_der_pol_airy",
    "well_coefficients",
]
