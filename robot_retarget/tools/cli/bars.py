"""Progress bars with the time left, on stderr if that is a terminal."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from time import monotonic

from rich.progress import BarColumn, ProgressColumn, TaskProgressColumn, TextColumn, TimeRemainingColumn
from rich.progress import Progress as Bars

from robot_retarget.base.progress import Progress
from robot_retarget.tools.cli.console import side


def _bars(share: ProgressColumn) -> Bars:
    """Return bars with a description, the completed share and the time left."""
    columns = TextColumn("{task.description}"), BarColumn(), share, TimeRemainingColumn()
    return Bars(*columns, console=side, transient=True, disable=side.quiet or not side.is_terminal)


@contextmanager
def progress() -> Iterator[Callable[[str], Progress]]:
    """Yield a function that begins a stage, in place of the one before, and returns the receiver of its progress."""
    with _bars(TaskProgressColumn()) as bars:
        bar = bars.add_task("")

        def begin(stage: str) -> Progress:
            bars.reset(bar, description=stage, total=None)
            return lambda done, total: bars.update(bar, completed=done, total=total)

        yield begin


@contextmanager
def tally(total: int, stopping: Callable[[], bool]) -> Iterator[Callable[[bool], None]]:
    """Show a bar over independent pieces: number done, number failed, rate, time left.

    Yields a function that reports whether a piece succeeded.
    """
    began, failed, done = monotonic(), 0, 0
    with _bars(TextColumn("{task.completed:.0f}/{task.total:.0f}")) as bars:
        bar = bars.add_task("clips", total=total)

        def report(well: bool) -> None:
            nonlocal failed, done
            done, failed = done + 1, failed + (not well)
            rate = done / max(monotonic() - began, 1e-9)
            description = f"{rate:.2f} clips/s, {failed} failed" + (", finishing" if stopping() else "")
            bars.update(bar, completed=done, description=description)

        yield report
