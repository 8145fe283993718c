"""MuJoCo's viewer of the digital twin, on a display."""

import sys
import threading
import warnings

import mujoco

from robot_retarget.base.errors import ServoError

PERIOD = 1 / 60
"""Of the twin's time between two pictures [s]."""
CLOSING = 2.0
"""Timeout for closing a window [s]."""


class ViewerWindow:
    """An open viewer; closing it by hand leaves the twin running.

    Args:
        model: what to show.
        data: its state, read at each `show`.

    Raises:
        ServoError: there is no display to open a window on.
    """

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        _require_display()
        import mujoco.viewer

        others = set(threading.enumerate())
        try:
            self._handle = mujoco.viewer.launch_passive(model, data, show_left_ui=False, show_right_ui=False)
        except RuntimeError as error:
            raise ServoError(f"--view: {error}") from error
        self._threads = set(threading.enumerate()) - others
        self._data, self._shown = data, data.time

    def show(self) -> None:
        """Bring the window up to date, if it is time and it is still open."""
        if self._data.time - self._shown >= PERIOD and self._handle.is_running():
            self._shown = self._data.time
            self._handle.sync()

    def close(self) -> None:
        """Shut the window. Its thread must be over before the process ends: it draws until then."""
        self._handle.close()
        for thread in self._threads:
            thread.join(CLOSING)


def _require_display() -> None:
    """Check for a display first: without one the viewer ends the process."""
    if sys.platform == "darwin":
        return
    import glfw

    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        if glfw.init():
            return
    reason = "; ".join(str(w.message) for w in caught) or "GLFW does not start"
    raise ServoError(f"--view needs a display: {reason}; leave it out, or set DISPLAY")
