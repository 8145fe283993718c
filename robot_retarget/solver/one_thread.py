"""One thread of linear algebra while clips are solved: sums then have one order on every machine."""

from collections.abc import Iterable
from contextlib import ContextDecorator
from functools import cache
from threading import Lock
from typing import ClassVar

from threadpoolctl import LibController, ThreadpoolController


class OneThread(ContextDecorator):
    """Limit BLAS to one thread while any thread of this process is inside; two threads on two busy cores take 70 times as long."""

    _lock: ClassVar[Lock] = Lock()
    _inside: ClassVar[int] = 0
    _before: ClassVar[list[int]]

    def __enter__(self) -> None:
        with self._lock:
            if not OneThread._inside:
                OneThread._before = [library.get_num_threads() or 1 for library in _libraries()]
                _limit([1 for _ in self._before])
            OneThread._inside += 1

    def __exit__(self, *_: object) -> None:
        with self._lock:
            OneThread._inside -= 1
            if not OneThread._inside:
                _limit(self._before)


@cache
def _libraries() -> list[LibController]:
    """Return the loaded BLAS."""
    return ThreadpoolController().select(user_api="blas").lib_controllers


def _limit(numbers: Iterable[int]) -> None:
    """Set numbers of threads. Newer versions of threadpoolctl heed the first thread that sets one alone, until it is forgotten."""
    for library, number in zip(_libraries(), numbers, strict=True):
        forget = getattr(library, "clear_controlling_thread", lambda force: force)
        forget(force=True)
        library.set_num_threads(number)
        forget(force=True)
