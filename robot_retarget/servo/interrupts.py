"""Ctrl-C and SIGTERM as requests to stop, not as deaths."""

import signal
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from threading import current_thread, main_thread


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


class Interrupts:
    """How often somebody asked to stop while `listening`."""

    def __init__(self) -> None:
        self.count: int = 0
        self.terminated: bool = False
        """SIGTERM was among them."""

    def listening(self) -> AbstractContextManager[None]:
        """Count SIGINT and SIGTERM; restore their handlers afterwards."""
        return handling(self._note)

    def _note(self, number: int) -> None:
        self.count += 1
        self.terminated |= number == signal.SIGTERM
