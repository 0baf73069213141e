"""Scenes: named parameter sets, each returning an `Equation`."""

from .block_chain import Slips, slips, stick_slip_chain
from .chaotic import lorenz, rabinovich_fabrikant, rossler
from .diffusion import subdiffusion
from .linear import oscillator, relaxation
from .oscillating import brusselator, duffing, van_der_pol, van_der_pol_airy
from .stick_slip import PRINTED_WELL, stick_slip, sticking_intervals, well_coefficients

__all__ = [
    "PRINTED_WELL",
    "Slips",
    "brusselator",
    "duffing",
    "lorenz",
    "oscillator",
    "rabinovich_fabrikant",
    "relaxation",
    "rossler",
    "slips",
    "stick_slip",
    "stick_slip_chain",
    "sticking_intervals",
    "subdiffusion",
    "van_der_pol",
    "van_der_pol_airy",
    "well_coefficients",
]
