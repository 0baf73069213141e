"""Tables of mode factors, kept from one march to the next that has the same modes and nodes."""

import threading

from ..compiled.mode_tables import empty_tables

# Tables that are kept; each holds up to 64 lengths of steps, some hundred kB.
_MOST = 8


class KeptTables:
    """Tables that no march works with at present.

    A march takes one and gives it back, so that no two write to it at once. Factors depend on the
    length of a step, the nodes, and the rates and kernels alone: results do not depend on which
    lengths a table holds already.
    """

    def __init__(self):
        self._kept, self._lock = [], threading.Lock()

    def take(self, basis, s, n_varying):
        """Return a table for these modes on s nodes, and what it is to be given back with."""
        n_kernels = basis.masses.size - n_varying
        of_kernels = basis.weights[basis.weights.shape[0] - basis.masses.size :][:n_kernels]
        parts = basis.rates, basis.gains, of_kernels, basis.masses[:n_kernels]
        key = s, n_varying, *(part.tobytes() for part in parts)
        with self._lock:
            for place in reversed(range(len(self._kept))):
                if self._kept[place][0] == key:
                    return self._kept.pop(place)
        return key, empty_tables(basis.rates.size, s, basis.masses.size)

    def give_back(self, taken):
        """Keep what `take` returned for a later march."""
        with self._lock:
            self._kept.append(taken)
            del self._kept[:-_MOST]


kept_tables = KeptTables()
