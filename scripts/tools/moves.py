"""Smooth moves from key to key, the grammar of the sample clips.

[Flash1985] T. Flash, N. Hogan, The coordination of arm movements: an experimentally confirmed mathematical model,
            J. Neuroscience 5(7), 1985.
"""

from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]
Key = tuple[float, ArrayLike]
"""When [s], and what value."""


def minimum_jerk(share: Floats) -> Floats:
    """10 s³ − 15 s⁴ + 6 s⁵ of s in 0 … 1: no speed and no acceleration at either end [Flash1985]."""
    share = np.clip(share, 0, 1)
    return share**3 * (10 - 15 * share + 6 * share**2)


def through(time: Floats, *keys: Key) -> Floats:
    """Values that move from key to key and rest at each → (T, …)."""
    first = np.asarray(keys[0][1], dtype=float)
    value = np.tile(first, (len(time), *[1] * first.ndim))
    for (begin, here), (end, there) in pairwise(keys):
        value += np.multiply.outer(minimum_jerk((time - begin) / (end - begin)), np.subtract(there, here))
    return value


def turning(time: Floats, *keys: Key) -> Floats:
    """Directions that turn along great circles from key to key and rest at each → (T, 3), of unit length."""
    way = np.tile(unit(keys[0][1]), (len(time), 1))
    for (begin, here), (end, there) in pairwise(keys):
        angle = np.arccos(np.clip(unit(here) @ unit(there), -1, 1))
        if angle > 0:
            later = time > begin
            share = minimum_jerk((time[later] - begin) / (end - begin))
            way[later] = np.outer(np.sin((1 - share) * angle), unit(here)) + np.outer(
                np.sin(share * angle), unit(there)
            )
            way[later] /= np.sin(angle)
    return way


def covered(time: Floats, start: float, ramp: float) -> Floats:
    """The time gone at full pace, of a pace that rises from 0 to 1 by a minimum-jerk ramp from `start` on [s]."""
    share = np.clip((time - start) / ramp, 0, 1)
    return ramp * share**4 * (2.5 - 3 * share + share**2) + np.maximum(time - start - ramp, 0)


def unit(vectors: ArrayLike) -> Floats:
    vectors = np.asarray(vectors, dtype=float)
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
