"""The computer during a playback: requests to stop, and settings for even ticks."""

import contextlib
import ctypes
import gc
import os
import select
import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import current_thread, main_thread

# Ctrl-C, SIGTERM and the space bar as requests to stop, not as deaths.

KEY = b" "
"""The key that stops."""


@contextmanager
def handling(stop: Callable[[int], None]) -> Iterator[None]:
    """Call a function with the number of each SIGINT and SIGTERM; restore their handlers afterwards.

    Only the main thread receives signals.
    """
    numbers = (signal.SIGINT, signal.SIGTERM) if current_thread() is main_thread() else ()
    before = {number: signal.signal(number, lambda number, frame: stop(number)) for number in numbers}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def keys(keyboard: int | None) -> Iterator[int | None]:
    """Yield a terminal whose keys arrive at once and without echo; restore it afterwards.

    Args:
        keyboard: file descriptor of a terminal; None takes the standard input, if it is a terminal.
    """
    if keyboard is None and (sys.stdin is None or not sys.stdin.isatty()):
        yield None
        return
    import termios
    import tty

    terminal = sys.stdin.fileno() if keyboard is None else keyboard
    before = termios.tcgetattr(terminal)
    tty.setcbreak(terminal, termios.TCSADRAIN)
    try:
        yield terminal
    finally:
        termios.tcsetattr(terminal, termios.TCSADRAIN, before)


class Interrupts:
    """How often somebody asked to stop while `listening`.

    Args:
        keyboard: file descriptor of a terminal; None takes the standard input, if it is a terminal.
    """

    def __init__(self, keyboard: int | None = None) -> None:
        self.count: int = 0
        self.terminated: bool = False
        """SIGTERM was among them."""
        self._keyboard = keyboard
        self._keys: int | None = None

    @contextmanager
    def listening(self) -> Iterator[None]:
        """Count SIGINT and SIGTERM, and read keys."""
        with handling(self._note), keys(self._keyboard) as self._keys:
            yield

    @property
    def requests(self) -> int:
        """`count`, after reading the keys that were pressed: the first `KEY` is a request."""
        while self._keys is not None and select.select([self._keys], [], [], 0)[0]:
            pressed = os.read(self._keys, 64)
            self._keys = self._keys if pressed else None
            self.count += KEY in pressed and not self.count
        return self.count

    def _note(self, number: int) -> None:
        self.count += 1
        self.terminated |= number == signal.SIGTERM


# System settings for even ticks. Settings that the system refuses are skipped.

PRIORITY = 10
"""Among real-time processes of Linux (1 … 99), where the system grants one."""
TIMER_SLACK = 29
"""Linux: `prctl(PR_SET_TIMERSLACK, …)`."""
LOCK_CURRENT, LOCK_ON_FAULT = 1, 4
"""Linux: `mlockall(MCL_CURRENT | MCL_ONFAULT)`."""


@contextlib.contextmanager
def real_time() -> Iterator[None]:
    """Disable garbage collection; request precise timers, locked memory and real-time priority.

    The default slack of timers is 50 µs; code that is read from disk again takes milliseconds.
    """
    unless_refused = contextlib.suppress(OSError, AttributeError)
    collecting, before = gc.isenabled(), None
    gc.disable()
    with unless_refused:
        ctypes.CDLL(None).prctl(TIMER_SLACK, 1, 0, 0, 0)
    with unless_refused:
        ctypes.CDLL(None).mlockall(LOCK_CURRENT | LOCK_ON_FAULT)
    with unless_refused:
        before = os.sched_getscheduler(0), os.sched_getparam(0)
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(PRIORITY))
    try:
        yield
    finally:
        if before is not None:
            with unless_refused:
                os.sched_setscheduler(0, *before)
        with unless_refused:
            ctypes.CDLL(None).munlockall()
        if collecting:
            gc.enable()


@contextlib.contextmanager
def without_sleep_states() -> Iterator[None]:
    """Disable sleep states of the processor (Linux PM QoS): leaving one takes 50 µs or more, twice per exchange."""
    request = None
    with contextlib.suppress(OSError):
        request = os.open("/dev/cpu_dma_latency", os.O_WRONLY)
        os.write(request, bytes(4))
    try:
        yield
    finally:
        if request is not None:
            os.close(request)


def wait_until(due: float) -> float:
    """Sleep until a time of the monotonic clock. Returns the time after it."""
    ahead = due - time.monotonic()
    if ahead > 0:
        time.sleep(ahead)
    return time.monotonic()
