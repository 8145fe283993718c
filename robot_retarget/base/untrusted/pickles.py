"""Pickles as data: read without running anything, written so that any NumPy reads them.

A pickle is a program. This reader makes numbers, text, lists, tuples, dicts, sets and plain arrays, the latter from a
checked head alone; a pickle that names anything else is refused before it is made. Joblib writes the bytes of arrays
between the instructions; PyTorch writes a zip of a pickle and the bytes of its tensors; NumPy writes a pickle after the head of
an array of objects.
"""

import io
import pickle
import re
import struct
import zipfile
from collections import OrderedDict
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from robot_retarget.base.errors import FileError
from robot_retarget.base.untrusted.arrays import PLAIN, Head, read_head
from robot_retarget.base.untrusted.limits import (
    LIMITS,
    is_zip,
    member_bytes,
    one_line,
    opened_zip,
    refusing,
    require_tree,
    unpacked,
)

PROTOCOL = 4
"""Protocol of written pickles: Python 3.4 and later read it."""


def load_pickle(path: Path) -> Any:
    """Read the contents of a pickle, of a joblib file, packed or not, of a `.pt` of PyTorch 1.6 or later, or of NumPy's objects.

    Raises:
        FileError: it cannot be read, would make anything but data, or takes more memory than its limit.
    """
    with refusing(path, "pickle"):
        return _load_zip(path) if is_zip(path) else _load_file(unpacked(path), LIMITS.unpacked(path))


def parse_pickle(program: bytes, limit: int) -> Any:
    """Read a pickle within another.

    Args:
        limit: most bytes that it may make.

    Raises:
        UnpicklingError: it would make anything but data.
    """
    return _load(program, limit, _no_storage)


def _load_file(data: bytes, limit: int) -> Any:
    """The contents of a pickle, or of an `.npy` of objects."""
    stream = io.BytesIO(data)
    if data.startswith(np.lib.format.MAGIC_PREFIX):
        read_head(stream)
    return parse_pickle(stream.read(), limit)


def _no_storage(name: str, size: int) -> bytes:
    raise pickle.UnpicklingError(f"a tensor {one_line(name, 80)} of {size} bytes outside a file of PyTorch")


def _load_zip(path: Path) -> Any:
    with opened_zip(path, "file of PyTorch") as archive:
        index = next((name for name in archive.namelist() if name.endswith("data.pkl")), None)
        arrays = [name for name in archive.namelist() if name.endswith(".npy")]
        if index is None and arrays:
            limit = LIMITS.unpacked(path)
            members = {name.removesuffix(".npy"): member_bytes(archive, name, path) for name in arrays}
            return {name: _load_file(data, limit) for name, data in members.items()}
        if index is None:
            listed = one_line(", ".join(archive.namelist()) or "nothing")
            raise FileError(f"{path}: a zip without a pickle of PyTorch; it holds {listed}")
        folder = index.removesuffix("data.pkl")
        program = member_bytes(archive, index, path)
        return _load(
            program, LIMITS.unpacked(path), lambda name, size: member_bytes(archive, f"{folder}data/{name}", path)
        )


def _load(program: bytes, limit: int, storage: Callable[[str, int], bytes]) -> Any:
    value = _DataUnpickler(program, limit, storage).load()
    require_tree(value, len(program), limit)
    return value


def dump_pickle(value: Any) -> bytes:
    """Return a pickle in which arrays name `numpy.ndarray` only, which every NumPy has: 1.x and 2.x read it alike."""
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


@dataclass
class _Type:
    """The type of an array while it is described; its byte order follows."""

    plain: np.dtype


@dataclass
class _JoblibArray:
    """The description of an array that joblib writes before its bytes."""

    state: dict[str, Any] = field(default_factory=dict)


class _DataUnpickler(pickle._Unpickler):  # the compiled one cannot stop at joblib's arrays
    """Builds nothing but data, and no more of it than a limit."""

    dispatch: ClassVar[dict[int, Any]] = dict(pickle._Unpickler.dispatch)

    def __init__(self, program: bytes, limit: int, storage: Callable[[str, int], bytes]):
        self.stream = io.BytesIO(program)
        super().__init__(self.stream)
        self.limit, self.storage = limit, cache(storage)

    def find_class(self, module: str, name: str) -> Any:
        named = (_FORMER.get(module, module), name)
        if named == ("joblib.numpy_pickle", "NumpyArrayWrapper"):
            return _JoblibArray
        if module == "torch" and name in _STORAGES:
            return np.dtype(_STORAGES[name])
        if named not in _MAKERS:
            raise pickle.UnpicklingError(
                f"the pickle wants to make {one_line(module, 80)}.{one_line(name, 80)}, which could run code; only "
                "arrays, numbers, text, lists and dicts are read: save it again as such in the program that made it (docs/motions.md#files-of-pytorch)"
            )
        return lambda *arguments: self._counted(_MAKERS[named](*arguments))

    def _counted(self, made: Any) -> Any:
        """The thing that was made; it counts to the limit of all that is made."""
        self.limit -= made.nbytes if isinstance(made, np.ndarray) else len(made) if hasattr(made, "__len__") else 0
        if self.limit < 0:
            raise pickle.UnpicklingError("it makes more than a file of its size may take")
        return made

    def load_build(self) -> None:
        state = self.stack.pop()  # type: ignore[attr-defined]
        built = self.stack[-1]  # type: ignore[attr-defined]
        if isinstance(built, _JoblibArray):
            self.stack[-1] = self._counted(self._joblib_array(state))  # type: ignore[attr-defined]
        elif isinstance(built, _Type):
            built.plain = built.plain.newbyteorder(state[1])
        elif isinstance(built, np.ndarray) and _type(state[2]).plain.hasobject:
            _, shape, _, _, objects = state
            if shape != () or built.size:
                raise pickle.UnpicklingError(
                    "an array of objects, which is not plain numbers or text; only a single dict or list is read"
                )
            self.stack[-1] = objects[0]  # type: ignore[attr-defined]
        elif isinstance(built, np.ndarray):
            _, shape, kind, fortran, data = state
            made = self._counted(_array(shape, kind, data))  # checked; the same array stays in the pickle's memory
            built.__setstate__((1, made.shape, made.dtype, bool(fortran), made.tobytes()))  # type: ignore[arg-type]
        else:
            raise pickle.UnpicklingError(f"the pickle wants to change a {type(built).__name__}, which no data needs")

    dispatch[pickle.BUILD[0]] = load_build

    def _joblib_array(self, state: dict[str, Any]) -> np.ndarray:
        """The bytes of an array, which follow its description in the stream."""
        head = _head(state["shape"], state["dtype"], self.limit)
        if state.get("numpy_array_alignment_bytes") is not None:
            self.stream.read(self.stream.read(1)[0])
        return _array(head.shape, head.dtype, self.stream.read(head.size), state["order"])

    def persistent_load(self, pid: Any) -> np.ndarray:
        """The numbers of a tensor: their type, the name of their file, the place they had, and their count."""
        _, kind, name, _, count, *_ = pid
        plain = kind if isinstance(kind, np.dtype) else _type(kind).plain
        data = self.storage(str(name), count * plain.itemsize)
        return self._counted(np.frombuffer(data, _head((count,), kind, len(data)).dtype, count))


def _head(shape: Any, kind: Any, limit: int, there: int | None = None) -> Head:
    """The checked head of an array.

    Raises:
        ValueError: it is not plain, larger than the limit and than what any file may take, or not of the bytes there.
    """
    head = Head(tuple(int(n) for n in shape), _type(kind).plain if not isinstance(kind, np.dtype) else kind)
    head.require(max(limit, LIMITS.free), there)
    return head


def _type(kind: Any, *_: Any) -> _Type:
    """The type of plain numbers or text by its name, as `<f8`."""
    if isinstance(kind, _Type):
        return kind
    if not (isinstance(kind, str) and re.fullmatch(rf"[<>|=]?[{PLAIN}]\d{{1,5}}|O8", kind)):
        raise pickle.UnpicklingError(f"an array of {one_line(repr(kind), 80)}, which is not plain numbers or text")
    return _Type(np.dtype(kind))


def _array(shape: Any, kind: Any, buffer: Any, order: Any = "C") -> np.ndarray:
    """An array over as many bytes as its head states."""
    data = _bytes(buffer)
    head = _head(shape, kind, len(data), len(data))
    return np.frombuffer(data, head.dtype).reshape(head.shape, order=order)


def _bare_array(_kind: Any, shape: Any, _letter: Any) -> np.ndarray:
    """The empty array with which NumPy's own pickles begin; its head and bytes follow."""
    if tuple(shape) != (0,):
        raise pickle.UnpicklingError("an array that begins with a size; NumPy begins it empty")
    return np.empty(0, "u1")


def _scalar(kind: Any, data: Any) -> Any:
    return _array((1,), kind, data)[0]


def _bytes(data: Any = b"") -> bytearray:
    if not isinstance(data, bytes | bytearray):
        raise pickle.UnpicklingError("bytes from something else than bytes")
    return bytearray(data)


def _latin(text: str, encoding: str) -> bytes:
    """Bytes as protocol 2 writes them."""
    return text.encode("latin-1" if encoding in ("latin1", "latin-1") else "ascii")


def _lone_storage(data: bytes) -> np.ndarray:
    """The numbers of a tensor that was pickled without `torch.save`: three values that are not needed, the description, a list
    of names, a count of 8 bytes, and the numbers.
    """
    reader = _DataUnpickler(data, len(data), lambda name, size: data[len(data) - size :])
    return [reader.load() for _ in range(4)][3]


def _tensor(storage: Any, offset: int, shape: Any, strides: Any, *_: Any) -> np.ndarray:
    """A view of a storage, copied; one that leaves the storage or is larger than the limit of a small file is refused."""
    head, strides = _head(shape, storage.dtype, storage.nbytes), tuple(int(n) for n in strides)
    if 0 in head.shape:
        return np.zeros(head.shape, head.dtype)
    last = offset + sum((n - 1) * step for n, step in zip(head.shape, strides, strict=True))
    if offset < 0 or min(strides, default=0) < 0 or last >= len(storage):
        raise pickle.UnpicklingError("a tensor that is larger than its storage")
    steps = tuple(step * storage.itemsize for step in strides)
    return np.lib.stride_tricks.as_strided(storage[offset:], head.shape, steps).copy()


_FORMER = {
    "__builtin__": "builtins",
    "numpy._core.multiarray": "numpy.core.multiarray",
    "numpy._core.numeric": "numpy.core.numeric",
}
"""Modules under the names that they have in other versions."""
_MAKERS: dict[tuple[str, str], Callable[..., Any]] = {
    ("numpy.core.multiarray", "_reconstruct"): _bare_array,
    ("numpy.core.multiarray", "scalar"): _scalar,
    ("numpy.core.numeric", "_frombuffer"): lambda buffer, kind, shape, order: _array(shape, kind, buffer, order),
    ("numpy", "ndarray"): _array,
    ("numpy", "dtype"): _type,
    ("torch._utils", "_rebuild_tensor_v2"): _tensor,
    ("torch.storage", "_load_from_bytes"): _lone_storage,
    ("_codecs", "encode"): _latin,
    ("builtins", "bytes"): lambda data=b"": bytes(_bytes(data)),
    ("builtins", "bytearray"): _bytes,
    ("collections", "OrderedDict"): OrderedDict,
    ("builtins", "list"): list,
    ("builtins", "dict"): dict,
    ("builtins", "set"): set,
    ("protomotions.simulator.base_simulator.simulator_state", "StateConversion"): lambda value: value,
}
"""All that a pickle may make; the word of an enumeration is its value."""
_STORAGES = {
    "DoubleStorage": "<f8",
    "FloatStorage": "<f4",
    "HalfStorage": "<f2",
    "LongStorage": "<i8",
    "IntStorage": "<i4",
    "ShortStorage": "<i2",
    "CharStorage": "i1",
    "ByteStorage": "u1",
    "BoolStorage": "?",
}
"""Types of the numbers in a file of PyTorch."""


_WRITTEN = {"f4": b"FloatStorage", "f8": b"DoubleStorage", "i8": b"LongStorage", "b1": b"BoolStorage"}
_FOLDER = "archive"


def dump_torch(path: Path, content: Mapping[str, np.ndarray | float]) -> None:
    """Write a dict of tensors and numbers that `torch.load` reads, also with `weights_only`."""
    program = b"\x80\x02}("
    with zipfile.ZipFile(path, "w", zipfile.ZIP_STORED) as archive:
        for k, (name, value) in enumerate(content.items()):
            if isinstance(value, np.ndarray):
                plain = np.ascontiguousarray(value)
                archive.writestr(f"{_FOLDER}/data/{k}", plain.tobytes())
                program += _text(name) + _tensor_program(str(k), plain)
            else:
                program += _text(name) + b"G" + struct.pack(">d", value)
        archive.writestr(f"{_FOLDER}/data.pkl", program + b"u.")
        archive.writestr(f"{_FOLDER}/byteorder", b"little")
        archive.writestr(f"{_FOLDER}/version", b"3\n")


def _tensor_program(key: str, values: np.ndarray) -> bytes:
    """Instructions that rebuild a tensor from its file, offset 0, shape, strides, no gradient and no hooks."""
    kind = b"ctorch\n" + _WRITTEN[values.dtype.str[1:]] + b"\n"
    storage = b"(" + _text("storage") + kind + _text(key) + _text("cpu") + _integer(values.size) + b"tQ"
    strides = tuple(step // values.itemsize for step in values.strides)
    hooks = b"ccollections\nOrderedDict\n)R"
    rest = _integer(0) + _integers(values.shape) + _integers(strides) + b"\x89" + hooks
    return b"ctorch._utils\n_rebuild_tensor_v2\n(" + storage + rest + b"tR"


def _text(value: str) -> bytes:
    return b"X" + struct.pack("<I", len(value.encode())) + value.encode()


def _integer(value: int) -> bytes:
    return b"J" + struct.pack("<i", value)


def _integers(values: tuple[int, ...]) -> bytes:
    return b"(" + b"".join(map(_integer, values)) + b"t"
