"""How far a long computation has come."""

from collections.abc import Callable

Progress = Callable[[int, int], None]
"""Told (steps done, steps in all) in steps that take about the same time; more may turn out to be left."""


class Count:
    """Counts steps towards a progress report."""

    def __init__(self, progress: Progress | None, total: int):
        self.progress, self.total, self.done = progress, total, 0

    def advance(self, steps: int = 1) -> None:
        """Count steps as done and report them."""
        self.done += steps
        if self.progress:
            self.progress(min(self.done, self.total), self.total)

    def expect(self, left: int) -> None:
        """Set the estimated number of remaining steps."""
        self.total = self.done + left


def consecutive(progress: Progress, left: int) -> tuple[Progress, Progress]:
    """Split a progress report between two consecutive computations.

    Args:
        progress: receives (steps done, steps in all) of both.
        left: estimated steps of the second.
    """
    before = 0

    def first(done: int, total: int) -> None:
        nonlocal before
        before = total
        progress(done, total + left)

    return first, lambda done, total: progress(before + done, before + total)
