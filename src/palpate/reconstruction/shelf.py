"""Volumes whose memory goes round."""

import weakref
from collections import deque

import numpy as np

from palpate.arrays import Float32

FREE = 2  # volumes kept at most: a run has three, the last of which its caller holds


class Shelf:
    """Hands out volumes of one shape, again and again: the memory of one that nobody holds any more is taken for the next.

    Solvers write every iterate to a new volume, for the last ones are the caller's. A system that is asked anew each time
    clears every page before it hands it out, and on virtual machines has to be given it first, which takes longer than
    the passes over it. What is free goes back to the system with the shelf, and at once where it is more than `FREE`.
    """

    def __init__(self, shape: tuple[int, int, int]) -> None:
        self.shape = shape
        self._free: deque[Float32] = deque(maxlen=FREE)

    def empty(self) -> Float32:
        """(z, y, x), not initialised: the caller's for as long as it or any part of it is held."""
        whole = self._free.pop() if self._free else np.empty(self.shape, np.float32)
        # NumPy's views refer to the array that owns the memory, past all between. This one owns nothing, but is over a
        # buffer, no array, so that its own views refer to it and keep it.
        lent = np.frombuffer(whole.data, np.float32)
        weakref.finalize(lent, self._free.append, whole).atexit = False
        return lent.reshape(self.shape)

    def copy(self, volume: Float32) -> Float32:
        """One of the same values."""
        made = self.empty()
        np.copyto(made, volume)
        return made
