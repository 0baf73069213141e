"""Stepper whose tangents are made orthonormal on the way."""

from functools import partial

import numpy as np

from ..compiled.growing_march import LOST, Growth, grow
from ..compiled.jit import loop_value
from ..compiled.signatures import MARCH_SIG
from .fixed_stepper import FixedStepper

# Renormalisations of one entry into compiled code.
_ROOM = 1024


class GrowingStepper(FixedStepper):
    """A march whose tangents are made orthonormal in compiled code, their memory included.

    Attributes
    ----------
    room : int
        Renormalisations after which `advance` returns.
    """

    room = _ROOM

    def follow(self, pace, last):
        """Make tangents orthonormal from now on when `pace` says, in a run to step `last`."""
        self._growth = Growth(
            above=self._with_speed.astype(np.int64),
            d=self.equation.d,
            h=self.h,
            lasting=int(self._lasting),
            last=last,
            steps=np.zeros(self.room, dtype=np.int64),
            logs=np.zeros((self.room, self.n_tangents)),
            made=np.zeros(1, dtype=np.int64),
        )
        march = loop_value(self._loop, MARCH_SIG)
        self._loop = partial(_grown, march, pace, self._growth)

    def grown(self):
        """Return steps (k,) and logarithms of the growth (k, n_tangents) since the last call."""
        made = self._growth.made[0]
        self._growth.made[0] = 0
        return self._growth.steps[:made].copy(), self._growth.logs[:made].copy()

    @property
    def lost(self):
        """Whether tangents overflowed or vanished."""
        return self._status == LOST


def _grown(march, pace, growth, *arguments):
    """Enter the loop of renormalisations as the march itself is entered."""
    return grow(march, *arguments, pace, growth)
