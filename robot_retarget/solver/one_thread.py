"""One thread of linear algebra while clips are solved: sums then have one order on every machine."""

from collections.abc import Iterable
from contextlib import ContextDecorator
from functools import cache
from threading import Lock

from threadpoolctl import LibController, ThreadpoolController


class OneThread(ContextDecorator):
    """Limit BLAS to one thread while any thread of this process is inside; two threads on two busy cores take 70 times as long."""

    def __init__(self) -> None:
        self._lock, self._inside, self._before = Lock(), 0, list[int]()

    def __enter__(self) -> None:
        with self._lock:
            if not self._inside:
                self._before = [library.get_num_threads() or 1 for library in _libraries()]
                _limit([1 for _ in self._before])
            self._inside += 1

    def __exit__(self, *_: object) -> None:
        with self._lock:
            self._inside -= 1
            if not self._inside:
                _limit(self._before)


ONE_THREAD = OneThread()
"""The limit of this process: it counts all solves inside."""


@cache
def _libraries() -> list[LibController]:
    """Return the loaded BLAS."""
    return ThreadpoolController().select(user_api="blas").lib_controllers


def _limit(numbers: Iterable[int]) -> None:
    """Set numbers of threads. Newer versions of threadpoolctl ignore all threads but the first that sets one, until that is cleared."""
    for library, number in zip(_libraries(), numbers, strict=True):
        clear = getattr(library, "clear_controlling_thread", lambda force: force)
        clear(force=True)
        library.set_num_threads(number)
        clear(force=True)
