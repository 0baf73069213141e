"""Scenes: named parameter sets, each returning an `Equation`."""

from .block_chain import Slips, slips, stick_slip_chain
from .chaotic import lorenz, rabinovich_fabrikant, rossler
from .diffusion import subdiffusion
from .linear import oscillator, relaxation
from .oscillating import brusselator, duffing, selkov, van_der_pol
from .parametric import mathieu
from .riccati import riccati
from .self_excited import fitzhugh_nagumo, van_der_pol_airy, van_der_pol_duffing
from .stick_slip import PRINTED_WELL, stick_slip, sticking_intervals, well_coefficients

__all__ = [
    "PRINTED_WELL", "Slips", "brusselator", "duffing", "fitzhugh_nagumo", "lorenz", "mathieu",
    "oscillator", "rabinovich_fabrikant", "relaxation", "riccati", "rossler", "selkov", "slips",
    "stick_slip", "stick_slip_chain", "sticking_intervals", "subdiffusion", "van_der_pol",
    "van_der_pol_airy", "van_der_pol_duffing", "well_coefficients",
]  # fmt: skip


def __dir__() -> list[str]:
    return __all__
