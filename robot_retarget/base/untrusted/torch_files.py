"""Files of PyTorch written without it: a zip of a pickle that describes tensors, and their numbers."""

import struct
import zipfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np

_STORAGES = {"f4": b"FloatStorage", "f8": b"DoubleStorage", "i8": b"LongStorage", "b1": b"BoolStorage"}
_FOLDER = "archive"


def dump_torch(path: Path, content: Mapping[str, np.ndarray | float]) -> None:
    """Write a dict of tensors and numbers that `torch.load` reads, also with `weights_only`."""
    program = b"\x80\x02}("
    with zipfile.ZipFile(path, "w", zipfile.ZIP_STORED) as archive:
        for k, (name, value) in enumerate(content.items()):
            if isinstance(value, np.ndarray):
                plain = np.ascontiguousarray(value)
                archive.writestr(f"{_FOLDER}/data/{k}", plain.tobytes())
                program += _text(name) + _tensor(str(k), plain)
            else:
                program += _text(name) + b"G" + struct.pack(">d", value)
        archive.writestr(f"{_FOLDER}/data.pkl", program + b"u.")
        archive.writestr(f"{_FOLDER}/byteorder", b"little")
        archive.writestr(f"{_FOLDER}/version", b"3\n")


def _tensor(key: str, values: np.ndarray) -> bytes:
    """Instructions that rebuild a tensor from its file, offset 0, shape, strides, no gradient and no hooks."""
    kind = b"ctorch\n" + _STORAGES[values.dtype.str[1:]] + b"\n"
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
