"""What tests of runs share: runs that complete, runs that warn, errors, and events."""

import numpy as np
import pytest

import hereditary as hd


def completed(equation, t_end, n_steps=None, **how):
    sol = hd.solve(equation, t_end, n_steps, **how)
    assert sol.success, sol.message
    return sol


def warned(words, equation, t_end, n_steps=None, **how):
    """Return the run, which warns in these words."""
    with pytest.warns(hd.SolveWarning, match=words):
        return hd.solve(equation, t_end, n_steps, **how)


def errors_of(quantity, exact, counts, equation, t_end, **how):
    """Return the largest error of a quantity of runs in these numbers of steps."""
    runs = [hd.solve(equation, t_end, n, **how) for n in counts]
    return [np.abs(quantity(sol) - exact).max() for sol in runs]


def at_end(sol):
    return sol.y[-1]


def event(function, **attributes):
    """Return a new event function with these attributes."""

    def zero(t, y):
        return function(t, y)

    for name, value in attributes.items():
        setattr(zero, name, value)
    return zero
