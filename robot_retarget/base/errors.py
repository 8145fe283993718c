"""Errors of users, each with a message that names the cause and the alternatives.

Every error the package raises on purpose descends from `RobotRetargetError`; the command line prints its message
without a traceback and exits with code 2.
"""

import re
import shlex
import sys
from collections.abc import Callable, Iterable
from functools import cache
from pathlib import Path


def printable(text: str, instead: Callable[[int], str] = lambda code: " ") -> str:
    """Return a text without control characters, which a terminal obeys; line ends stay.

    Args:
        instead: returns the replacement of a character from its code.
    """
    return "".join(c if c.isprintable() or c == "\n" else instead(ord(c)) for c in text)


LONGEST_MESSAGE = 2000
"""Of a message [characters]; the longest of the package's own tests, measured, has 1,300. A message keeps its two ends."""


class RobotRetargetError(Exception):
    """Root of every error raised on purpose. Its message may quote a file: control characters become spaces, and it is cut."""

    def __init__(self, message: str = "", *more: object):
        text = printable(str(message)).replace("\n", " ")
        half = LONGEST_MESSAGE // 2 - 2
        super().__init__(text if len(text) <= LONGEST_MESSAGE else f"{text[:half]} … {text[-half:]}", *more)


class FileError(RobotRetargetError):
    """A file that cannot be read, is broken, or would take more memory than its limit; names the file."""


class MotionError(RobotRetargetError):
    """A motion file or array that cannot be read. Names the file and the line, if known."""

    def __init__(self, message: str, path: str | Path | None = None, line: int | None = None):
        where = "" if path is None else f"{path}: " if line is None else f"{path}:{line}: "
        super().__init__(where + message)


class SceneError(RobotRetargetError):
    """A scene file that cannot be read, or a body that contradicts the motion. Names the body."""


class RobotError(RobotRetargetError):
    """A robot model that cannot be found, loaded or used."""


class MatchError(RobotRetargetError):
    """A motion that is not human, a robot that is no humanoid, or an override with an unknown name."""


class TrajectoryError(RobotRetargetError):
    """A trajectory file that is broken, or belongs to another robot."""


class BalanceError(RobotRetargetError):
    """A motion that a robot standing free cannot play; says when, why, and what to ask for instead."""


class GraphError(RobotRetargetError):
    """An edge, vertex or realization that contradicts the definition of the graph."""


class ServoError(RobotRetargetError):
    """A servo map, port or bus that is not as it has to be, or a robot that is not fit to be moved."""


class OutputError(RobotRetargetError):
    """A file or folder that cannot be written."""


class UsageError(RobotRetargetError):
    """A value that an option or argument does not accept."""


DISTRIBUTION = "humanoid-retarget"
"""The name of the installed distribution; the package is `robot_retarget` and the command `robot-retarget`."""


@cache
def extra_requirements(extra: str) -> tuple[str, ...]:
    """Return the requirements of an extra from the metadata of the installation; empty without metadata."""
    from importlib.metadata import PackageNotFoundError, requires

    try:
        lines = [line.partition(";") for line in requires(DISTRIBUTION) or ()]
    except PackageNotFoundError:
        return ()
    return tuple(what.strip() for what, _, marker in lines if extra in re.findall(r"extra == ['\"](\w+)", marker))


def install_line(extra: str) -> str:
    """Return the command that installs the requirements of an extra into the running Python.

    The command names the required packages, because this distribution may not be on an index.
    """
    wanted = extra_requirements(extra) or (f".[{extra}]",)
    return shlex.join([sys.executable, "-m", "pip", "install", *wanted])


LISTED = 3
"""Entries of a message that are listed one by one, so that it stays a line; further ones are counted."""


def known(names: Iterable[str], limit: int = 24, typed: object = "") -> str:
    """List the alternatives, as the tail of a message: `did you mean 'b'? known: a, b, c`.

    Args:
        limit: Names listed at most.
        typed: The unknown name; the nearest known name is suggested.
    """
    listed = list(names)
    tail = f", … ({len(listed)} in all)" if len(listed) > limit else ""
    return did_you_mean(str(typed), listed) + "known: " + (", ".join(listed[:limit]) + tail if listed else "none")


def did_you_mean(typed: str, names: Iterable[str]) -> str:
    """Suggest the known name nearest to `typed`: `did you mean 'b'? `; empty if none is near."""
    from difflib import get_close_matches

    lower = {name.lower(): name for name in names}
    near = get_close_matches(typed.lower(), lower, 1) if typed else []
    return f"did you mean {lower[near[0]]!r}? " if near else ""
