"""The progress bar of a run, and its interruption by Ctrl-C."""

from __future__ import annotations

import _signal  # those of `signal` take 6 us more a run: they make handlers enumerations
import signal
import sys
import threading
import time
from typing import Any

from ..compiled.callbacks import hand_over
from ..support.checks import truth


class ProgressBar:
    """Progress bar on a terminal or in a notebook, with the time left; silent elsewhere."""

    WIDTH = 30
    SECONDS_BETWEEN = 0.1

    def __init__(self, shown: bool, stream: Any = None) -> None:
        self._stream = sys.stderr if stream is None else stream
        # a notebook's kernel can rewrite a line too
        self._live = truth("progress", shown) and (
            self._stream.isatty() or type(self._stream).__module__.startswith("ipykernel.")
        )
        self.parts = 1  # number of runs of equal lengths
        self._began = time.perf_counter()
        self._drawn = -1.0

    def update(self, n_runs: float) -> None:
        """Show that so many runs, in [0, parts], are done."""
        share = n_runs / self.parts
        if not self._is_due(last=share >= 1):
            return
        spent, filled = self._drawn, int(self.WIDTH * share)
        left = f"{_clock(spent * (1 - share) / share)} left" if share > 0 else "starting"
        if share >= 1:
            left = f"done in {_clock(spent)}"
        bar = "#" * filled + "." * (self.WIDTH - filled)
        self._write(f"[{bar}] {100 * share:5.1f} %  {left}")

    def count(self, text: str) -> None:
        """Show what has been done, where nobody knows how much is left."""
        if self._is_due():
            self._write(f"{text}, {_clock(self._drawn)}")

    def _is_due(self, last: bool = False) -> bool:
        """Return whether to draw now, and record the time; the `last` drawing is always due."""
        if not self._live:
            return False
        spent = time.perf_counter() - self._began
        if spent - self._drawn < self.SECONDS_BETWEEN and not last:
            return False
        self._drawn = spent
        return True

    def _write(self, text: str) -> None:
        self._stream.write(f"\r{text}   ")
        self._stream.flush()

    def close(self) -> None:
        """End the line of the bar."""
        if self._live and self._drawn >= 0:
            self._stream.write("\n")
            self._stream.flush()


def _clock(seconds: float) -> str:
    minutes, seconds = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{seconds:02d}" if hours else f"{minutes}:{seconds:02d}"


class Interruption:
    """Context that counts Ctrl-C in `asked` instead of raising KeyboardInterrupt."""

    result: Any = None

    def __init__(self, max_asked: int = 1) -> None:
        # A run looks at `asked` between batches of steps, and sets `heeded` when it stops. After
        # `max_asked` times the next Ctrl-C raises at once, one that is not heeded at the end of the
        # context. A KeyboardInterrupt gets `result`. Only the main thread gets signals.
        self.asked, self.heeded, self._max_asked = 0, False, max_asked
        self._previous: Any = None

    def __enter__(self) -> Interruption:
        if threading.current_thread() is threading.main_thread():
            self._previous = _signal.getsignal(signal.SIGINT)
            if self._previous is None or self._previous == signal.SIG_IGN:
                self._previous = None
            else:
                _signal.signal(signal.SIGINT, self._ask)
        return self

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        try:
            if self._previous is not None:
                _signal.signal(signal.SIGINT, self._previous)
                if self.asked and not self.heeded:
                    signal.raise_signal(signal.SIGINT)
        except KeyboardInterrupt as late:
            error = late
            raise
        finally:
            if isinstance(error, KeyboardInterrupt) and self.result is not None:
                hand_over(error, self.result)

    def _ask(self, number: int, frame: object) -> None:
        self.asked += 1
        if self.asked > self._max_asked:
            raise KeyboardInterrupt
