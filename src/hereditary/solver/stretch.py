"""How many steps are made at once, between two looks at Ctrl-C and the progress bar."""

import time

# As many as take this long, but no more than whose rows stay in a near cache, that is so many
# numbers. Entering the compiled march costs 0.04 ms.
_SECONDS, _NUMBERS, _LEAST = 0.1, 1 << 15, 32
# Steps made at once where an event may cut them short.
_SHORT = 256


class Stretch:
    """Steps to make at once, by the time that those before took."""

    def __init__(self):
        self._seconds, self.most = 0.0, _NUMBERS

    def steps(self, system):
        """Return the number of steps for a system; at first by the time of one call of f."""
        if self._seconds == 0.0:
            began = time.perf_counter()
            try:
                system.force(0.0, system.at_start)
            except Exception:  # the march meets it again, at its own time
                return 1
            self.note(time.perf_counter() - began, 1)
        most = min(max(_NUMBERS // system.d, _LEAST), self.most)
        return int(min(max(_SECONDS / self._seconds, 1), most))

    def keep_short(self):
        """Make few steps at once."""
        self.most = _SHORT

    def note(self, seconds, made):
        """Note the time that some steps took."""
        self._seconds = max(seconds, 1e-9) / max(made, 1)
