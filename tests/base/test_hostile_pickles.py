"""A pickle makes data of about its own size, or nothing: no pointer, no code, no memory beyond its limit, no endless walk."""

import pickle
import resource
import struct
import time
import tracemalloc
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from robot_retarget.base.errors import FileError
from robot_retarget.base.untrusted.limits import LIMITS
from robot_retarget.base.untrusted.pickles import load_pickle

POINTER = struct.pack("<Q", 0xDEAD_BEEF_0000)
"""Where an array of objects would look for its first object."""


class Call:
    """In a pickle, the call of a function by its name."""

    def __init__(self, name: str, *arguments: Any):
        self.name, self.arguments = name, arguments


class Program(pickle._Pickler):
    """Writes calls of functions that need not exist here."""

    def save(self, obj: Any, save_persistent_id: bool = True) -> None:
        if not isinstance(obj, Call):
            return super().save(obj, save_persistent_id)  # pyright: ignore[reportAttributeAccessIssue]
        self.write(b"c" + "\n".join(obj.name.rsplit(".", 1)).encode() + b"\n")  # pyright: ignore[reportAttributeAccessIssue]
        self.save(obj.arguments)
        self.write(pickle.REDUCE)  # pyright: ignore[reportAttributeAccessIssue]


def program(path: Path, value: Any) -> Path:
    with path.open("wb") as stream:
        Program(stream, protocol=4).dump(value)
    return path


def array(shape: Any, kind: Any, data: bytes) -> Call:
    return Call("numpy.ndarray", shape, kind, data)


def built(state: bytes) -> bytes:
    """The pickle that NumPy writes of an array of one object, its bytes in place of the object."""
    plain = pickle.dumps(np.array([0], "i8"), 2)
    assert b"i8" in plain
    return plain.replace(b"i8", b"O8")


POINTERS = {
    "ndarray": array((1,), "|O", POINTER),
    "byte order": array((1,), "<O8", POINTER),
    "dtype": array((1,), Call("numpy.dtype", "O", False, True), POINTER),
    "frombuffer": Call("numpy.core.numeric._frombuffer", POINTER, "|O", (1,), "C"),
    "scalar": Call("numpy.core.multiarray.scalar", "|O", POINTER),
    "record": array((1,), [("a", "O")], POINTER),
    "text of a record": array((1,), "O,O", POINTER * 2),
    "subarray": array((1,), "(1,)O", POINTER),
    "void": array((1,), "V8", POINTER),
    "strides": Call("numpy.ndarray", (1,), "<f8", POINTER, 0, (1 << 40,)),
    "offset": Call("numpy.ndarray", (1,), "<f8", POINTER, 1 << 40),
    "no size": array((1 << 40,), "U0", b""),
    "empty but endless": array((1 << 40, 0), "<f8", b""),
    "negative": array((-1,), "<f8", b""),
}


@pytest.mark.parametrize("name", POINTERS)
def test_an_array_of_anything_but_plain_numbers_of_the_stated_size_is_refused(name: str, tmp_path: Path) -> None:
    path = program(tmp_path / "a.pkl", {"fps": POINTERS[name]})
    with pytest.raises(FileError, match=r"a\.pkl"):
        load_pickle(path)


def test_the_array_that_numpy_itself_writes_is_no_way_to_objects(tmp_path: Path) -> None:
    (tmp_path / "a.pkl").write_bytes(built(POINTER))
    with pytest.raises(FileError, match="not plain numbers"):
        load_pickle(tmp_path / "a.pkl")


def test_big_endian_arrays_keep_their_numbers(tmp_path: Path) -> None:
    twice = np.arange(3.0).astype(">f8")
    (tmp_path / "a.pkl").write_bytes(pickle.dumps([twice, twice + 1]))
    read = load_pickle(tmp_path / "a.pkl")
    assert [one.tolist() for one in read] == [[0, 1, 2], [1, 2, 3]]


def torch_file(path: Path, shape: Any, strides: Any, offset: int = 0, kind: str = "<f4", count: int = 3) -> Path:
    """A `.pt` of one tensor over a storage of three numbers."""

    class Torch(Program):
        def persistent_id(self, obj: Any) -> Any:
            return ("storage", kind, "0", "cpu", count) if obj is storage else None

    storage = object()
    stream = path.with_suffix(".tmp").open("wb+")
    Torch(stream, protocol=2).dump(Call("torch._utils._rebuild_tensor_v2", storage, offset, shape, strides))
    stream.seek(0)
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("a/data.pkl", stream.read())
        archive.writestr("a/data/0", np.arange(3, dtype="<f4").tobytes())
    return path


@pytest.mark.parametrize(
    "tensor",
    [
        {"shape": (1 << 14, 1 << 14), "strides": (0, 0)},
        {"shape": (1 << 60,), "strides": (0,)},
        {"shape": (1 << 40, 0), "strides": (0, 0)},
        {"shape": (2,), "strides": (-1,)},
        {"shape": (2,), "strides": (3,)},
        {"shape": (1,), "strides": (1,), "offset": -1},
        {"shape": (1,), "strides": (1,), "kind": "|O"},
        {"shape": (1,), "strides": (1,), "count": 1 << 40},
    ],
)
def test_a_tensor_beyond_its_storage_or_of_no_size_of_its_own_is_refused(tensor: Any, tmp_path: Path) -> None:
    path = torch_file(tmp_path / "a.pt", **tensor)
    with pytest.raises(FileError, match=r"a\.pt"):
        load_pickle(path)


def test_a_tensor_is_read_as_its_strides_say(tmp_path: Path) -> None:
    np.testing.assert_array_equal(load_pickle(torch_file(tmp_path / "a.pt", (2, 2), (0, 1), 1)), [[1, 2], [1, 2]])


def laughs(levels: int) -> Any:
    """A list of 2^levels numbers that a few bytes describe."""
    value: Any = [1]
    for _ in range(levels):
        value = [value, value]
    return value


def itself() -> Any:
    value: dict[str, Any] = {}
    value["a"] = value
    return value


def nested(levels: int) -> bytes:
    return b"\x80\x04" + b"]" * levels + b"a" * (levels - 1) + b"."


def copies() -> Any:
    """Arrays of a megabyte, each made anew of the same bytes."""
    data = bytes(1 << 20)
    return [array((1 << 20,), "u1", data) for _ in range(1 << 10)]


def shared() -> Any:
    data = np.zeros(1 << 17)
    return [data] * (1 << 14)


AMPLIFIED = {
    "laughs": laughs(40),
    "itself": itself(),
    "copies": copies(),
    "shared arrays": shared(),
    "integer": 10**400,
    "key": {(10**400,): 1},
}


@pytest.mark.parametrize("name", [*AMPLIFIED, "nested"])
def test_what_is_larger_than_its_file_says_is_refused_at_once(name: str, tmp_path: Path) -> None:
    if name == "nested":
        path = tmp_path / "a.pkl"
        path.write_bytes(nested(100_000))
    else:
        path = program(tmp_path / "a.pkl", AMPLIFIED[name])
    tracemalloc.start()
    began = time.process_time()
    with pytest.raises(FileError, match=r"a\.pkl"):
        load_pickle(path)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert time.process_time() - began < 5 and peak < 8 * LIMITS.free


@pytest.mark.parametrize("module", ["\x1b[2Jos", "a\nb", "x" * 10_000])
def test_the_message_about_a_name_is_one_short_line(module: str, tmp_path: Path) -> None:
    named = b"\x8d" + struct.pack("<Q", len(module)) + module.encode() + b"\x8c\x01a\x93."
    (tmp_path / "a.pkl").write_bytes(b"\x80\x04" + named)
    with pytest.raises(FileError) as refused:
        load_pickle(tmp_path / "a.pkl")
    assert str(refused.value).isprintable() and len(str(refused.value)) < 500


def test_a_zip_whose_member_is_larger_than_its_directory_says_takes_no_memory(tmp_path: Path) -> None:
    """The directory states 100 bytes, the member unpacks to 256 MB."""
    path = tmp_path / "a.pt"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("a/data.pkl", bytes(1 << 28))
    data = path.read_bytes().replace(struct.pack("<I", 1 << 28), struct.pack("<I", 100))
    path.write_bytes(data)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(FileError, match=r"a\.pt"):
        load_pickle(path)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 100_000


@pytest.mark.parametrize("kind", [zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
def test_members_that_cannot_be_unpacked_in_pieces_are_refused(kind: int, tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "a.pt", "w", kind) as archive:
        archive.writestr("a/data.pkl", pickle.dumps({"fps": 30}))
    with pytest.raises(FileError, match="deflate it"):
        load_pickle(tmp_path / "a.pt")
