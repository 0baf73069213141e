"""A user's script with types: ``mypy --strict`` on it holds what py.typed promises."""

import numpy as np
from numpy.typing import NDArray

import hereditary as hd

Array = NDArray[np.float64]


def rhs(t: float, x: Array, params: Array) -> Array:
    """Return the force of a spring and a drive."""
    return np.asarray(params[0] * np.cos(t) - x)


def steps(alpha: float, n_steps: int) -> hd.Solution:
    """Solve an oscillator with memory on given steps."""
    terms = hd.Caputo(1.8) + 0.25 * hd.Caputo(alpha)
    equation = hd.Equation(terms, rhs, y0=[0.0, 1.0], params=[0.5])
    return hd.solve(equation, 10.0, n_steps, scheme=hd.BDF(2), history=hd.FFT())


def last(solution: hd.Solution) -> float:
    """Return the last value of the first component."""
    values: Array = solution.y
    return float(values[-1, 0])


def spectrum(alphas: list[float]) -> hd.Table:
    """Sweep over the order of friction."""
    return hd.sweep(lambda alpha: last(steps(alpha, 200)), {"alpha": alphas}, progress=False)


if __name__ == "__main__":
    table = spectrum([0.5, 0.9])
    ends: Array = table["value"]
    growth: hd.LyapunovResult = hd.lyapunov(hd.scenes.lorenz(), 20.0, 2_000)
    response: hd.FrequencyResponse = hd.frequency_response(
        hd.scenes.duffing(1.9, 0.9, 0.3, stiffness=1.0), np.linspace(0.5, 1.5, 5), frequency=3
    )
    print(ends, growth.verdict, response.amplitude.shape)
