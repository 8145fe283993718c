"""Files of PyTorch, read as data without PyTorch and without running code: a zip of one pickle and plain storages."""

import io
import pickle
from pathlib import Path
from typing import Any
from zipfile import ZipFile

import numpy as np

from robot_retarget.errors import MotionError
from robot_retarget.unpack import BROKEN, LARGEST
from robot_retarget.unpickle import DataUnpickler

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


def load_torch(path: Path) -> Any:
    """The contents of a `.pt` of PyTorch 1.6 or later, its tensors as arrays.

    Raises:
        MotionError: the file is missing or broken, or would make anything but tensors, numbers, text, lists and dicts.
    """
    try:
        with ZipFile(path) as archive:
            inside = {info.filename: info for info in archive.infolist()}
            if sum(info.file_size for info in inside.values()) > LARGEST:
                raise MotionError(f"larger than {LARGEST // 2**30} GB once it is unpacked", path)
            index = next((name for name in inside if name.endswith("data.pkl")), None)
            if index is None:
                raise MotionError(f"a zip without a pickle of PyTorch; it holds {', '.join(inside) or 'nothing'}", path)
            return _TorchUnpickler(archive, index).load()
    except pickle.UnpicklingError as error:
        raise MotionError(str(error), path) from error
    except (*BROKEN, ArithmeticError, AttributeError, LookupError, TypeError) as error:
        raise MotionError(f"broken file of PyTorch: {error}", path) from error


class _TorchUnpickler(DataUnpickler):
    """Builds arrays where PyTorch would build tensors."""

    def __init__(self, archive: ZipFile, index: str):
        super().__init__(io.BytesIO(archive.read(index)))
        self.archive, self.folder = archive, index.removesuffix("data.pkl")

    def find_class(self, module: str, name: str) -> Any:
        if module == "torch" and name in _STORAGES:
            return _STORAGES[name]
        if (module, name) == ("torch._utils", "_rebuild_tensor_v2"):
            return _tensor
        return super().find_class(module, name)

    def persistent_load(self, pid: Any) -> Any:
        """The numbers of a storage: its kind, the name of its file, and where it was."""
        _, dtype, name, _, count = pid
        data = self.archive.read(f"{self.folder}data/{name}")
        return np.frombuffer(data, dtype, int(count))


def _tensor(storage: Any, offset: int, shape: Any, strides: Any, *_: Any) -> np.ndarray:
    """A view of a storage, copied; one that leaves the storage is refused."""
    shape, strides = tuple(map(int, shape)), tuple(map(int, strides))
    if 0 in shape:
        return np.zeros(shape, storage.dtype)
    last = offset + sum((n - 1) * step for n, step in zip(shape, strides, strict=True))
    if offset < 0 or min(strides, default=0) < 0 or last >= len(storage):
        raise pickle.UnpicklingError("a tensor that is larger than its storage")
    steps = tuple(step * storage.itemsize for step in strides)
    return np.lib.stride_tricks.as_strided(storage[offset:], shape, steps).copy()
