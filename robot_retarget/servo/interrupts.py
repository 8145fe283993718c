"""Ctrl-C, SIGTERM and the space bar as requests to stop, not as deaths."""

import os
import select
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import current_thread, main_thread

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
