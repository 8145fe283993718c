"""Off-screen OpenGL. The back end is chosen before PyOpenGL is loaded, because PyOpenGL reads the choice once."""

import ctypes
import ctypes.util
import importlib
import os
import platform
from typing import Any

from robot_retarget.tools.view.picture import Unavailable

_OFF = ("disable", "disabled", "off", "false", "0")
_WINDOW = "gl_context"
_DEVICE_PLATFORM = 0x313F  # EGL_PLATFORM_DEVICE_EXT
_DEVICES = 16


def open_context(width: int, height: int) -> Any:
    """A GL context of MuJoCo that is not current yet, or Unavailable.

    `MUJOCO_GL` is obeyed; without it Linux takes EGL where a device answers, then OSMesa, and other systems their own.
    """
    way = _way()
    if isinstance(way, Unavailable):
        return way
    try:
        return importlib.import_module(f"mujoco.{way}").GLContext(width, height)
    except Exception as error:  # each back end raises its own errors, and no error may end a run because of a picture
        return Unavailable(
            f"no rendering: {way} does not start ({' '.join(str(error).split()) or type(error).__name__})"
        )


def _way() -> str | Unavailable:
    """The module of mujoco to take the context from."""
    backend = os.environ.get("MUJOCO_GL", "").lower().strip()
    if backend in _OFF:
        return Unavailable(f"no rendering: switched off by MUJOCO_GL={backend}")
    if backend in ("egl", "osmesa"):
        return backend
    if backend or platform.system() != "Linux":
        return _WINDOW
    loaded = os.environ.get("PYOPENGL_PLATFORM", "").lower()
    if loaded in ("egl", "osmesa"):
        return loaded
    if _egl_answers():
        return "egl"
    if ctypes.util.find_library("OSMesa"):
        return "osmesa"
    return Unavailable("no rendering: found no EGL device and no OSMesa (Debian: libegl1 or libosmesa6)")


def _egl_answers() -> bool:
    """Return whether EGL finds a working device. The library is called directly, before PyOpenGL is loaded."""
    try:
        egl = ctypes.CDLL(ctypes.util.find_library("EGL") or "libEGL.so.1")
        egl.eglGetProcAddress.restype = ctypes.c_void_p
        egl.eglGetProcAddress.argtypes = [ctypes.c_char_p]
        addresses = [egl.eglGetProcAddress(name) for name in (b"eglQueryDevicesEXT", b"eglGetPlatformDisplayEXT")]
    except (OSError, AttributeError):
        return False
    if not all(addresses):
        return False
    pointer, integer = ctypes.c_void_p, ctypes.c_int
    query = ctypes.CFUNCTYPE(ctypes.c_uint, integer, ctypes.POINTER(pointer), ctypes.POINTER(integer))(addresses[0])
    display_of = ctypes.CFUNCTYPE(pointer, integer, pointer, pointer)(addresses[1])
    devices, count = (pointer * _DEVICES)(), integer()
    if not query(_DEVICES, devices, ctypes.byref(count)):
        return False
    egl.eglInitialize.argtypes = [pointer, pointer, pointer]
    egl.eglTerminate.argtypes = [pointer]
    for device in devices[: count.value]:
        display = display_of(_DEVICE_PLATFORM, device, None)
        if display and egl.eglInitialize(display, None, None):
            egl.eglTerminate(display)
            return True
    return False
