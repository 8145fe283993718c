"""The container of glTF 2.0: its JSON, and the numbers that accessors point at in its buffers.

The JSON is read as plain values: with libraries that wrap every object in a class, reading a file of 75
animations takes 14 s.
"""

import base64
import binascii
import struct
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from robot_retarget.base.arrays import Floats
from robot_retarget.base.errors import MotionError
from robot_retarget.base.untrusted.documents import parse_json

_MAGIC, _JSON, _BIN = b"glTF", 0x4E4F534A, 0x004E4942
_COMPONENTS = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}
"""Numbers of each type of element in the format."""


@dataclass(frozen=True)
class GltfFile:
    """The file's JSON and, of a GLB, its binary chunk."""

    path: Path
    content: Mapping[str, Any]
    binary: bytes

    @classmethod
    def of(cls, path: Path) -> "GltfFile":
        """Read a `.gltf` or a `.glb`, under any name.

        Raises:
            MotionError: truncated, no JSON, or of another version.
        """
        data = path.read_bytes()
        text, binary = _chunks(data, path) if data.startswith(_MAGIC) else (data, b"")
        try:
            content = parse_json(text.decode("utf-8-sig"), path, MotionError)
        except UnicodeDecodeError as error:
            raise MotionError(f"its JSON cannot be read: {error}", path) from error
        asset = content.get("asset") if isinstance(content, dict) else None
        version = asset.get("version", "none") if isinstance(asset, dict) else "none"
        if not str(version).startswith("2"):
            raise MotionError(f"asset.version: expected glTF 2.0, found {version}", path)
        return cls(path, content, binary)

    def listed(self, key: str) -> list[Any]:
        """A list of the JSON; empty if absent."""
        found = self.content.get(key, [])
        if not isinstance(found, list):
            raise self.error(key, "expected a list")
        return found

    def extension(self, name: str) -> dict[str, Any]:
        """The content of an extension for the whole file; empty if absent."""
        return self.content.get("extensions", {}).get(name, {})

    def numbers(self, index: Any, what: str) -> Floats:
        """(N, width) of an accessor; integers are normalised to −1 … 1.

        Raises:
            MotionError: the accessor is not there, points outside its buffer, or is compressed or sparse.
        """
        accessor = self._at("accessors", index, what)
        where = f"accessors[{index}] ({what})"
        if "sparse" in accessor or "bufferView" not in accessor:
            raise self.error(where, "sparse accessors are not read")
        view = self._at("bufferViews", accessor["bufferView"], where)
        if view.get("extensions"):
            raise self.error(where, f"compressed by {', '.join(view['extensions'])}; expected plain buffers")
        dtype, width = _COMPONENTS.get(accessor.get("componentType", 0)), _WIDTHS.get(accessor.get("type", ""))
        if dtype is None or width is None:
            raise self.error(where, f"expected numbers of {', '.join(_WIDTHS)}, found {accessor.get('type')}")
        values = self._strided(view, accessor, np.dtype(dtype), width, where)
        return _real(values)

    def _strided(self, view: Any, accessor: Any, dtype: np.dtype[Any], width: int, where: str) -> np.ndarray:
        size = dtype.itemsize * width
        count, stride = int(accessor.get("count", 0)), int(view.get("byteStride", 0)) or size
        start = int(view.get("byteOffset", 0)) + int(accessor.get("byteOffset", 0))
        buffer = self._buffers[view.get("buffer", 0)] if view.get("buffer", 0) < len(self._buffers) else b""
        if count < 1 or start + (count - 1) * stride + size > len(buffer):
            raise self.error(where, f"{count} values from byte {start} on do not fit its buffer of {len(buffer)} bytes")
        return np.ndarray((count, width), dtype, buffer, start, (stride, dtype.itemsize)).copy()

    def _at(self, key: str, index: Any, what: str) -> dict[str, Any]:
        found = self.listed(key)
        if not isinstance(index, int) or not 0 <= index < len(found) or not isinstance(found[index], dict):
            raise self.error(what, f"{key}[{index}] is not there")
        return found[index]

    @cached_property
    def _buffers(self) -> list[bytes]:
        return [self._buffer(buffer.get("uri"), k) for k, buffer in enumerate(self.listed("buffers"))]

    def _buffer(self, uri: str | None, index: int) -> bytes:
        """The GLB's binary chunk, data in the JSON, or a file next to this one."""
        if uri is None:
            return self.binary
        if uri.startswith("data:"):
            try:
                return base64.b64decode(uri.partition(",")[2], validate=True)
            except binascii.Error as error:
                raise self.error(f"buffers[{index}].uri", f"not base64: {error}") from error
        beside = (self.path.parent / uri).resolve()
        if not beside.is_relative_to(self.path.parent.resolve()) or not beside.is_file():
            raise self.error(f"buffers[{index}].uri", f"expected the file {uri!r} next to it")
        return beside.read_bytes()

    def error(self, where: str, message: str) -> MotionError:
        """An error of this file that names the field."""
        return MotionError(f"{where}: {message}", self.path)


def _chunks(data: bytes, path: Path) -> tuple[bytes, bytes]:
    """The JSON and the binary chunk of a GLB."""
    found: dict[int, bytes] = {}
    at = 12
    while at + 8 <= len(data):
        length, kind = struct.unpack_from("<II", data, at)
        found.setdefault(kind, data[at + 8 : at + 8 + length])
        if at + 8 + length > len(data):
            raise MotionError(f"truncated: a chunk of {length} bytes, {len(data) - at - 8} are present", path)
        at += 8 + length
    if _JSON not in found:
        raise MotionError("a GLB without its JSON chunk", path)
    return found[_JSON], found.get(_BIN, b"")


def _real(values: np.ndarray) -> Floats:
    """Integers are normalised by their largest value."""
    if values.dtype.kind == "f":
        return values.astype(float)
    return np.maximum(values / np.iinfo(values.dtype).max, -1.0)
