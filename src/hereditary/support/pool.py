"""Arrays that one run works on at a time, kept for later runs."""

import threading
from collections.abc import Callable, Hashable
from typing import Any


class Pool:
    """The newest `most` objects that nobody uses at present, by a key that says which are alike."""

    def __init__(self, most: int) -> None:
        # who acquires an object has it alone, so threads never write into the same arrays
        self._most, self._lock = most, threading.Lock()
        self._kept: list[tuple[Hashable, Any]] = []

    def acquire(self, key: Hashable, make: Callable[[], Any]) -> tuple[Hashable, Any]:
        """Remove and return a key and an object of it, made if none is kept, for `release`."""
        with self._lock:
            for place in range(len(self._kept) - 1, -1, -1):
                if self._kept[place][0] == key:
                    return self._kept.pop(place)
        return key, make()

    def release(self, acquired: tuple[Hashable, Any]) -> None:
        """Keep the pair that `acquire` returned for the next one who asks for this key."""
        with self._lock:
            self._kept.append(acquired)
            del self._kept[: -self._most]
