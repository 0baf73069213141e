"""Messages of functions that lack an argument of `solve`."""

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


def lacking(default: str = "", **instead: str) -> Callable[[Callable[_P, _R]], Callable[_P, _R]]:
    """Return a decorator that refuses each argument of `solve` that a function lacks.

    A message says what to do `instead`, by the name of the argument. Without an entry it says the
    `default`, or the entry of `OF_SOLVE`.
    """
    remedies = {name: default or remedy for name, remedy in OF_SOLVE.items()}
    return refusing(remedies | instead)
