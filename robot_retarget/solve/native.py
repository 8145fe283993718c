"""Machine code for CasADi functions: compiled once, kept in the user's cache, always optional.

The C code performs the operations of CasADi's virtual machine in the same order, so results agree to the last bit.
Without a compiler or a writable cache, the virtual machine evaluates the functions.

A library is loaded into this process, so it is checked first. The folder and the files must belong to the user, and
other users must not have write permission. The library must have the SHA-256 in the file next to it, in the format of
`sha256sum`. A library that fails a check is compiled again.

Building the expressions takes longer than loading their libraries. A file named by the key of the build (`build_key.py`)
lists these libraries, so a later process loads them without building.
"""

import hashlib
import os
import platform
import re
import shutil
import stat
import subprocess
import time
from collections.abc import Mapping
from pathlib import Path

import casadi as ca

from robot_retarget.errors import OutputError
from robot_retarget.files import folder, replacing

FLAGS = ("-Og", "-fPIC", "-shared", "-ffp-contract=off")
"""Higher levels take longer to compile and run no faster; contracted products would change the rounding."""
PATIENCE = 60.0
"""Time limit of the compiler [s]."""
OTHERS_WRITE = stat.S_IWGRP | stat.S_IWOTH
PRIVATE = stat.S_IRUSR | stat.S_IWUSR
"""Permissions of the kept files."""
LISTED = re.compile(r"([0-9a-f]{64}) (\w+)")
"""A library and its function, in the list of a build."""


def machine_code(function: ca.Function) -> ca.Function | None:
    """Compile the function with the C compiler `cc`, or load the cached library; return None if that fails."""
    library = library_of(function)
    return None if library is None else loaded(function.name(), library)


def library_of(function: ca.Function) -> Path | None:
    """Return the library of the function's machine code, compiled with `cc` or cached; None if that fails."""
    compiler = shutil.which("cc")
    if compiler is None:
        return None
    try:
        library = _private(_cache()) / f"{_digest(function, compiler)}.so"
        if not _sound(library):
            _compile(function, compiler, library)
        return library
    except (OutputError, OSError, subprocess.SubprocessError):
        return None


def loaded(name: str, library: Path) -> ca.Function | None:
    """Load a function of a library; return None if the library has none."""
    try:
        return ca.external(name, str(library))
    except RuntimeError:
        return None


def remember(key: str, libraries: Mapping[str, Path]) -> None:
    """List the libraries of a build with this key, by the names of their functions, if the cache is writable."""
    try:
        with replacing(_listing(key), mode=PRIVATE) as scratch:
            scratch.write_text("\n".join(f"{library.stem} {name}" for name, library in libraries.items()), "ascii")
    except (OutputError, OSError):
        return


def remembered(key: str) -> list[ca.Function] | None:
    """Load the functions of a build with this key; return None if a library is missing or fails a check."""
    listing = _listing(key)
    try:
        lines = listing.read_text("ascii").splitlines() if _ours(listing) else []
        listed = [match.groups() for line in lines if (match := LISTED.fullmatch(line))]
        libraries = {name: _cache() / f"{digest}.so" for digest, name in listed}
        found = [loaded(name, library) for name, library in libraries.items() if _sound(library)]
    except (OSError, ValueError):
        return None
    functions = [function for function in found if function is not None]
    return functions if lines and len(functions) == len(lines) else None


def _listing(key: str) -> Path:
    """Return the file that lists the libraries of a build."""
    return _cache() / f"{key}.libraries"


def _cache() -> Path:
    """Return the folder of the libraries: `$XDG_CACHE_HOME` if it is an absolute path, else `~/.cache`."""
    configured = Path(os.environ.get("XDG_CACHE_HOME", ""))
    return (configured if configured.is_absolute() else Path("~/.cache").expanduser()) / "robot-retarget"


def _private(path: Path) -> Path:
    """Create the folder if it is absent, and close it to other users.

    Raises:
        OSError: it belongs to another user.
    """
    if folder(path).stat().st_uid != _user():
        raise PermissionError(f"{path} belongs to another user")
    path.chmod(stat.S_IRWXU)
    return path


def _sound(library: Path) -> bool:
    """Whether a library exists unchanged: the user owns it, and it matches the checksum in the file next to it."""
    checksum = _checksum_file(library)
    if not all(path.exists() and _ours(path) for path in (library, checksum)):
        return False
    return checksum.read_bytes() == _checksum(library.read_bytes(), library).encode()


def _ours(path: Path) -> bool:
    """Whether this is a regular file, not a link, that belongs to this user and that other users cannot write."""
    found = path.lstat()
    return found.st_uid == _user() and stat.S_ISREG(found.st_mode) and not found.st_mode & OTHERS_WRITE


def _user() -> int:
    """Return the user id that owns the files of this process; 0 on systems without file owners."""
    return getattr(os, "geteuid", int)()


def _checksum_file(library: Path) -> Path:
    """Return the file that holds a library's checksum."""
    return library.with_suffix(".so.sha256")


def _checksum(content: bytes, library: Path) -> str:
    """Return the line that `sha256sum` prints for a library."""
    return f"{hashlib.sha256(content).hexdigest()}  {library.name}\n"


def _digest(function: ca.Function, compiler: str) -> str:
    """Return a hash of everything that determines the machine code."""
    made_by = (compiler, *FLAGS, platform.machine(), *platform.libc_ver(), ca.CasadiMeta.version())
    return hashlib.sha256("\n".join((function.serialize(), *made_by)).encode()).hexdigest()


def _compile(function: ca.Function, compiler: str, library: Path) -> None:
    """Write the library to a temporary file and rename it, because other processes may compile the same function."""
    _sweep(library.parent)
    code = ca.CodeGenerator(function.name())
    code.add(function)
    with replacing(library, mode=PRIVATE) as scratch:
        command = [compiler, *FLAGS, "-x", "c", "-", "-o", str(scratch), "-lm"]
        subprocess.run(command, input=code.dump().encode(), check=True, capture_output=True, timeout=PATIENCE)
        with replacing(_checksum_file(library), mode=PRIVATE) as line:
            line.write_text(_checksum(scratch.read_bytes(), library), encoding="ascii")


def _sweep(cache: Path) -> None:
    """Remove the temporary files of builds that were killed: no build takes longer than `PATIENCE`."""
    for scratch in cache.glob(".*"):
        if time.time() - scratch.stat().st_mtime > PATIENCE:
            scratch.unlink(missing_ok=True)
