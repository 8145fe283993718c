"""The program: commands whose options are the fields of dataclasses, and the ends other than success: a user's mistake, Ctrl-C, a defect."""

import errno
import os
import re
import signal
import sys
import traceback
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import MISSING, dataclass, field, fields, is_dataclass
from functools import wraps
from inspect import Parameter, Signature, signature
from pathlib import Path
from typing import Annotated, Any, TypeVar, dataclass_transform, get_type_hints

import typer
from typer.core import TyperGroup

from robot_retarget.base.errors import RobotRetargetError, UsageError, known
from robot_retarget.base.untrusted.limits import zip_names
from robot_retarget.tools.cli import console

TYPER = "typer"
"""Where the metadata of a field keep its option."""
Group = TypeVar("Group", bound=type)


def option(help: str, *names: str, default: Any = MISSING, **more: Any) -> Any:
    """Return a field that is an option; without `default` the user has to give it.

    Args:
        help: its line of `--help`.
        names: its names; by default the field's.
        default: its value where the user gives none.
        more: as of `typer.Option`.
    """
    return field(default=default, metadata={TYPER: typer.Option(*names, help=help, **more)})


def argument(help: str, default: Any = MISSING, **more: Any) -> Any:
    """Return a field that is an argument by its place on the command line; `more` as of `typer.Argument`."""
    return field(default=default, metadata={TYPER: typer.Argument(help=help, **more)})


@dataclass_transform(kw_only_default=True, frozen_default=True, field_specifiers=(option, argument))
def options(group: Group) -> Group:
    """Make a class of fields by `option` and `argument` a group of options."""
    return dataclass(frozen=True, kw_only=True)(group)


def command(
    name: str | None = None, *, epilog: str, group: typer.Typer | None = None
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Register a function as a command: each parameter that is a group of options gives its fields as options.

    Args:
        group: the group of commands that it belongs to; by default the program itself.
    """

    def registered(function: Callable[..., None]) -> Callable[..., None]:
        hints = get_type_hints(function, include_extras=True)
        groups: dict[str, Any] = {parameter: kind for parameter, kind in hints.items() if is_dataclass(kind)}

        @wraps(function)
        def run(**given: Any) -> None:
            made = {p: kind(**{f.name: given.pop(f.name) for f in fields(kind)}) for p, kind in groups.items()}
            function(**made, **given)

        parameters = signature(function).parameters.values()
        run.__signature__ = Signature([one for each in parameters for one in _expanded(each, hints)])  # pyright: ignore[reportAttributeAccessIssue]
        run.__annotations__ = {}
        (group or app).command(name, epilog=epilog)(run)
        return function

    return registered


def _expanded(parameter: Parameter, hints: dict[str, Any]) -> Iterator[Parameter]:
    """Yield the options of a group, or a parameter that is an option itself."""
    kind = hints[parameter.name]
    if not is_dataclass(kind):
        yield Parameter(parameter.name, Parameter.KEYWORD_ONLY, default=parameter.default, annotation=kind)
        return
    types = get_type_hints(kind, include_extras=True)
    for each in fields(kind):
        default = Parameter.empty if each.default is MISSING else each.default
        annotation = Annotated[types[each.name], each.metadata[TYPER]]
        yield Parameter(each.name, Parameter.KEYWORD_ONLY, default=default, annotation=annotation)


_line: list[str] = []
"""The words of the command line, from the command's name on."""


def line_without(valued: Sequence[str], flags: Sequence[str]) -> list[str]:
    """Return the words of the command line, from the command's name on, without some of them.

    Args:
        valued: options that are left out with their values.
        flags: other words that are left out.
    """
    kept, words = list[str](), iter(_line)
    for word in words:
        if word in valued:
            next(words, None)
        elif word not in flags and word.partition("=")[0] not in valued:
            kept.append(word)
    return kept


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


PLAIN = (
    (r"^Value error, ", ""),
    (r"Input should be a valid (integer|number), .*", r"it takes a \1"),
    (r"Input should be (greater|less) than or equal to (\S+)", r"it must be \1 than or equal to \2"),
)
"""Messages of a library about refused values of options, and their replacements."""


MEANT = {
    "retarget": "run",
    "visualize": "view",
    "visualise": "view",
    "show": "view",
    "evaluate": "score",
    "judge": "simulate",
}
"""Words for commands that other programs have."""


# Kinds of files, and the commands that take them, checked before any heavy library is loaded.

MODELS = (".xml", ".mjcf", ".urdf")
MOTIONS = (".bvh", ".amc", ".asf", ".c3d", ".mvnx", ".trc", ".glb", ".gltf", ".vrma", ".fbx")
KINDS = {".toml": "settings"} | dict.fromkeys(MODELS, "robot") | dict.fromkeys(MOTIONS, "motion")
TRAJECTORY_MEMBERS = {"qpos.npy", "joint_names.npy", "format_version.npy"}
TAKEN_BY = {
    "robot": "robot-retarget info {0} shows it; other commands take it as --robot {0}",
    "motion": "robot-retarget run {0} makes a trajectory of it",
    "trajectory": "robot-retarget view, simulate, export and play take it",
    "settings": "commands take it by an option: --map, --limits, --edges, --servos",
}
"""Which command takes a file of a kind."""


def kind_of(path: Path) -> str:
    """A key of `TAKEN_BY`, by the suffix or the names in an archive; empty for what may be several kinds."""
    suffix = path.suffix.lower()
    planned = suffix == ".npz" and set(zip_names(path)) >= TRAJECTORY_MEMBERS
    return KINDS.get(suffix, "trajectory" if planned else "")


class Interruptible(TyperGroup):
    """Commands that end on Ctrl-C with a message about the files that are kept, from the exception."""

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Find a command; one of a group that is named without its group gets the whole name."""
        _line[:] = args
        if args[0] not in self.commands and Path(args[0]).is_file():
            taken = TAKEN_BY.get(kind_of(Path(args[0])), "robot-retarget info {0} says what it is").format(args[0])
            raise UsageError(f"{args[0]} is a file, not a command; {taken}")
        within = [name for name, own in self.commands.items() if args[0] in getattr(own, "commands", ())]
        if args[0] not in self.commands and within:
            raise UsageError(f"{args[0]} is a command of {within[0]}: robot-retarget {within[0]} {' '.join(args)}")
        if args[0] not in self.commands and not args[0].startswith("-"):
            meant = MEANT.get(args[0].lower(), args[0])
            raise UsageError(
                f"no command {args[0]!r}; {known(self.commands, 40, typed=meant)}; --help says what they do"
            )
        return super().resolve_command(ctx, args)

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
    except typer.BadParameter as refused:
        for pattern, plain in PLAIN:
            refused.message = re.sub(pattern, plain, refused.message)
        raise
    except (KeyboardInterrupt, ImportError) as stopped:
        if isinstance(stopped, ImportError) and not getattr(signal.getsignal(signal.SIGINT), "pressed", False):
            raise
        traceback.clear_frames(stopped.__traceback__)  # ends `with` blocks that were being entered
        exec("")  # Python keeps a Ctrl-C inside `exec` as unhandled until the next `exec`, and exits because of it
        kept = str(stopped) if isinstance(stopped, KeyboardInterrupt) else ""
        console.err.print(f"stopped: {kept or NOTHING}", style="yellow")
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
        except OSError as error:  # a full device
            _discard_output()
            _say(f"cannot write standard output: {error.strerror}")
            sys.exit(MISTAKE)


def _ended(program: Callable[[], None]) -> None:
    try:
        program()
    except RobotRetargetError as error:
        _say(str(error))
        sys.exit(MISTAKE)
    except Exception as error:
        if isinstance(error, OSError) and error.errno == errno.ENOSPC:
            _discard_output()
            _say(f"cannot write: {error.strerror}")
            sys.exit(MISTAKE)
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


def _named(error: Exception) -> str:
    """An exception's type and the first line of its text."""
    text = str(error).strip().partition("\n")[0]
    return f"{type(error).__name__}: {text}" if text else type(error).__name__


def _say(text: str) -> None:
    console.err.print(f"error: {console.in_options(text)}", style="red")


app: typer.Typer = typer.Typer(
    cls=Interruptible,
    context_settings={"help_option_names": ["-h", "--help"]},
    invoke_without_command=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    help="Carry human motion over to humanoid robots: read, retarget, simulate, export.",
)
