"""Arrays that are checked once and never change, directions, and smooth ramps from 0 to 1 in unit time."""

from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int32 | np.int64]
"""Integers of MuJoCo have 32 bits, those of NumPy 64."""
Bools = NDArray[np.bool_]


ALIGNED = 0.5**0.5
"""cos 45°: unit vectors whose product is larger are nearer to parallel than to perpendicular [-]."""


_YZX = np.array([1, 2, 0])


def path_to_root(parents: Ints, node: int) -> list[int]:
    """Return a node of a tree, its parent and so on; the parent of a root is negative or the root itself."""
    path = [node]
    while (parent := int(parents[path[-1]])) >= 0 and parent != path[-1]:
        path.append(parent)
    return path


def frozen(values: Any, dtype: Any = np.float64) -> NDArray[Any]:
    """A read-only copy of `values` as a contiguous array of `dtype`."""
    array = np.array(values, dtype=dtype, order="C")
    array.setflags(write=False)
    return array


def unit(vectors: Floats) -> Floats:
    """x/‖x‖ along the last axis (…, n); vectors shorter than 1e-9 stay shorter than 1."""
    return vectors / np.maximum(lengths(vectors), 1e-9)[..., None]


def cross(a: Floats, b: Floats) -> Floats:
    """a × b of vectors (…, 3): for a few, in a fifth of the time that `numpy.cross` takes."""
    return (a * b.take(_YZX, axis=-1) - a.take(_YZX, axis=-1) * b).take(_YZX, axis=-1)


def lengths(vectors: Floats) -> Floats:
    """‖x‖ along the last axis (…, n)."""
    return np.sqrt(np.vecdot(vectors, vectors))


def as_slice(indices: Ints) -> Ints | slice:
    """Return consecutive indices (N,) as a slice, which is faster; other indices unchanged."""
    consecutive = indices.size and (np.diff(indices) == 1).all()
    return slice(int(indices[0]), int(indices[-1]) + 1) if consecutive else indices


def bearing(ahead: Floats) -> Floats:
    """Return the angle (…) of directions (…, 2) along the floor, from x towards y [rad]."""
    return np.arctan2(ahead[..., 1], ahead[..., 0])


def leftward(ahead: Floats) -> Floats:
    """What lies to the left of directions along the floor (…, 2)."""
    return np.stack([-ahead[..., 1], ahead[..., 0]], axis=-1)


def intervals(flags: Bools) -> list[tuple[int, int]]:
    """Return the runs of True as (first, last + 1)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(np.int8), [0]])))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


Values = TypeVar("Values", float, Floats)

JERK_PEAK = 1.875
"""Largest slope of `minimum_jerk` [-]."""
SMOOTHSTEP_PEAK = 1.5
"""Largest slope of `smoothstep` [-]."""


def minimum_jerk(u: Floats) -> Floats:
    """Return 10 u³ − 15 u⁴ + 6 u⁵: zero slope and curvature at both ends."""
    return 10 * u**3 - 15 * u**4 + 6 * u**5


def least_jerk(u: Floats, way: Floats, before: Floats, after: Floats) -> tuple[Floats, Floats]:
    """Return the path of least jerk over unit time from 0, and its velocity; without acceleration at both ends.

    It is  v u + (10 d − 6 v − 4 w) u³ + (8 v + 7 w − 15 d) u⁴ + (6 d − 3 v − 3 w) u⁵.

    Args:
        u: time, 0 … 1.
        way: d, the place at the end.
        before: v, the velocity at the beginning.
        after: w, the velocity at the end.
    """
    cubic, quartic = 10 * way - 6 * before - 4 * after, 8 * before + 7 * after - 15 * way
    quintic = 6 * way - 3 * before - 3 * after
    place = before * u + cubic * u**3 + quartic * u**4 + quintic * u**5
    return place, before + 3 * cubic * u**2 + 4 * quartic * u**3 + 5 * quintic * u**4


def smoothstep(u: Values) -> Values:
    """Return 3 u² − 2 u³: zero slope at both ends."""
    return u**2 * (3 - 2 * u)
