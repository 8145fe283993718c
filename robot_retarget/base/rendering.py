"""The environment variable MUJOCO_GL: a value that MuJoCo cannot use stops its import, so it is dropped before."""

import ctypes.util
import os
import platform
import warnings

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
