"""Arrays that are checked once and never change."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


def frozen(values: Any, dtype: Any = np.float64) -> NDArray[Any]:
    """A read-only copy of `values` as a contiguous array of `dtype`."""
    array = np.array(values, dtype=dtype, order="C")
    array.setflags(write=False)
    return array
