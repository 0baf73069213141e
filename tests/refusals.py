"""What rows of refusals share.

A row is a call, the words of the message, and the exception if that is no ValueError.
"""

from functools import cache, partial

import numpy as np

import hereditary as hd

BAD = TypeError, ValueError


def each(call, values, words, error=ValueError):
    """Return a row for each value, on which `call` is refused in the same words."""
    return [(partial(call, value), words, error) for value in values]


def decay(t, y):
    return -y


def faded(t, y, p):
    return -p[0] * y


def read(t, y, memory):
    return -y - memory[0]


def equation(order=0.5, y0=1.0, rhs=decay, **given):
    """Return an equation with the derivative of this order, or these terms."""
    terms = hd.Caputo(order) if isinstance(order, int | float) or callable(order) else order
    return hd.Equation(terms, rhs, y0, **given)


def run(**change):
    return hd.solve(**{"equation": hd.scenes.relaxation(), "t_end": 1.0, "n_steps": 10} | change)


def adapt(**change):
    """Run with steps that adapt."""
    return run(**{"n_steps": None, "rtol": 1e-6} | change)


@cache
def begun():
    return run().state


@cache
def adapted():
    return adapt(rtol=1e-8).state


def linear():
    return hd.Equation(hd.Caputo(0.7), faded, 1.0, params=[1.0])


MASKED = np.ma.array([0.5, 1.0], mask=[False, True])
PRONY = hd.Prony([1.0], [1.0])
