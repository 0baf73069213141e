"""Statuses of runs, their warnings, and the ending of a run by an exception."""

import enum
import traceback
from typing import NamedTuple

from ..compiled.callbacks import original
from ..equation.orders import OrderFailed
from ..kernels.memory_kernel import MemoryKernel

# Detail in the message of a run that ends because every step leaves the domain of the right-hand
# side.
NOT_FINITE = "the right-hand side is not finite just ahead"


class Status(enum.StrEnum):
    """The status of a run: a string, as in ``sol.status == "blown_up"``.

    docs/troubleshooting.md has a remedy for each status.

    Attributes
    ----------
    sentence : str
        First words of the message of a solution with this status.
    """

    sentence: str

    def __new__(cls, value: str, sentence: str) -> "Status":
        """Return the member with this value and this sentence."""
        member = str.__new__(cls, value)
        member._value_, member.sentence = value, sentence
        return member

    COMPLETED = "completed", "the run reached the end"
    STEP_TOO_LARGE = (
        "step_too_large",
        "the run reached the end, but beyond the scheme's stability limit on the way",
    )
    KERNEL_INACCURATE = ("kernel_inaccurate", "a memory kernel is less accurate than its tolerance")
    ZIGZAG = (
        "zigzag",
        "the solution zigzags from step to step: the step is beyond the stability limit",
    )
    BLOWN_UP = "blown_up", "the solution stopped being finite"
    INTERRUPTED = "interrupted", "the run was interrupted"
    NOT_SOLVED = (
        "not_solved",
        "Newton's method did not converge: take smaller steps, give an exact jac, or name the "
        "times of jumps as breaks",
    )
    STEP_TOO_SMALL = "step_too_small", "no step is small enough for the tolerance"
    MAX_STEPS = "max_steps", "the run made max_steps steps before its end"
    EVENT = "event", "a terminal event ended the run"
    SLIDING = "sliding", "the solution slides along a switch: both sides push it there"
    PILED_UP = "piled_up", "changes by an event follow each other without end"
    RHS_FAILED = "rhs_failed", "the right-hand side raised an exception"
    ORDER_FAILED = "order_failed", "an order left its range, or its function raised an exception"
    KERNEL_FAILED = "kernel_failed", "a memory kernel raised an exception"
    EVENT_FAILED = (
        "event_failed",
        "an event function or a change raised an exception, wrote into y or returned a wrong value",
    )


class SolveWarning(UserWarning):
    """A run ended early, or was unstable, or its kernel is inaccurate: see its message."""


class StabilityWarning(SolveWarning):
    """The step is beyond the scheme's stability limit, or the solution zigzags."""


class Ending(NamedTuple):
    """The ending of a run: its status, a clause for its message, and the exception if any."""

    status: Status
    detail: str = ""
    error: BaseException | None = None


def failed(error: BaseException) -> Ending:
    """Return the `Ending` of a run that an exception ended."""
    # the status depends on what raised it: an order, a kernel or the right-hand side
    cause = original(error)
    if isinstance(cause, OrderFailed):
        return Ending(Status.ORDER_FAILED, str(cause), error)
    # only Python calls kernels, so a method of the kernel is among the frames of the traceback
    owners = (frame.f_locals.get("self") for frame, _ in traceback.walk_tb(cause.__traceback__))
    by_kernel = any(isinstance(owner, MemoryKernel) for owner in owners)
    status = Status.KERNEL_FAILED if by_kernel else Status.RHS_FAILED
    return Ending(status, f"{type(cause).__name__}: {cause}", error)
