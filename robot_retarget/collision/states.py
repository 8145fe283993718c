"""From what is foreseen to states that hold: sliding windows over the frames, whole or one at a time.

A contact is imminent once it has been foreseen in every frame of a window (least over the window), and a state is kept
as long as any frame of a window called for it (greatest over the window). Both windows end at the present frame.
"""

from enum import IntEnum

import numpy as np
from scipy.ndimage import maximum_filter1d, minimum_filter1d


class State(IntEnum):
    """How a pair of links stands."""

    CLEAR = 0
    APPROACHING = 1
    IMMINENT = 2
    CONTACT = 3


class Windows:
    """States of a whole trajectory, or of a stream's next frame."""

    def __init__(self, confirm: int, release: int):
        """Frames in which a contact must be foreseen, and frames for which a state is kept."""
        self.confirm, self.release = confirm, release
        self._foreseen, self._called = np.zeros((confirm, 0), bool), np.zeros((release, 0), np.int8)
        self._count = 0

    def all(self, foreseen: np.ndarray, called: np.ndarray) -> np.ndarray:
        """(T, P) states from (T, P) whether a contact is foreseen and what each frame calls for by itself."""
        size = self.confirm
        lasting = minimum_filter1d(foreseen.astype(np.int8), size, axis=0, mode="constant", origin=(size - 1) // 2)
        called = np.where(lasting > 0, np.maximum(called, State.IMMINENT), called).astype(np.int8)
        size = self.release
        return maximum_filter1d(called, size, axis=0, mode="constant", origin=(size - 1) // 2)

    def next(self, foreseen: np.ndarray, called: np.ndarray) -> np.ndarray:
        """The same (1, P) for the frame that follows those given before."""
        if not self._count:
            self._foreseen, self._called = (
                np.zeros((len(past), foreseen.shape[1]), past.dtype) for past in (self._foreseen, self._called)
            )
        self._foreseen[self._count % self.confirm] = foreseen
        latest = self._called[self._count % self.release]
        latest[:] = called
        np.maximum(latest, State.IMMINENT, out=latest, where=self._foreseen.all(axis=0))
        self._count += 1
        return self._called.max(axis=0, keepdims=True)
