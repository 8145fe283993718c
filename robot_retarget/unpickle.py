"""Pickles as data: read without running anything, written so that any NumPy reads them.

A pickle is a program. This reader can make arrays, numbers, text, lists, tuples, dicts and sets; a pickle that names
anything else is refused before it is made.
"""

import io
import pickle
import struct
from collections import OrderedDict
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from robot_retarget.errors import TrajectoryError
from robot_retarget.unpack import unpacked

PROTOCOL = 4
"""Protocol of written pickles: Python 3.4 and later read it."""
_JOBLIB = "joblib.numpy_pickle"


def load_pickle(path: Path) -> Any:
    """The contents of a pickle or a joblib file, lz4, gzip or zlib packed or not.

    Raises:
        TrajectoryError: it cannot be read, or would make anything but arrays, numbers, text, lists and dicts.
    """
    stream = io.BytesIO(unpacked(path))
    try:
        return DataUnpickler(stream).load()
    except pickle.UnpicklingError as error:
        raise TrajectoryError(f"{path}: {error}") from error
    except (
        ArithmeticError,
        AttributeError,
        EOFError,
        IndexError,
        KeyError,
        MemoryError,
        TypeError,
        ValueError,
        struct.error,
    ) as error:
        raise TrajectoryError(f"{path}: broken pickle: {error}") from error


def dump_pickle(value: Any) -> bytes:
    """A pickle in which arrays name `numpy.ndarray` only, which every NumPy has: 1.x and 2.x read it alike."""
    stream = io.BytesIO()
    _Pickler(stream, protocol=PROTOCOL).dump(value)
    return stream.getvalue()


class _Pickler(pickle.Pickler):
    def reducer_override(self, value: Any) -> Any:
        if type(value) is not np.ndarray:
            return NotImplemented
        if value.dtype.hasobject:
            raise TypeError("an array of Python objects is no plain array")
        plain = np.ascontiguousarray(value)
        return np.ndarray, (plain.shape, plain.dtype.str, bytearray(plain.tobytes()))


class _JoblibArray:
    """What joblib writes before the bytes of an array."""

    def __init__(self) -> None:
        self.state: dict[str, Any] = {}


class DataUnpickler(pickle._Unpickler):  # the compiled one cannot stop at joblib's arrays
    """Builds nothing but data."""

    dispatch: ClassVar[dict[int, Any]] = dict(pickle._Unpickler.dispatch)

    def __init__(self, stream: io.BytesIO):
        super().__init__(stream)
        self.stream = stream

    def find_class(self, module: str, name: str) -> Any:
        if (module, name) == (_JOBLIB, "NumpyArrayWrapper"):
            return _JoblibArray
        made = _ALLOWED.get((_FORMER.get(module, module), name))
        if made is None:
            raise pickle.UnpicklingError(
                f"the pickle wants to make {module}.{name}, which could run code; only arrays, numbers, "
                "text, lists and dicts are read: save it again as such in the program that made it"
            )
        return made

    def load_build(self) -> None:
        built = self.stack[-2]  # type: ignore[attr-defined]
        if isinstance(built, _JoblibArray):
            state = self.stack.pop()  # type: ignore[attr-defined]
            self.stack[-1] = self._joblib_array(state)  # type: ignore[attr-defined]
        elif isinstance(built, np.ndarray | np.dtype):
            super().load_build()  # type: ignore[misc]
        else:
            raise pickle.UnpicklingError(f"the pickle wants to change a {type(built).__name__}, which no data needs")

    dispatch[pickle.BUILD[0]] = load_build

    def _joblib_array(self, state: dict[str, Any]) -> np.ndarray:
        """The bytes of an array, which follow its description in the stream."""
        shape, dtype, order = tuple(map(int, state["shape"])), np.dtype(state["dtype"]), state["order"]
        if dtype.hasobject:
            raise pickle.UnpicklingError("an array of Python objects, which could run code")
        if state.get("numpy_array_alignment_bytes") is not None:
            padding = self.stream.read(1)
            self.stream.read(struct.unpack("B", padding)[0])
        return _array(shape, dtype, self.stream.read(int(np.prod(shape, dtype=object)) * dtype.itemsize), order)


def _bare_array(kind: Any, shape: Any, letter: Any) -> np.ndarray:
    """The empty array that NumPy's own pickles begin with; its bytes follow."""
    if tuple(shape) != (0,):
        raise pickle.UnpicklingError("an array begins with a size, which none does")
    return np.ndarray((0,), "u1")


def _array(shape: Any, dtype: Any, buffer: Any, order: Any = "C") -> np.ndarray:
    """An array over given bytes."""
    return np.ndarray(tuple(shape), np.dtype(dtype), _bytes(buffer), order=order)


def _buffer_array(buffer: Any, dtype: Any, shape: Any, order: Any) -> np.ndarray:
    return _array(shape, dtype, buffer, order)


def _bytes(data: Any = b"") -> bytearray:
    if not isinstance(data, bytes | bytearray):
        raise pickle.UnpicklingError("bytes from something else than bytes")
    return bytearray(data)


def _latin(text: str, encoding: str) -> bytes:
    """Bytes as protocol 2 writes them."""
    return text.encode("latin-1" if encoding in ("latin1", "latin-1") else "ascii")


def _scalar(dtype: Any, data: bytes) -> Any:
    return np.frombuffer(data, dtype)[0]


_FORMER = {
    "__builtin__": "builtins",
    "numpy._core.multiarray": "numpy.core.multiarray",
    "numpy._core.numeric": "numpy.core.numeric",
}
"""Modules under the names that they have in other versions."""
_ALLOWED: dict[tuple[str, str], Any] = {
    ("numpy.core.multiarray", "_reconstruct"): _bare_array,
    ("numpy.core.multiarray", "scalar"): _scalar,
    ("numpy.core.numeric", "_frombuffer"): _buffer_array,
    ("numpy", "ndarray"): _array,
    ("numpy", "dtype"): np.dtype,
    ("_codecs", "encode"): _latin,
    ("builtins", "bytes"): lambda data=b"": bytes(_bytes(data)),
    ("builtins", "bytearray"): _bytes,
    ("collections", "OrderedDict"): OrderedDict,
    ("builtins", "list"): list,
    ("builtins", "dict"): dict,
    ("builtins", "set"): set,
}
