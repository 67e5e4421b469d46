"""A pool that reuses the memory of volumes."""

import weakref
from collections import deque

import numpy as np

from palpate.arrays import Float32

FREE = 2  # unused volumes that are kept, at most: a run has three, and its caller holds the last


class VolumePool:
    """Allocates volumes of one shape, and reuses the memory of those to which no reference is left.

    Solvers write every iterate to a new volume, since the caller may keep the last ones. The operating system clears each
    page of new memory, which takes longer than the passes over it, above all on virtual machines. The pool keeps at most
    `FREE` unused volumes.
    """

    def __init__(self, shape: tuple[int, int, int]) -> None:
        self.shape = shape
        self._free: deque[Float32] = deque(maxlen=FREE)

    def empty(self) -> Float32:
        """(z, y, x), not initialised; the caller's as long as a reference to it or a part of it exists."""
        whole = self._free.pop() if self._free else np.empty(self.shape, np.float32)
        # A NumPy view refers to the array that owns the memory, not to the view it was made from. This array is made from
        # a buffer, so that its own views refer to it, and the pool gets the memory back only after the last of them.
        view = np.frombuffer(whole.data, np.float32)
        weakref.finalize(view, self._free.append, whole).atexit = False
        return view.reshape(self.shape)

    def copy(self, volume: Float32) -> Float32:
        """A copy of the volume."""
        made = self.empty()
        np.copyto(made, volume)
        return made
