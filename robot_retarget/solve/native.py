"""Machine code for CasADi functions: compiled once, kept in the user's cache, never needed.

The C code does what CasADi's virtual machine does, operation by operation, so that results agree to the last bit.
Where there is no compiler, or no place to keep what it makes, the virtual machine serves.
"""

import hashlib
import os
import platform
import shutil
import subprocess
from pathlib import Path

import casadi as ca

from robot_retarget.errors import OutputError
from robot_retarget.files import folder, replacing

FLAGS = ("-Og", "-fPIC", "-shared", "-ffp-contract=off")
"""Higher levels take longer to compile and run no faster; contracted products would round otherwise."""
PATIENCE = 60.0
"""A compiler that takes longer is given up [s]."""


def machine_code(function: ca.Function) -> ca.Function | None:
    """The function compiled by the C compiler `cc`, or what an earlier call made of it; None where that fails."""
    compiler = shutil.which("cc")
    if compiler is None:
        return None
    try:
        library = folder(_cache()) / f"{_digest(function, compiler)}.so"
        if not library.is_file():
            _compile(function, compiler, library)
        return ca.external(function.name(), str(library))
    except (OutputError, OSError, subprocess.SubprocessError, RuntimeError):
        return None


def _cache() -> Path:
    """Where libraries are kept."""
    return Path(os.environ.get("XDG_CACHE_HOME") or "~/.cache").expanduser() / "robot-retarget"


def _digest(function: ca.Function, compiler: str) -> str:
    """What the machine code depends on."""
    made_by = (compiler, *FLAGS, platform.machine(), *platform.libc_ver(), ca.__version__)
    return hashlib.sha256("\n".join((function.serialize(), *made_by)).encode()).hexdigest()


def _compile(function: ca.Function, compiler: str, library: Path) -> None:
    """Write the library beside its place and move it there whole: others may be compiling the same."""
    code = ca.CodeGenerator(function.name())
    code.add(function)
    with replacing(library) as scratch:
        command = [compiler, *FLAGS, "-x", "c", "-", "-o", str(scratch), "-lm"]
        subprocess.run(command, input=code.dump().encode(), check=True, capture_output=True, timeout=PATIENCE)
