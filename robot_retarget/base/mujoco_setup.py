"""What has to hold before MuJoCo is imported: a version that gives right results, and a back end that exists."""

import ctypes.util
import os
import platform
import warnings
from importlib.metadata import PackageNotFoundError, version

from robot_retarget.base.errors import RobotError

OLDEST = (3, 12)
WRONG = {
    "3.11.0": "it finds no distance between one pair of separate boxes in thirty",
}
"""Versions that give wrong results, and which. Upstream says that 4.0.0 factors sparse Hessians wrongly: `tests/robot/test_versions.py`
compares them with dense ones, on a robot of 62 and one of 50 coordinates with closed chains they agree to 3e-12 in 3.17 and 4.0.0."""


def require_mujoco() -> None:
    """Refuse a MuJoCo that is too old or known to be wrong.

    Raises:
        RobotError: The version is refused; the message has the command that installs another.
    """
    try:
        check(version("mujoco"))
    except PackageNotFoundError:
        return  # its import says so itself


def check(found: str) -> None:
    """As `require_mujoco`, of a version given by its number."""
    oldest = ".".join(map(str, OLDEST))
    reason = WRONG.get(found, f"it is older than {oldest}" if _numbers(found) < OLDEST else "")
    if reason:
        raise RobotError(f"MuJoCo {found} cannot be used: {reason}. Install another: pip install 'mujoco>={oldest},<5'")


def _numbers(found: str) -> tuple[int, ...]:
    """Return the first two numbers of a version; other text counts as new."""
    parts = found.split(".")[:2]
    return tuple(int(part) if part.isdigit() else 10**6 for part in parts)


VARIABLE = "MUJOCO_GL"
OFF = ("disable", "disabled", "off", "false", "0")
ON = ("", "enable", "enabled", "on", "true", "1", "glfw")
LIBRARIES = {"egl": "EGL", "osmesa": "OSMesa", "glx": "GL"}
"""Ways of Linux, and the shared library that each needs."""
OTHER_SYSTEMS = {"Windows": ("wgl",), "Darwin": ("cgl",)}


def require_usable_gl() -> None:
    """Remove an unusable value of MUJOCO_GL, with a warning; rendering then selects a back end automatically."""
    backend = os.environ.get(VARIABLE, "").lower().strip()
    reason = unusable(backend, platform.system())
    if reason:
        del os.environ[VARIABLE]
        warnings.warn(f"{VARIABLE}={backend} is ignored: {reason}", stacklevel=2)


def unusable(backend: str, system: str) -> str:
    """Return the reason that a value of MUJOCO_GL cannot be used on a system; empty if it can.

    Args:
        backend: value of MUJOCO_GL.
        system: name of the operating system.
    """
    if backend in (*OFF, *ON, *OTHER_SYSTEMS.get(system, ())):
        return ""
    library = LIBRARIES.get(backend) if system == "Linux" else None
    if library is None:
        return "MuJoCo does not know this back end (egl, osmesa, glfw, off)"
    return "" if ctypes.util.find_library(library) else f"the library lib{library} is not installed"
