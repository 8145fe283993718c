"""A worker process: takes tasks from a pipe and sends their outcomes back, until the pipe closes.

Run as `python -m robot_retarget.tools.batch.worker FD` by `pool.py`, in a new session: Ctrl-C reaches only the parent.
"""

import ctypes
import signal
import sys
from contextlib import suppress
from multiprocessing.connection import Connection

from robot_retarget.tools.batch.task import perform

_DEATH_SIGNAL = 1
"""`PR_SET_PDEATHSIG` of prctl(2)."""


def serve(pipe: Connection) -> None:
    """Perform the tasks of a pipe."""
    with suppress(EOFError, OSError):
        while True:
            pipe.send(perform(pipe.recv()))


def end_with_parent() -> None:
    """Ask the kernel to kill this process when the parent dies; elsewhere than on Linux the closed pipe ends it."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_DEATH_SIGNAL, signal.SIGKILL)


if __name__ == "__main__":
    end_with_parent()
    serve(Connection(int(sys.argv[1])))
