"""Machine code for CasADi functions: compiled once, kept in the user's cache, always optional.

The C code performs the operations of CasADi's virtual machine in the same order, so results agree to the last bit.
Without a compiler or a writable cache, the virtual machine evaluates the functions.

A library is loaded into this process, so it is checked first (`base.cache`). A library that fails a check is compiled again.

Building the expressions takes longer than loading their libraries. A file named by the key of the build (`build_key`)
lists these libraries, so a later process loads them without building.
"""

import atexit
import hashlib
import os
import platform
import re
import shutil
import signal
import subprocess
from collections.abc import Mapping, Sequence
from functools import cache, partial
from pathlib import Path

import casadi as ca
import numpy as np

from robot_retarget.base.cache import BUILD_PATIENCE, PRIVATE, cache_folder, is_own, is_sound, keeping, private_cache
from robot_retarget.base.errors import OutputError
from robot_retarget.base.files import replacing
from robot_retarget.graph.track import Track
from robot_retarget.human.match import Match
from robot_retarget.robot import Robot

FLAGS = ("-Og", "-fPIC", "-shared", "-ffp-contract=off")
"""Higher levels take longer to compile and run no faster; contracted products would change the rounding."""
LISTED = re.compile(r"([0-9a-f]{64}) (\w+)")
"""A library and its function, in the list of a build."""


def machine_code(function: ca.Function) -> ca.Function | None:
    """Compile the function with the C compiler `$CC`, by default `cc`, or load the cached library; return None if that fails."""
    library = library_of(function)
    return None if library is None else loaded(function.name(), library)


def library_of(function: ca.Function) -> Path | None:
    """Return the library of the function's machine code, compiled or cached; None if that fails."""
    compiler = shutil.which(os.environ.get("CC", "cc"))
    if compiler is None:
        return None
    try:
        library = private_cache() / f"{_digest(function, compiler)}.so"
        if not is_sound(library):
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
        lines = listing.read_text("ascii").splitlines() if is_own(listing) else []
        listed = [match.groups() for line in lines if (match := LISTED.fullmatch(line))]
        libraries = {name: cache_folder() / f"{digest}.so" for digest, name in listed}
        found = [loaded(name, library) for name, library in libraries.items() if is_sound(library)]
    except (OSError, ValueError):
        return None
    functions = [function for function in found if function is not None]
    return functions if lines and len(functions) == len(lines) else None


def _listing(key: str) -> Path:
    """Return the file that lists the libraries of a build."""
    return cache_folder() / f"{key}.libraries"


def _digest(function: ca.Function, compiler: str) -> str:
    """Return a hash of everything that determines the machine code."""
    made_by = (compiler, *FLAGS, platform.machine(), *platform.libc_ver(), ca.CasadiMeta.version())
    return hashlib.sha256("\n".join((function.serialize(), *made_by)).encode()).hexdigest()


def _compile(function: ca.Function, compiler: str, library: Path) -> None:
    """Write the library to a temporary file and rename it, because other processes may compile the same function."""
    code = ca.CodeGenerator(function.name())
    code.add(function)
    with keeping(library) as scratch:
        _run([compiler, *FLAGS, "-x", "c", "-", "-o", str(scratch), "-lm"], code.dump().encode())


def _run(command: list[str], text: bytes) -> None:
    """Run a compiler; end it and the processes that it started where it takes longer than `BUILD_PATIENCE`, or this process ends.

    Raises:
        SubprocessError: it fails, or takes longer.
    """
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=pipe, start_new_session=True) as running:
        end = partial(_end, running)
        atexit.register(end)
        try:
            running.communicate(text, timeout=BUILD_PATIENCE)
        finally:
            end()
            atexit.unregister(end)
    if running.returncode:
        raise subprocess.CalledProcessError(running.returncode, command)


def _end(running: "subprocess.Popen[bytes]") -> None:
    """End the group of a process that has not ended."""
    if running.returncode is None and hasattr(os, "killpg"):
        os.killpg(running.pid, signal.SIGKILL)


PACKAGE = Path(__file__).parents[1]
SOURCES = ("graph", "robot", "solver/problem.py")
"""The code that builds functions."""


def build_key(robot: Robot, match: Match, tracks: Sequence[Track]) -> str | None:
    """Return the key of the functions of tracks; None if a kind has code from outside the package.

    Measures depend on the robot's side of the match alone: the human is in the targets.
    """
    if not all(type(track.kind).__module__.startswith("robot_retarget.") for track in tracks):
        return None
    body = match.anatomy, match.keypoints, match.parents, match.robot_bones, match.rest, match.ankle_height
    with np.printoptions(override_repr=_exactly):
        text = repr((body, [_determining(track) for track in tracks]))
    made_by = _code(), ca.CasadiMeta.version(), _kinematics(robot), text
    return hashlib.sha256("\n".join(made_by).encode()).hexdigest()


def _exactly(array: np.ndarray) -> str:
    """Return the text of an array: all its bits, in a hundredth of the time that digits take."""
    return f"{array.dtype}{array.shape}{array.tobytes().hex()}"


def _determining(track: Track) -> tuple[object, ...]:
    """Return what determines the functions of a track; its targets are their parameters."""
    kind = type(track.kind).__qualname__, vars(track.kind)
    return kind, track.ends, track.axes, track.scale, track.huber_delta, track.exact


def _kinematics(robot: Robot) -> str:
    """Return a hash of bodies, joints and limits: meshes do not change functions, and they are large."""
    names = [name for name in sorted(dir(robot.model)) if name.startswith(("body_", "jnt_", "dof_", "qpos0"))]
    parts = [np.asarray(getattr(robot.model, name)) for name in names]
    return hashlib.sha256(b"".join(part.tobytes() for part in (*parts, robot.lower, robot.upper))).hexdigest()


@cache
def _code() -> str:
    """Return a hash of the code that builds functions."""
    files = [file for source in SOURCES for file in sorted((PACKAGE / source).rglob("*.py")) or [PACKAGE / source]]
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()
