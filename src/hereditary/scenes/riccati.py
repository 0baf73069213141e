"""The fractional Riccati equation, real or complex."""

import numpy as np

from ..compiled.jit import compiled
from ..equation.equation import Equation
from ..equation.operators import Caputo
from ..support.checks import real, refuse, within


@compiled
def _quadratic(t: float, y: np.ndarray, dy: np.ndarray, params: np.ndarray) -> None:
    # params: constant, linear, quadratic
    dy[0] = params[0] + (params[1] + params[2] * y[0]) * y[0]


@compiled
def _quadratic_jacobian(t: float, y: np.ndarray, jacobian: np.ndarray, params: np.ndarray) -> None:
    jacobian[0, 0] = params[1] + 2.0 * params[2] * y[0]


@compiled
def _complex_quadratic(t: float, y: np.ndarray, dy: np.ndarray, params: np.ndarray) -> None:
    # params: real and imaginary parts of constant, linear, quadratic
    constant, linear = complex(params[0], params[1]), complex(params[2], params[3])
    dy[0] = constant + (linear + complex(params[4], params[5]) * y[0]) * y[0]


def riccati(
    alpha: float = 0.9,
    constant: complex = 1.0,
    linear: complex = 2.0,
    quadratic: complex = -1.0,
    y0: complex = 0.0,
) -> Equation:
    """Make the fractional Riccati equation, ``D^alpha y = constant + linear y + quadratic y**2``.

    It describes growth with saturation. With complex coefficients it gives the characteristic
    function of a rough Heston model of volatility.

    Parameters
    ----------
    alpha : float
        Order, 0 < alpha <= 1 [-].
    constant, linear, quadratic : float or complex
        Coefficients [unit of y / time**alpha, ...].
    y0 : float or complex
        y(0).

    Returns
    -------
    Equation
        Complex if a coefficient or y0 is complex.

    Notes
    -----
    With y(0) = 0, near 0 ``y = sum_k c_k t**(k alpha)``, ``c_(k+1) = Gamma(k alpha + 1) / Gamma((k
    + 1) alpha + 1) (constant [k = 0] + linear c_k + quadratic sum_i c_i c_(k-i))``. At late times
    y tends to a root of the quadratic like t**-alpha, if it does not blow up.

    Source
    ------
    [TverdyiParovik2022]; complex [ElEuchRosenbaum2019].

    Examples
    --------
    >>> import hereditary as hd
    >>> sol = hd.solve(hd.scenes.riccati(alpha=1.0), 1.0, rtol=1e-10)
    >>> round(float(sol.y[-1, 0]), 8)  # 1 + sqrt(2) tanh(sqrt(2) - artanh(1 / sqrt(2)))
    1.68949839
    """
    within("alpha", alpha, 5e-324, 1.0, "(0, 1]")
    named = {"constant": constant, "linear": linear, "quadratic": quadratic, "y0": y0}
    if not any(np.iscomplexobj(value) for value in named.values()):
        *params, start = (real(name, value) for name, value in named.items())
        return Equation(Caputo(alpha), _quadratic, start, params, _quadratic_jacobian)
    numbers = []
    for name, value in named.items():
        number = np.asarray(value)
        if number.ndim or number.dtype.kind not in "iufc" or not np.isfinite(number):
            refuse(name, "be a finite number, real or complex", repr(value))
        numbers.append(complex(number))
    params = [part for number in numbers[:3] for part in (number.real, number.imag)]
    return Equation(Caputo(alpha), _complex_quadratic, numbers[3], params)
