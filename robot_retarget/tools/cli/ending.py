"""Ends of the program other than success: a user's mistake, Ctrl-C, a defect."""

import os
import signal
import sys
import tempfile
import traceback
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from shutil import rmtree
from typing import Any

import typer
from typer.core import TyperGroup

from robot_retarget.base.errors import RobotRetargetError
from robot_retarget.base.files import folder
from robot_retarget.tools.cli import console

MISTAKE = 2
"""Exit code of bad input."""
DEFECT = 70
"""Exit code of an unexpected exception: `EX_SOFTWARE` of sysexits.h."""
INTERRUPTED = 130
"""Exit code after Ctrl-C: 128 and the number of SIGINT, as shells have it."""
NOBODY_READS = 141
"""Exit code where the reader of a pipe is gone: 128 and the number of SIGPIPE."""
POSIX = ("fcntl", "resource", "termios", "tty")
"""Modules of Python that other systems lack."""
DEBUG = "ROBOT_RETARGET_DEBUG"
"""Environment variable that shows the traceback of a defect."""
NOTHING = "no file was written"


class Interruptible(TyperGroup):
    """Commands that end on Ctrl-C with a message about the files that are kept, from the exception."""

    def make_context(self, *words: Any, **options: Any) -> Any:
        with _stopped():
            return super().make_context(*words, **options)

    def invoke(self, ctx: Any) -> Any:
        with _stopped():
            return super().invoke(ctx)


@contextmanager
def _stopped() -> Iterator[None]:
    """Turn Ctrl-C and a reader that is gone into their exit codes; until here Ctrl-C ends the process."""
    try:
        if signal.getsignal(signal.SIGINT) is signal.SIG_DFL:
            signal.signal(signal.SIGINT, _CtrlC())
        yield
    except (KeyboardInterrupt, ImportError) as stopped:
        if isinstance(stopped, ImportError) and not getattr(signal.getsignal(signal.SIGINT), "pressed", False):
            raise
        exec("")  # Python keeps a Ctrl-C inside `exec` as unhandled until the next `exec`, and exits because of it
        kept = str(stopped) if isinstance(stopped, KeyboardInterrupt) else ""
        console.err.print(f"stopped: {kept or NOTHING}", markup=False, style="yellow")
        raise typer.Exit(INTERRUPTED) from stopped
    except BrokenPipeError as closed:
        _discard_output()
        raise typer.Exit(NOBODY_READS) from closed


class _CtrlC:
    """The handler of Ctrl-C; it notes it, because a library that is stopped while it loads raises ImportError."""

    pressed = False

    def __call__(self, *_: object) -> None:
        self.pressed = True
        raise KeyboardInterrupt


def _discard_output() -> None:
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def ending(program: Callable[[], None]) -> None:
    """Run a program; mistakes and defects end in a message and an exit code, warnings in a note."""
    warnings.showwarning = lambda message, *_: console.note(str(message))
    try:
        _ended(program)
    finally:
        try:
            sys.stdout.flush()
        except BrokenPipeError:
            _discard_output()
            sys.exit(NOBODY_READS)


def _ended(program: Callable[[], None]) -> None:
    try:
        program()
    except RobotRetargetError as error:
        _say(str(error))
        sys.exit(MISTAKE)
    except Exception as error:
        if isinstance(error, ModuleNotFoundError) and error.name in POSIX:
            _say(f"this command needs Linux: Python has no module {error.name!r} on this system")
            sys.exit(MISTAKE)
        if os.environ.get(DEBUG):
            traceback.print_exc()
        _say(
            f"a defect of robot-retarget ended this command ({_named(error)}). "
            f"Please report it with the command and its output under {DEBUG}=1."
        )
        sys.exit(DEFECT)


@dataclass(frozen=True)
class Filled:
    """A folder of results that is being filled."""

    path: Path
    """Folder of the files until all are complete."""
    place: Path
    """Where they go."""

    def written(self) -> list[str]:
        """The names of the files that were written, sorted."""
        return sorted(file.name for file in self.path.iterdir())


RESULTS = (
    "trajectory.npz",
    "report.json",
    "report.html",
    "viewer.html",
    "warnings.csv",
    "strip.png",
    "video.mp4",
    "play.npz",
    "report.pinned.json",
)
"""Files of a folder of results, which belong together: those of an earlier run go when the new ones come."""
UNFINISHED = ".unfinished-"
"""Prefix of the folder that holds results until all are complete."""


@contextmanager
def filling(place: Path) -> Iterator[Filled]:
    """Fill a folder with results that replace earlier ones together, at the end or on Ctrl-C.

    A run that is killed leaves the earlier results whole; the next run deletes the unfinished files.

    Raises:
        OutputError: The folder cannot be made or written.
        KeyboardInterrupt: Ctrl-C; its text names the files that were written.
    """
    made = [folder_ for folder_ in (place, *place.parents) if not folder_.exists()]
    folder(place)
    earlier = [name for name in RESULTS if (place / name).exists()]
    for left in place.glob(f"{UNFINISHED}*"):
        rmtree(left)
    filled = Filled(Path(tempfile.mkdtemp(dir=place, prefix=UNFINISHED)), place)
    try:
        yield filled
        _put(filled)
        if earlier:
            console.note(f"replaced the results of an earlier run in {place}: {', '.join(earlier)}")
    except KeyboardInterrupt as stopped:
        message = f"kept {', '.join(filled.written())} in {place}" if filled.written() else NOTHING
        _put(filled)
        raise KeyboardInterrupt(message) from stopped
    finally:
        rmtree(filled.path)
        for one in made:
            if not any(one.iterdir()):
                one.rmdir()


def _put(filled: Filled) -> None:
    """Put the files in the place of earlier results, if there are any."""
    written = filled.written()
    for name in RESULTS if written else ():
        (filled.place / name).unlink(missing_ok=True)
    for name in written:
        (filled.path / name).replace(filled.place / name)


def _named(error: Exception) -> str:
    """An exception's type and the first line of its text."""
    text = str(error).strip().partition("\n")[0]
    return f"{type(error).__name__}: {text}" if text else type(error).__name__


def _say(text: str) -> None:
    console.err.print(f"error: {console.in_options(text)}", markup=False, style="red")
