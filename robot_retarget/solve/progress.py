"""How far a long computation has come."""

from collections.abc import Callable

Progress = Callable[[int, int], None]
"""Told (frames done, frames in all)."""


class Count:
    """Counts frames towards a progress report."""

    def __init__(self, progress: Progress | None, total: int):
        self.progress, self.total, self.done = progress, total, 0

    def one(self) -> None:
        """One more frame is done."""
        self.done += 1
        if self.progress:
            self.progress(min(self.done, self.total), self.total)
