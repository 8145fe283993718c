"""Ends of the program other than success: a user's mistake, Ctrl-C, a defect."""

import os
import sys
import traceback
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import typer
from typer.core import TyperGroup

from robot_retarget.cli import console
from robot_retarget.errors import RobotRetargetError
from robot_retarget.files import folder

MISTAKE = 2
"""Exit code of bad input."""
DEFECT = 70
"""Exit code of an unexpected exception: `EX_SOFTWARE` of sysexits.h."""
INTERRUPTED = 130
"""Exit code after Ctrl-C: 128 and the number of SIGINT, as shells have it."""
NOBODY_READS = 141
"""Exit code where the reader of a pipe is gone: 128 and the number of SIGPIPE."""
DEBUG = "ROBOT_RETARGET_DEBUG"
"""Environment variable that shows the traceback of a defect."""
NOTHING = "no file was written"


class Interruptible(TyperGroup):
    """Commands that end on Ctrl-C with a message about the files that are kept, from the exception."""

    def invoke(self, ctx: Any) -> Any:
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt as stopped:
            exec("")  # Python keeps a Ctrl-C inside `exec` as unhandled until the next `exec`, and exits because of it
            console.err.print(f"stopped: {str(stopped) or NOTHING}", markup=False, style="yellow")
            raise typer.Exit(INTERRUPTED) from stopped
        except BrokenPipeError as closed:
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            raise typer.Exit(NOBODY_READS) from closed


def ending(program: Callable[[], None]) -> None:
    """Run a program; mistakes and defects end in a message and an exit code, warnings in a note."""
    warnings.showwarning = lambda message, *_: console.note(str(message))
    try:
        program()
    except RobotRetargetError as error:
        _say(str(error))
        sys.exit(MISTAKE)
    except Exception as error:
        if os.environ.get(DEBUG):
            traceback.print_exc()
        _say(
            f"a defect of robot-retarget ended this command ({_named(error)}). "
            f"Please report it with the command and its output under {DEBUG}=1."
        )
        sys.exit(DEFECT)


@dataclass(frozen=True)
class Filled:
    """A folder that is being filled."""

    path: Path
    before: Mapping[Path, int]
    """The files that were there, and when each was written [ns]."""

    def written(self) -> list[str]:
        """The names of the files that were written since, sorted."""
        return sorted(file.name for file, when in _contents(self.path).items() if self.before.get(file) != when)


@contextmanager
def filling(path: Path) -> Iterator[Filled]:
    """A folder for results, removed if it stays empty; Ctrl-C reports the files that were written.

    Raises:
        OutputError: The folder cannot be made or written.
        KeyboardInterrupt: Ctrl-C; its text names the files that were written.
    """
    made = [place for place in (path, *path.parents) if not place.exists()]
    filled = Filled(path, _contents(path))
    try:
        folder(path)
        yield filled
    except KeyboardInterrupt as stopped:
        said = f"kept {', '.join(filled.written())} in {path}" if filled.written() else NOTHING
        raise KeyboardInterrupt(said) from stopped
    finally:
        with suppress(OSError):  # the first that is not empty ends it
            for place in made:
                place.rmdir()


def _contents(target: Path) -> dict[Path, int]:
    """Return the files of a folder with their modification times; empty if the folder does not exist."""
    return {path: path.stat().st_mtime_ns for path in target.glob("*")}


def _named(error: Exception) -> str:
    """An exception's type and the first line of its text."""
    text = str(error).strip().partition("\n")[0]
    return f"{type(error).__name__}: {text}" if text else type(error).__name__


def _say(text: str) -> None:
    console.err.print(f"error: {console.in_options(text)}", markup=False, style="red")
