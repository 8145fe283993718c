"""The command line. Every command reads files, calls one stage of the package and says what came of it.

A file of this package holds one group of commands; `GROUPS` lists them in the order of `--help`.

Exit codes: 0 done, 1 the verdict is fail, 2 bad input (one or two lines on stderr, nothing written), 70 a defect of the
program, 130 stopped by Ctrl-C.
"""

from typing import Annotated

import typer

from robot_retarget import __version__
from robot_retarget.cli import (
    batch,
    cut,
    formats,
    graph,
    info,
    mend,
    play,
    run,
    score,
    servos,
    simulate,
    solve,
    stream,
    view,
    warn,
)
from robot_retarget.cli.ending import Interruptible, ending

GROUPS = (info, graph, solve, run, view, mend, cut, simulate, warn, score, batch, formats, play, stream, servos)

app = typer.Typer(
    cls=Interruptible,
    context_settings={"help_option_names": ["-h", "--help"]},
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    help="Carry human motion over to humanoid robots: read, retarget, simulate, export.",
)
for group in GROUPS:
    app.add_typer(group.commands)


def _say_version(wanted: bool) -> None:
    if wanted:
        print(__version__)
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_say_version, is_eager=True, help="Print the version and exit.")
    ] = False,
) -> None:
    pass  # the option has done its work by then


def main() -> None:
    """Run the command line."""
    ending(app)
