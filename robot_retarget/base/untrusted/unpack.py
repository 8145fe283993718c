"""The bytes of a file: plain, compressed by gzip, zlib or lz4, or a member of a zip, each within the file's limit."""

import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

from robot_retarget.base.errors import FileError, install_line
from robot_retarget.base.untrusted.limits import LIMITS, refusing, too_large

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
