"""The one table of limits of a file, the one way in which a broken file is refused, and bytes of packed files within the limits."""

import csv
import pickle
import struct
import tokenize
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

from robot_retarget.base.errors import FileError, install_line


@dataclass(frozen=True)
class FileLimits:
    """How much of a file is read, and how much it may become in memory."""

    file: int = 2 << 30
    """Size of a file on the disk, or of all members of a zip [bytes]: two hours of a humanoid of 30 bodies with all velocities at 50 frames per second."""
    free: int = 32 << 20
    """Size to which any file may unpack [bytes]: ten minutes of 25 joints, positions and quaternions, at 50 frames per second."""
    ratio: int = 32
    """Beyond `free`, how often its own size a file may take in memory [-]; motions pack 2 to 10 times."""
    depth: int = 64
    """Of lists and dicts in each other in a pickle; deeper ones are no data."""

    def unpacked(self, path: Path) -> int:
        """Return the size to which a file may unpack [bytes]."""
        return min(self.file, self.free + self.ratio * path.stat().st_size)


LIMITS = FileLimits()
BROKEN = (
    ArithmeticError,
    AttributeError,
    EOFError,
    LookupError,
    MemoryError,
    RuntimeError,
    TypeError,
    ValueError,
    csv.Error,
    struct.error,
    tokenize.TokenError,
    zipfile.BadZipFile,
    zlib.error,
)
"""Errors of readers of Python and NumPy at unexpected bytes."""


@contextmanager
def refusing(path: Path, what: str) -> Iterator[None]:
    """Turn every error of a reader at a file into one error.

    Raises:
        FileError: the file cannot be read, or is no `what`.
    """
    try:
        yield
    except FileError as error:
        raise (error if str(path) in str(error) else FileError(f"{path}: {error}")) from error.__cause__
    except OSError as error:
        raise FileError(f"cannot read {path}: {error.strerror or error}") from error
    except pickle.UnpicklingError as error:
        raise FileError(f"{path}: {one_line(str(error))}") from error
    except BROKEN as error:
        raise FileError(f"{path}: not a readable {what}: {one_line(str(error) or type(error).__name__)}") from error


def one_line(text: str, length: int = 300) -> str:
    """Return text of a file as it may be printed: one line of limited length, without control characters."""
    plain = "".join(c if c.isprintable() else " " for c in text[: length + 1])
    return plain[:length] + ("…" if len(plain) > length else "")


def too_large(path: Path, limit: int) -> FileError:
    """Return the error about a file that would unpack to more than its limit [bytes]."""
    return FileError(f"{path}: unpacks to more than {limit} bytes; a motion of this file size is not that large")


def require_tree(value: Any, elements: int, limit: int = LIMITS.free) -> None:
    """Require that a value is as large as its file says when it is written out: nothing in itself, no part many times.

    Args:
        elements: most elements that lists and dicts may have together, the length of the file.
        limit: largest size of its arrays [bytes].

    Raises:
        ValueError: it has more elements or bytes, is nested too deeply, or holds an integer of more than 64 bits.
    """
    left, elements = [(value, 0)], elements + 1
    while left:
        one, depth = left.pop()
        elements -= 1
        limit -= getattr(one, "nbytes", 0)
        if elements < 0 or limit < 0 or depth > LIMITS.depth:
            raise ValueError("lists and dicts that hold themselves, or the same part many times")
        if isinstance(one, Mapping):
            left += [(part, depth + 1) for pair in one.items() for part in pair]
        elif isinstance(one, list | tuple | set | frozenset):
            left += [(part, depth + 1) for part in one]
        elif isinstance(one, int) and one.bit_length() > 64:
            raise ValueError(f"an integer of {one.bit_length()} bits")


LZ4_MAGIC, GZIP_MAGIC = b"\x04\x22\x4d\x18", b"\x1f\x8b"
ZLIB_MAGIC = (b"x\x01", b"x\x5e", b"x\x9c", b"x\xda")
_ANY_ZLIB = 47
"""Window bits for gzip and zlib alike."""
_CHUNK = 1 << 20
_BOUNDED = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
"""Compressions of a zip that Python unpacks piece by piece; the others it unpacks whole."""


def file_bytes(path: Path) -> bytes:
    """Read a file whole.

    Raises:
        FileError: it cannot be read, or is larger than `LIMITS.file`.
    """
    with refusing(path, "file"):
        if (size := path.stat().st_size) > LIMITS.file:
            raise FileError(f"{path}: {size} bytes, more than {LIMITS.file}")
        return path.read_bytes()


def unpacked(path: Path) -> bytes:
    """Read a file whole, decompressed if it is compressed by lz4, gzip or zlib.

    Raises:
        FileError: it cannot be read, is cut short or broken, or unpacks to more than its limit.
    """
    data, limit = file_bytes(path), LIMITS.unpacked(path)
    if not data.startswith((LZ4_MAGIC, GZIP_MAGIC, *ZLIB_MAGIC)):
        return data
    with refusing(path, "compressed file"):
        engine = _lz4().frame.LZ4FrameDecompressor() if data.startswith(LZ4_MAGIC) else zlib.decompressobj(_ANY_ZLIB)
        plain = engine.decompress(data, limit)
        if len(plain) >= limit:
            raise too_large(path, limit)
        if not engine.eof:
            raise EOFError("it is cut short")
        return plain


def lz4_packed(data: bytes) -> bytes:
    """Pack bytes as an lz4 frame (extra `formats`)."""
    return _lz4().frame.compress(data)


def is_zip(path: Path) -> bool:
    """Return whether a file begins as a zip does."""
    with refusing(path, "file"), path.open("rb") as file:
        return file.read(2) == b"PK"


@contextmanager
def opened_zip(path: Path, what: str = "zip") -> Iterator[zipfile.ZipFile]:
    """Open a zip whose members are read one by one.

    Raises:
        FileError: it is no zip, all members together are larger than `LIMITS.file`, or its bytes are broken.
    """
    with refusing(path, what), zipfile.ZipFile(path) as archive:
        if sum(member.file_size for member in archive.infolist()) > LIMITS.file:
            raise too_large(path, LIMITS.file)
        yield archive


def zip_names(path: Path) -> tuple[str, ...]:
    """Return the names of the members of a zip; empty for any other file."""
    try:
        with opened_zip(path) as archive:
            return tuple(archive.namelist())
    except FileError:
        return ()


@contextmanager
def opened_member(archive: zipfile.ZipFile, name: str) -> Iterator[IO[bytes]]:
    """Open a member of a zip; read it in pieces, its stated size may be wrong.

    Raises:
        ValueError: it is compressed in a way that cannot be unpacked in pieces.
    """
    if (kind := archive.getinfo(name).compress_type) not in _BOUNDED:
        raise ValueError(f"{name} has the compression {kind}; deflate it")
    with archive.open(name) as member:
        yield member


def member_bytes(archive: zipfile.ZipFile, name: str, path: Path) -> bytes:
    """Read a member of a zip whole.

    Raises:
        FileError: it unpacks to more than the limit of the file.
    """
    data, limit = bytearray(), LIMITS.unpacked(path)
    with opened_member(archive, name) as member:
        while piece := member.read(_CHUNK):
            data += piece
            if len(data) > limit:
                raise too_large(path, limit)
    return bytes(data)


def _lz4() -> Any:
    try:
        import lz4.frame
    except ImportError:
        raise FileError(f"lz4 files need lz4: {install_line('formats')}") from None
    return lz4
