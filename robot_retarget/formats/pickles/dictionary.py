"""Values of unpickled dictionaries, checked by shape and type."""

from typing import Any

import numpy as np

from robot_retarget.base.arrays import Floats
from robot_retarget.base.errors import FileError
from robot_retarget.base.untrusted.arrays import shaped


def holds(value: Any, *keys: str) -> bool:
    """Whether a value is a dictionary with these keys."""
    return isinstance(value, dict) and all(key in value for key in keys)


def array_in(table: Any, key: str, shape: tuple[int | None, ...]) -> Floats:
    """An array, or lists of numbers, by its key.

    Raises:
        FileError: it is not there or has another shape.
    """
    if not holds(table, key):
        raise FileError(f"no {key!r} in the dictionary")
    try:
        return shaped(np.asarray(table[key]), shape, key)
    except ValueError as error:
        raise FileError(f"{key!r} is no array: {error}") from error
