"""Machine code for CasADi functions: compiled once, kept in the user's cache, never needed.

The C code does what CasADi's virtual machine does, operation by operation, so that results agree to the last bit.
Where there is no compiler, or no place to keep what it makes, the virtual machine serves.

A library is loaded into this process, so it is checked first: the folder and the files belong to the user and nobody
else may write them, and the library has the SHA-256 that stands beside it, in the format of `sha256sum`. What fails is
compiled anew.
"""

import hashlib
import os
import platform
import shutil
import stat
import subprocess
from pathlib import Path

import casadi as ca

from robot_retarget.errors import OutputError
from robot_retarget.files import folder, replacing

FLAGS = ("-Og", "-fPIC", "-shared", "-ffp-contract=off")
"""Higher levels take longer to compile and run no faster; contracted products would round otherwise."""
PATIENCE = 60.0
"""A compiler that takes longer is given up [s]."""
OTHERS_WRITE = stat.S_IWGRP | stat.S_IWOTH
PRIVATE = stat.S_IRUSR | stat.S_IWUSR
"""Permissions of what is kept."""


def machine_code(function: ca.Function) -> ca.Function | None:
    """The function compiled by the C compiler `cc`, or what an earlier call made of it; None where that fails."""
    compiler = shutil.which("cc")
    if compiler is None:
        return None
    try:
        library = _private(_cache()) / f"{_digest(function, compiler)}.so"
        if not _sound(library):
            _compile(function, compiler, library)
        return ca.external(function.name(), str(library))
    except (OutputError, OSError, subprocess.SubprocessError, RuntimeError):
        return None


def _cache() -> Path:
    """Where libraries are kept: `$XDG_CACHE_HOME`, which counts only if it is absolute, else `~/.cache`."""
    wished = Path(os.environ.get("XDG_CACHE_HOME", ""))
    return (wished if wished.is_absolute() else Path("~/.cache").expanduser()) / "robot-retarget"


def _private(path: Path) -> Path:
    """The folder, made where it is not there, and closed to others.

    Raises:
        OSError: it belongs to another user.
    """
    if folder(path).stat().st_uid != _user():
        raise PermissionError(f"{path} belongs to another user")
    path.chmod(stat.S_IRWXU)
    return path


def _sound(library: Path) -> bool:
    """Whether a library is there as it was compiled: the user's own, with the checksum that stands beside it."""
    checksum = _beside(library)
    if not all(path.exists() and _ours(path) for path in (library, checksum)):
        return False
    return checksum.read_bytes() == _checksum(library.read_bytes(), library).encode()


def _ours(path: Path) -> bool:
    """Whether a plain file, and no link, belongs to this user and nobody else may write it."""
    found = path.lstat()
    return found.st_uid == _user() and stat.S_ISREG(found.st_mode) and not found.st_mode & OTHERS_WRITE


def _user() -> int:
    """Whose the files are that this process makes; 0 where files have no owner."""
    return getattr(os, "geteuid", int)()


def _beside(library: Path) -> Path:
    """The file that holds a library's checksum."""
    return library.with_suffix(".so.sha256")


def _checksum(content: bytes, library: Path) -> str:
    """The line that `sha256sum` prints of a library."""
    return f"{hashlib.sha256(content).hexdigest()}  {library.name}\n"


def _digest(function: ca.Function, compiler: str) -> str:
    """What the machine code depends on."""
    made_by = (compiler, *FLAGS, platform.machine(), *platform.libc_ver(), ca.__version__)
    return hashlib.sha256("\n".join((function.serialize(), *made_by)).encode()).hexdigest()


def _compile(function: ca.Function, compiler: str, library: Path) -> None:
    """Write the library beside its place and move it there whole: others may be compiling the same."""
    code = ca.CodeGenerator(function.name())
    code.add(function)
    with replacing(library, mode=PRIVATE) as scratch:
        command = [compiler, *FLAGS, "-x", "c", "-", "-o", str(scratch), "-lm"]
        subprocess.run(command, input=code.dump().encode(), check=True, capture_output=True, timeout=PATIENCE)
        with replacing(_beside(library), mode=PRIVATE) as line:
            line.write_text(_checksum(scratch.read_bytes(), library), encoding="ascii")
