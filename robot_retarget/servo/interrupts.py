"""Ctrl-C and SIGTERM as requests to stop, not as deaths."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from threading import current_thread, main_thread
from types import FrameType


class Interrupts:
    """How often somebody asked to stop while `listening`."""

    count: int
    terminated: bool

    def __init__(self) -> None:
        self.count = 0
        self.terminated = False
        """SIGTERM was among them."""

    @contextmanager
    def listening(self) -> Iterator[None]:
        """Count SIGINT and SIGTERM; restore their handlers afterwards. Only the main thread receives signals."""
        if current_thread() is not main_thread():
            yield
            return
        before = {number: signal.signal(number, self._note) for number in (signal.SIGINT, signal.SIGTERM)}
        try:
            yield
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)

    def _note(self, number: int, frame: FrameType | None) -> None:
        del frame
        self.count += 1
        self.terminated |= number == signal.SIGTERM
