"""Arrays in few bytes for a page: whole numbers of a step, differences along the first axis, gzip.

A file is the length of a JSON header (uint32, little endian), the header, and the arrays. In the header an array is
{"type", "step", "shape", "offset"}; its value is step × the running sum over the first axis, wrapped to its type, and the
smallest number of the type means "no value". `assets/data.js` reads it.
"""

import gzip
import json
from typing import Any

import numpy as np

LENGTH = 1e-4
"""Step of places [m]."""
TURN = 1 / 16384
"""Step of poses: places [m] and quaternions [-] alike; two metres fit into two bytes."""
ANGLE = 1e-4
"""Step of joint angles [rad] and, a thousandfold, of anything that is read off a chart."""


class Packer:
    """Collects arrays; `add` returns their entry for the header."""

    def __init__(self) -> None:
        self._parts: list[bytes] = []
        self._size = 0

    def add(self, values: Any, step: float = 1.0) -> dict[str, Any]:
        """Add an array of any shape, rounded to multiples of a step; values that are not finite are stored as "no value"."""
        array = np.asarray(values, dtype=float)
        finite = np.isfinite(array)
        whole = np.rint(np.where(finite, array, 0) / step)
        narrow = np.abs(whole).max(initial=0) < np.iinfo(np.int16).max
        kind = np.int16 if narrow else np.int32
        whole = np.where(finite, np.clip(whole, -(2**31) + 1, 2**31 - 1), np.iinfo(kind).min).astype(kind)
        if whole.ndim:
            with np.errstate(over="ignore"):
                whole = np.concatenate([whole[:1], np.diff(whole, axis=0)])
        data = whole.astype(f"<i{whole.itemsize}").tobytes()
        place = {"type": f"i{whole.itemsize}", "step": step, "shape": list(array.shape), "offset": self._size}
        padded = data + bytes(-len(data) % 4)
        self._parts.append(padded)
        self._size += len(padded)
        return place

    def packed(self, header: Any) -> bytes:
        """Header and arrays, compressed; the same content always gives the same bytes.

        Raises:
            ValueError: the header holds a number that is not finite.
        """
        text = json.dumps(header, separators=(",", ":"), allow_nan=False).encode()
        text += b" " * (-len(text) % 4)
        return gzip.compress(len(text).to_bytes(4, "little") + text + b"".join(self._parts), 9, mtime=0)
