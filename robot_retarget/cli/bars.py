"""A progress bar with the time left."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from time import monotonic

from rich.progress import BarColumn, ProgressColumn, Task, TaskProgressColumn, TextColumn
from rich.progress import Progress as Bars
from rich.text import Text

from robot_retarget.cli.console import side
from robot_retarget.progress import Progress


class TimeLeft(ProgressColumn):
    """The time until the end that `Stages` expects."""

    def render(self, task: Task) -> Text:
        """Minutes and seconds."""
        left = max(round(task.fields["ends"] - monotonic()), 0)
        return Text(f"{left // 60}:{left % 60:02d} left", style="progress.remaining")


class Stages:
    """A progress bar over stages that follow each other.

    The time left is the rest of the present stage at its measured pace, plus the usual times of later stages. The usual
    pace counts like the first `PRIOR` of a stage, which steadies the estimate at its start.
    """

    PRIOR = 0.1

    def __init__(self, bars: Bars, costs: Mapping[str, float]):
        self._bars, self._costs, self._began = bars, costs, monotonic()
        self._task = bars.add_task("", ends=self._began + sum(costs.values()))

    def begin(self, stage: str) -> Progress:
        """Begin a stage and return the function that reports its progress."""
        names, cost, began = list(self._costs), self._costs[stage], monotonic()
        later = sum(self._costs[name] for name in names[names.index(stage) + 1 :])

        def report(done: int, total: int) -> None:
            share, usual = done / max(total, 1), self.PRIOR * cost
            self._expect((1 - share) * (monotonic() - began + usual) / (share + self.PRIOR) + later)

        self._bars.update(self._task, description=stage)
        report(0, 1)
        return report

    def _expect(self, left: float) -> None:
        now = monotonic()
        self._bars.update(self._task, completed=now - self._began, total=now - self._began + left, ends=now + left)


@contextmanager
def progress(costs: Mapping[str, float]) -> Iterator[Stages]:
    """Show a bar with the time left over stages of usual durations [s], on stderr if that is a terminal."""
    columns = TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeLeft()
    with Bars(*columns, console=side, transient=True, disable=side.quiet or not side.is_terminal) as bars:
        yield Stages(bars, costs)


@contextmanager
def tally(total: int, stopping: Callable[[], bool]) -> Iterator[Callable[[bool], None]]:
    """A bar over independent pieces: how many are done, how many failed, a rate and the time left.

    Yields a function that reports whether a piece succeeded.
    """
    began, failed, done = monotonic(), 0, 0
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.completed:.0f}/{task.total:.0f}"),
        TimeLeft(),
    )
    with Bars(*columns, console=side, transient=True, disable=side.quiet or not side.is_terminal) as bars:
        task = bars.add_task("clips", total=total, ends=began)

        def report(well: bool) -> None:
            nonlocal failed, done
            done, failed = done + 1, failed + (not well)
            now = monotonic()
            rate = done / max(now - began, 1e-9)
            description = f"{rate:.2f} clips/s, {failed} failed" + (", finishing" if stopping() else "")
            bars.update(task, completed=done, ends=now + (total - done) / rate, description=description)

        yield report
