"""Driving a march: a stretch at a time, between looks at Ctrl-C and the progress bar."""

import time
import traceback

from ..memory_kernel import MemoryKernel
from ..orders import OrderFailed
from .solution import Status, warn_of

# Steps in a stretch: as many as take this long, but no more than whose rows stay in a near cache.
# Entering the compiled march costs 0.04 ms.
_STRETCH_MAX, _STRETCH_SECONDS = 1 << 15, 0.1


class Drive:
    """Takes a stepper to given steps, and says how it ended where it does not get there.

    Parameters
    ----------
    stepper : Stepper or the like
        Has `n`, `seconds_of_rhs`, `blown_up` and `not_solved`.
    n_total : int
        Last step of the whole run.
    advance : callable
        ``advance(n_more)`` makes steps and keeps what is wanted of them.
    interruption : Interruption
    bar : ProgressBar
    whole : bool
        March to each given step at once, for a stepper whose own steps depend on where it stops.
    """

    def __init__(self, stepper, n_total, advance, interruption, bar, whole=False):
        self._stepper, self._n_first, self._n_total = stepper, stepper.n, n_total
        self._advance, self._interruption, self._bar = advance, interruption, bar
        self._stretch, self._whole = 0, whole

    def to(self, n_end):
        """March to step `n_end`; None when there, else a status and a detail for it."""
        stepper = self._stepper
        while stepper.n < n_end:
            try:
                self._stretch = self._stretch or _fitting_steps(stepper.seconds_of_rhs())
                n_more = n_end - stepper.n
                if not self._whole:
                    n_more = min(self._stretch, n_more)
                began = time.perf_counter()
                self._advance(n_more)
            except OrderFailed as error:
                return Status.ORDER_FAILED, str(error)
            except Exception as error:
                return failed(error)
            if stepper.blown_up:
                return Status.BLOWN_UP, ""
            if stepper.not_solved:
                return Status.NOT_SOLVED, ""
            if getattr(self._advance, "ended", False):
                return None
            if stepper.no_step:
                return Status.STEP_TOO_SMALL, stepper.no_step
            self._bar.update((stepper.n - self._n_first) / (self._n_total - self._n_first))
            if self._interruption.asked and stepper.n < self._n_total:
                self._interruption.heeded = True
                return Status.INTERRUPTED, ""
            spent = max(time.perf_counter() - began, 1e-9)
            self._stretch = _fitting_steps(spent / n_more)
        return None


def failed(error):
    """Status and detail of a run that an exception ended, of the right-hand side or of a kernel."""
    # kernels are called from Python alone: their methods are among the frames
    owners = (frame.f_locals.get("self") for frame, _ in traceback.walk_tb(error.__traceback__))
    by_kernel = any(isinstance(owner, MemoryKernel) for owner in owners)
    status = Status.KERNEL_FAILED if by_kernel else Status.RHS_FAILED
    return status, f"{type(error).__name__}: {error}"


def _fitting_steps(seconds):
    """Steps in a stretch when one takes so long."""
    return int(min(max(_STRETCH_SECONDS / seconds, 1), _STRETCH_MAX))


def reached_end(stepper):
    """Status of a run that reached its end."""
    if stepper.zigzag is not None:
        return Status.ZIGZAG
    beyond = stepper.largest_ratio > 1 or stepper.growth is not None
    return Status.STEP_TOO_LARGE if beyond else Status.COMPLETED


def told(stepper, status, detail):
    """The status in a sentence with the run's numbers; warns of an ending not asked for."""
    message = status.sentence + (f": {detail}" if detail else "")
    if status is not Status.COMPLETED:
        message += f" (t = {stepper.t:g} of step {stepper.n})"
    trouble = _stability(stepper)
    if trouble:
        message += f"; {trouble}"
    warn_of(status, message, unstable=bool(trouble))
    return message


def _stability(stepper):
    """Name what is wrong with the step, in a clause; empty when nothing is."""
    found = []
    if stepper.zigzag is not None:
        seen = stepper.zigzag * stepper.h
        found.append(f"a step-to-step zigzag had lasted at t = {seen:g}")
    if stepper.growth is not None:
        at = f"by t = {stepper.growth * stepper.h:g}"
        found.append(f"increments that turn within a few steps had grown {at}")
    if stepper.largest_ratio > 1:
        at = f"near t = {stepper.largest_ratio_step * stepper.h:g}"
        found.append(f"d rhs/d y reached {stepper.largest_ratio:.4g} times its limit {at}")
    if not found:
        return ""
    return " and ".join(found) + f" at h = {stepper.h:g}; take smaller steps"
