"""Messages of functions that lack an argument of `solve`, or of other solvers."""

from __future__ import annotations

from collections.abc import Callable
from typing import ParamSpec, TypeVar

from ..support.checks import refusing

_P = ParamSpec("_P")
_R = TypeVar("_R")

# For each argument of `solve`, what a message says to do where another function lacks it.
OF_SOLVE = {
    "n_steps": "leave it out, and give what this function takes",
    "rtol": "give n_steps",
    "atol": "leave it out, or solve(...) with it",
    "mesh": "give n_steps or rtol",
    "scheme": "leave it out, or solve(...) with it",
    "history": "leave it out, or solve(...) with it",
    "save_every": "select rows of the result",
    "t_eval": "solve(...) has rows at these times",
    "components": "select components of the result",
    "max_step": "name times of jumps and pulses in breaks, where the function takes it",
    "max_steps": "take a larger rtol, or n_steps",
    "breaks": "solve(...) takes it",
    "events": "solve(equation, t_end, events=...) finds them, also for each point of a sweep",
    "switches": "write a smooth function, such as tanh(x / eps), in place of what jumps",
    "changes": "solve(equation, t_end, changes=...) makes them, also for each point of a sweep",
    "progress": "only longer runs show a bar",
    "resume": "a run begins at t_start; solve(..., resume=...) goes on",
    "allow_change": "it comes with resume, in solve(...)",
    "params": "pass equation.replace(params=...)",
    "estimate": "only solve(...) estimates the errors of its runs",
}
# For keywords of other solvers, what a message says to write instead.
OF_OTHERS = {
    "t0": "Equation(..., t_start=t0) sets the start",
    "t_span": "Equation(..., t_start=...) sets the start, and t_end the end",
    "y0": "Equation(terms, rhs, y0) has it",
    "args": "Equation(..., params=args) has them",
    "jac": "Equation(..., jac=...) has it",
    "method": "pass scheme=, e.g. scheme=hd.BDF(2)",
    "first_step": "the first step is chosen by the tolerance, or is that of n_steps",
    "h": "pass n_steps, for steps of (t_end - t_start) / n_steps",
    "dt": "pass n_steps, for steps of (t_end - t_start) / n_steps",
}


def lacking(default: str = "", **instead: str) -> Callable[[Callable[_P, _R]], Callable[_P, _R]]:
    """Return a decorator that refuses keywords that a function has no argument for."""
    # a message says what to do `instead`, or, of an argument of `solve`, `default` or `OF_SOLVE`
    others = {} if default else OF_OTHERS
    remedies = {name: default or remedy for name, remedy in OF_SOLVE.items()}
    return refusing(others | remedies | instead)
