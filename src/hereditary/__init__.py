"""hereditary: equations with memory, solved to high order in memory that does not grow.

State an equation with `Equation`, its terms with `Caputo`, `RiemannLiouville` and `Memory`, and
delays with `Delay`. `solve` solves it to a tolerance (``rtol=``) or with given steps
(``n_steps=``). `scenes` has ready-made models and `plots` draws results.

>>> import hereditary as hd
>>> eq = hd.Equation(hd.Caputo(1.8) + 0.25 * hd.Caputo(0.8), lambda t, x: -x, y0=[1.0, 0.0])
>>> sol = hd.solve(eq, 20.0, rtol=1e-8)
>>> sol.success, sol(10.0).round(6)
(True, array([-0.040128]))

Many runs: `ensemble`, `sweep`. Data: `fit`, `sensitivities`, `derivative`. Analysis: `lyapunov`,
`zero_one_test`, `power_spectrum`, `frequency_response`. ``help(hereditary.solve)`` and the like
have the arguments, and the folder ``docs`` of the repository has guides.
"""

import importlib
import importlib.metadata

from . import scenes, viscoelastic
from .analysis.convergence import ConvergenceTable, convergence_table
from .analysis.fitting import FitResult, fit
from .analysis.frequency_response import FrequencyResponse, frequency_response
from .analysis.growth import LyapunovResult
from .analysis.lyapunov import lyapunov
from .analysis.power_spectrum import PowerSpectrum, power_spectrum
from .analysis.sections import Section, maxima, stroboscopic
from .analysis.sensitivity import Sensitivities, sensitivities
from .analysis.sweep import sweep
from .analysis.table import Table
from .analysis.zero_one import ZeroOneResult, zero_one_test
from .collocation.method import Collocation
from .derivative import derivative
from .ensemble import Ensemble, ensemble
from .equation.delay import Delay
from .equation.equation import Equation
from .equation.operators import Caputo, Memory, RiemannLiouville
from .functions.python_calls import PythonFunctionWarning
from .given.history.direct import Direct
from .given.history.exponentials import SumOfExponentials
from .given.history.fft import FFT
from .given.schemes.adams import Adams, ProductTrapezoid
from .given.schemes.bdf import BDF
from .given.schemes.explicit import ExplicitCaputo
from .given.schemes.grunwald_letnikov import GrunwaldLetnikov
from .given.schemes.imex import IMEX
from .given.schemes.l1 import L1
from .given.schemes.l2 import L2
from .given.schemes.l2sigma import L2Sigma
from .given.schemes.l12 import L12
from .given.steps import Graded, graded
from .ivp import solve_ivp
from .kernels.by_values import Kernel, TabulatedKernel
from .kernels.laplace import kernel_from_laplace
from .kernels.memory_kernel import (
    ExponentialSum,
    KernelWarning,
    MemoryKernel,
    Prony,
    fit_exponentials,
)
from .kernels.named_kernels import (
    DistributedOrder,
    GammaDensity,
    LognormalDensity,
    MittagLeffler,
    PowerLaw,
    StretchedExponential,
    TemperedPowerLaw,
    WeibullDensity,
)
from .memory_term import MemoryTerm, memory_term
from .solver.accuracy import Accuracy
from .solver.solution import Solution
from .solver.solve import solve
from .stepping.status import SolveWarning, StabilityWarning, Status
from .support.covariance import Estimates, IdentifiabilityWarning

__version__ = importlib.metadata.version("hereditary")

__all__ = [
    "BDF", "FFT", "IMEX", "L1", "L2", "L12", "Accuracy", "Adams", "Caputo", "Collocation",
    "ConvergenceTable", "Delay", "Direct", "DistributedOrder", "Ensemble", "Equation", "Estimates",
    "ExplicitCaputo", "ExponentialSum", "FitResult", "FrequencyResponse", "GammaDensity", "Graded",
    "GrunwaldLetnikov", "IdentifiabilityWarning", "Kernel", "KernelWarning", "L2Sigma",
    "LognormalDensity", "LyapunovResult", "Memory", "MemoryKernel", "MemoryTerm", "MittagLeffler",
    "PowerLaw", "PowerSpectrum", "ProductTrapezoid", "Prony", "PythonFunctionWarning", "Regime",
    "RegimeVerdict", "RiemannLiouville", "Section", "Sensitivities", "Solution", "SolveWarning",
    "StabilityWarning", "Status", "StretchedExponential", "SumOfExponentials", "Table",
    "TabulatedKernel", "TemperedPowerLaw", "WeibullDensity", "ZeroOneResult", "classify",
    "convergence_table", "derivative", "ensemble", "exact", "fit", "fit_exponentials",
    "frequency_response", "graded", "kernel_from_laplace", "lyapunov", "maxima", "memory_term",
    "plots", "power_spectrum", "scenes", "sensitivities", "solve", "solve_ivp", "stroboscopic",
    "sweep", "viscoelastic", "zero_one_test",
]  # fmt: skip


def __getattr__(name: str) -> object:
    # plots needs matplotlib, whose import takes as long as all the rest; exact needs an extra
    if name in ("plots", "exact"):
        return importlib.import_module(f".{name}", __name__)
    if name in ("Regime", "RegimeVerdict", "classify"):
        return getattr(importlib.import_module(".paper.regimes", __name__), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return [*__all__, "__doc__", "__version__"]
