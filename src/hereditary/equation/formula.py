"""The formula of an equation in HTML, for notebooks."""

from __future__ import annotations

import html
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .delay import Delay
from .operators import Term

# Largest number of characters of a kernel's description; the name of its class replaces a longer
# one.
_MAX_KERNEL_CHARACTERS = 60


def formula(equation: Any) -> str:
    """Return the equation's two sides and initial values as a line of HTML."""
    left = " + ".join(_term(term) for term in equation.terms)
    arguments = ["t", "y", *["memory"] * bool(equation.memory)]
    right = [] if equation.rhs is None else [f"{_name(equation.rhs)}({', '.join(arguments)})"]
    right = ["A y"] * (equation.linear is not None) + right
    read = ""
    if equation.memory:
        read = f", memory: {', '.join(_read(part) for part in equation.memory)}"
    d = equation.system.n_y
    about = f"{d} components" if d > 1 else "one component"
    about += ", complex" * equation.system.frame.paired
    line = f"{left.replace('+ -', '&minus; ')} = {' + '.join(right)}"
    return f"<p><i>{line}</i>{read}</p><p>{about}, from t = {equation.t_start:g} on</p>"


def _name(function: object, otherwise: str = "f") -> str:
    name = getattr(function, "__name__", type(function).__name__).lstrip("_")
    return otherwise if name in ("<lambda>", "") else html.escape(name)


def _read(part: Term | Delay) -> str:
    if not isinstance(part, Delay):
        return _term(part)
    tau = f"{_name(part.tau, 'tau')}(t)" if callable(part.tau) else f"{part.tau:g}"
    return f"y(t &minus; {tau})"


def _term(term: Term) -> str:
    factor = _number(term.coefficient)
    operator = term.operator
    order = getattr(operator, "order", None)
    if order is None:  # a general kernel
        kernel, primes = repr(operator.kernel), "&prime;" * operator.derivative
        if len(kernel) > _MAX_KERNEL_CHARACTERS or " at 0x" in kernel:
            kernel = type(operator.kernel).__name__
        return f"{factor}&int; {html.escape(kernel)} y{primes}"
    power = _name(order, "alpha") + "(t)" if callable(order) else _plain(order)
    return f"{factor}D{operator.definition.mark}<sup>{power}</sup> y"


def _number(coefficient: np.ndarray) -> str:
    """Return a coefficient as text: empty for 1, and only the shape of a matrix."""
    if coefficient.ndim == 2:
        return f"[{coefficient.shape[0]} x {coefficient.shape[1]} matrix] "
    return "" if np.all(coefficient == 1) else f"{_plain(coefficient)} "


def _plain(values: ArrayLike) -> str:
    """Return values as text: one number if all are equal, otherwise the first four."""
    values = np.unique(values) if np.ptp(values) == 0 else np.ravel(values)
    shown = [f"{value:g}" for value in values[:4]] + ["..."] * (values.size > 4)
    return shown[0] if len(shown) == 1 else f"({', '.join(shown)})"
