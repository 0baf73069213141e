"""An equation as a formula in HTML, for notebooks."""

import html

import numpy as np


def formula(equation) -> str:
    """Return the equation's two sides and initial values as a line of HTML."""
    left = " + ".join(_term(term) for term in equation.terms)
    arguments = ["t", "y", *["memory"] * bool(equation.memory)]
    right = [] if equation.rhs is None else [f"{_name(equation.rhs)}({', '.join(arguments)})"]
    right = ["A y"] * (equation.linear is not None) + right
    read = ""
    if equation.memory:
        read = f", memory: {', '.join(_term(term) for term in equation.memory)}"
    about = f"{equation.d} components" if equation.d > 1 else "one component"
    line = f"{left.replace('+ -', '&minus; ')} = {' + '.join(right)}"
    return f"<p><i>{line}</i>{read}</p><p>{about}, from t = {equation.t_start:g} on</p>"


def _name(function):
    name = getattr(function, "__name__", type(function).__name__)
    return "f" if name == "<lambda>" else html.escape(name.lstrip("_"))


def _term(term):
    factor = _number(term.coefficient)
    operator = term.operator
    order = getattr(operator, "order", None)
    if order is None:  # a general kernel
        primes = "&prime;" * operator.derivative
        return f"{factor}&int; {html.escape(repr(operator.kernel))} y{primes}"
    told = _name(order) + "(t)" if callable(order) else _plain(order)
    kind = "RL" if "RiemannLiouville" in repr(operator) else ""
    return f"{factor}D<sub>{kind}</sub><sup>{told}</sup> y"


def _number(coefficient):
    """Return a factor: nothing for 1, a matrix by its shape."""
    if coefficient.ndim == 2:
        return f"[{coefficient.shape[0]} x {coefficient.shape[1]} matrix] "
    return "" if np.all(coefficient == 1) else f"{_plain(coefficient)} "


def _plain(values):
    """Return one number where all are the same, else a few of them."""
    values = np.unique(values) if np.ptp(values) == 0 else np.ravel(values)
    shown = [f"{value:g}" for value in values[:4]] + ["..."] * (values.size > 4)
    return shown[0] if len(shown) == 1 else f"({', '.join(shown)})"
