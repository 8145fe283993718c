"""The user's cache of files that take long to make: always optional.

A file that is read without further checks must be whole and the user's own. The folder and the files must belong to the
user, and other users must not have write permission. A file must have the SHA-256 in the file next to it, in the format of
`sha256sum`. A file that fails a check is made again.
"""

import hashlib
import os
import stat
import time
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import accumulate
from pathlib import Path

from robot_retarget.base.files import folder, replacing

BUILD_PATIENCE = 600.0
"""Longest time in which a file is made [s]; older temporary files are left over from processes that were killed. The
largest function of the G1 is compiled in 4 s of a core, and in more than 60 s on a machine with much other work."""
OTHERS_WRITE = stat.S_IWGRP | stat.S_IWOTH
PRIVATE = stat.S_IRUSR | stat.S_IWUSR
"""Permissions of the files."""


def cache_folder() -> Path:
    """Return the folder: `$XDG_CACHE_HOME/robot-retarget` if that is an absolute path, else under `~/.cache`."""
    configured = Path(os.environ.get("XDG_CACHE_HOME", ""))
    return (configured if configured.is_absolute() else Path("~/.cache").expanduser()) / "robot-retarget"


def private_cache() -> Path:
    """Return the folder; create it if it is absent, and close it to other users.

    Raises:
        OSError: it belongs to another user.
        OutputError: it cannot be made or written.
    """
    path = cache_folder()
    if folder(path).stat().st_uid != _user():
        raise PermissionError(f"{path} belongs to another user")
    path.chmod(stat.S_IRWXU)
    return path


def is_sound(path: Path) -> bool:
    """Whether a file exists unchanged: the user owns it, and it matches the checksum in the file next to it."""
    checksum = _checksum_file(path)
    if not all(file.exists() and is_own(file) for file in (path, checksum)):
        return False
    return checksum.read_bytes() == _checksum(path).encode()


def is_own(path: Path) -> bool:
    """Whether this is a regular file, not a link, that belongs to this user and that other users cannot write."""
    found = path.lstat()
    return found.st_uid == _user() and stat.S_ISREG(found.st_mode) and not found.st_mode & OTHERS_WRITE


@contextmanager
def keeping(path: Path) -> Iterator[Path]:
    """Yield a temporary path; move it and its checksum to their places, because other processes may make the same file.

    Raises:
        OutputError: the folder cannot be written.
    """
    _sweep(path.parent)
    with replacing(path, mode=PRIVATE) as scratch:
        yield scratch
        with replacing(_checksum_file(path), mode=PRIVATE) as line:
            line.write_text(_checksum(scratch, path.name), encoding="ascii")


def drop_oldest(pattern: str, most: float) -> None:
    """Remove the oldest files of a pattern, with their checksums, until the others take at most `most` bytes."""
    files = sorted(cache_folder().glob(pattern), key=lambda file: file.stat().st_mtime_ns, reverse=True)
    sizes = accumulate(file.stat().st_size for file in files)
    for file in [file for file, total in zip(files, sizes, strict=True) if total > most]:
        _checksum_file(file).unlink(missing_ok=True)
        file.unlink(missing_ok=True)


def _user() -> int:
    """Return the user id that owns the files of this process; 0 on systems without file owners."""
    return getattr(os, "geteuid", int)()


def _checksum_file(path: Path) -> Path:
    """Return the file that holds a file's checksum."""
    return path.with_suffix(f"{path.suffix}.sha256")


def _checksum(path: Path, name: str | None = None) -> str:
    """Return the line that `sha256sum` prints for a file."""
    with path.open("rb") as file:
        return f"{hashlib.file_digest(file, 'sha256').hexdigest()}  {name or path.name}\n"


def _sweep(cache: Path) -> None:
    """Remove the temporary files of processes that were killed: none takes longer than `BUILD_PATIENCE`."""
    for scratch in cache.glob(".*"):
        if time.time() - scratch.stat().st_mtime > BUILD_PATIENCE:
            scratch.unlink(missing_ok=True)
