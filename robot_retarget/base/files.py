"""Write files whole: to a temporary file in the same folder, which then replaces the target.

A symbolic link keeps its place: the file that it names is replaced. Devices and pipes are written through.
"""

import csv
import io
import os
import shutil
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any

from robot_retarget.base.errors import OutputError

try:
    import fcntl
except ImportError:
    fcntl = None

LOCK = ".lock"
"""File of a folder that a process holds while it writes the others."""


@contextmanager
def replacing(path: str | Path, mode: int | None = None) -> Iterator[Path]:
    """Yield a temporary path with the target's suffix; move it over the target when the block ends well.

    The bytes are on the disk before the name is theirs: a power cut leaves the old file or the new one.

    Args:
        mode: The permissions of the file; by default those that the process gives to new files.

    Raises:
        OutputError: the folder does not exist or cannot be written, or the disk is full. The target is untouched.
    """
    target, through = Path(path), _is_special(path)
    scratch: Path | None = None
    try:
        place = tempfile.gettempdir() if through else _real(target).parent
        handle, name = tempfile.mkstemp(dir=place, prefix=f".{target.stem}-", suffix=target.suffix)
        os.close(handle)
        scratch = Path(name)
        yield scratch
        if through:
            with scratch.open("rb") as content, target.open("wb") as device:
                shutil.copyfileobj(content, device)
            return
        _to_disk(scratch)
        scratch.chmod(0o666 & ~_umask() if mode is None else mode)
        scratch.replace(_real(target))
    except BrokenPipeError:
        raise
    except OSError as error:
        raise OutputError(f"cannot write {target}: {error.strerror or error}") from error
    finally:
        if scratch is not None:
            scratch.unlink(missing_ok=True)


def write_text(path: str | Path, text: str) -> Path:
    """Write a text file whole, as `replacing` does, and return its path."""
    with replacing(path) as scratch:
        scratch.write_text(text, encoding="utf-8")
    return Path(path)


def write_csv(path: str | Path, columns: Sequence[str], rows: Iterable[Sequence[Any]]) -> Path:
    """Write a table with its heads whole, as `replacing` does, and return its path.

    A text that a spreadsheet would calculate (`=1+1`, `@SUM(1)`) stands behind an apostrophe.
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    for row in (columns, *rows):
        writer.writerow([plain_cell(cell) if isinstance(cell, str) else cell for cell in row])
    return write_text(path, text.getvalue())


def plain_cell(text: str) -> str:
    """Return text that a spreadsheet does not run as a formula: with an apostrophe before one."""
    return f"'{text}" if text.startswith(("=", "+", "-", "@", "\t", "\r")) else text


@contextmanager
def replacing_folder(path: str | Path) -> Iterator[Path]:
    """Yield a temporary folder; put it in the target's place when the block ends well.

    Raises:
        OutputError: as `replacing`, or something that is not an empty folder stands there already.
    """
    target = Path(path)
    scratch: Path | None = None
    try:
        scratch = Path(tempfile.mkdtemp(dir=target.parent, prefix=f".{target.name}-"))
        yield scratch
        scratch.chmod(0o777 & ~_umask())
        scratch.replace(target)
    except OSError as error:
        raise OutputError(f"cannot write {target}: {error.strerror or error}") from error
    finally:
        if scratch is not None and scratch.is_dir():
            shutil.rmtree(scratch)


def require_writable(path: str | Path) -> None:
    """Try out whether a file could be written, before long work is done for it.

    Raises:
        OutputError: The folder is missing or not writable, or the path is a folder.
    """
    target = Path(path)
    try:
        if target.is_dir():
            raise OutputError(f"cannot write {target}: it is a folder")
        if not _is_special(target):
            with tempfile.TemporaryFile(dir=_real(target).parent):
                pass
    except OSError as error:
        raise OutputError(f"cannot write {target}: {error.strerror or error}") from error


def require_suffix(path: str | Path, suffix: str, instead: str) -> None:
    """Require the suffix of the one format that is written.

    Raises:
        OutputError: the name ends otherwise; `instead` says what to do.
    """
    if Path(path).suffix.lower() != suffix:
        raise OutputError(f"cannot write {path}: its name has to end in {suffix}; {instead}")


def folder(path: str | Path) -> Path:
    """Make a folder that can be written, with its parents.

    Raises:
        OutputError: The folder cannot be made or written, or the path is a file.
    """
    target = Path(path)
    try:
        target.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=target):
            pass
    except OSError as error:
        raise OutputError(f"cannot make the folder {target}: {error.strerror or error}") from error
    return target


@contextmanager
def made_folder(path: str | Path) -> Iterator[Path]:
    """Make a folder, as `folder` does, and lock it; the folders that it made and that are empty after the block are removed.

    Raises:
        OutputError: as `folder`, or another process holds the folder.
    """
    target = Path(path)
    made = [one for one in (target / LOCK, target, *target.parents) if not one.exists()]  # noted before they are made
    try:
        with (folder(target) / LOCK).open("w") as lock:
            if not _locked(lock):
                made.clear()
                raise OutputError(f"another run is at work in {target}")
            try:
                yield target
            finally:
                (target / LOCK).unlink(missing_ok=True)
    finally:
        for one in made:
            with suppress(OSError):  # a folder with files stays
                one.rmdir() if one.is_dir() else one.unlink()


def _locked(lock: IO[str]) -> bool:
    """Lock an open file for this process, until it is closed; return whether it succeeds. On Windows it locks nothing."""
    if fcntl is None:
        return True
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    return os.fstat(lock.fileno()).st_nlink > 0  # the process before removed it


def _real(path: Path) -> Path:
    """The file that a symbolic link names; any other path itself."""
    return Path(os.path.realpath(path))


def _is_special(path: str | Path) -> bool:
    """Whether a path names a device, a pipe or a socket, which must not be replaced by a file."""
    return Path(path).exists() and not (Path(path).is_file() or Path(path).is_dir())


def _to_disk(path: Path) -> None:
    """Wait until the bytes of a file are on the disk."""
    with path.open("rb+") as file:
        os.fsync(file.fileno())


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


_PACKAGE = Path(__file__).resolve().parents[1]


def _shipped(folder: str) -> Path:
    inside = _PACKAGE / folder
    return inside if inside.is_dir() else _PACKAGE.parent / folder


MODELS = _shipped("models")
SAMPLES = _shipped("samples")
