"""The command line. Every command reads files, calls one stage of the package and says what came of it.

A file of this package holds one group of commands; `GROUPS` lists them in the order of `--help`.

Exit codes: 0 done, 1 the verdict is fail, 2 bad input (one or two lines on stderr, nothing written), 70 a defect of the
program, 130 stopped by Ctrl-C, 141 the reader of the output is gone.
"""

from importlib import import_module
from typing import Annotated

import typer

from robot_retarget import __version__
from robot_retarget.tools.cli import console
from robot_retarget.tools.cli.command import app, ending

GROUPS = "studio info solve run view edit judge batch formats play stream servos"

for group in GROUPS.split():
    import_module(f"{__name__}.{group}")


def _say_version(wanted: bool) -> None:
    if wanted:
        print(__version__)
        raise typer.Exit


@app.callback()
def _options(
    context: typer.Context,
    version: Annotated[
        bool, typer.Option("--version", callback=_say_version, is_eager=True, help="Print the version and exit.")
    ] = False,
) -> None:
    if context.invoked_subcommand is None:
        console.say(NEXT)
    else:
        console.begin(context.invoked_subcommand)


NEXT = """robot-retarget carries human motion over to humanoid robots.

  robot-retarget demo                        a shipped clip on a shipped robot, with report and film, in demo/
  robot-retarget run CLIP.bvh                your clip on the op3, judged in simulation, in out/
  robot-retarget run CLIP.bvh -r ROBOT.xml   the same on your robot (MJCF or URDF)
  robot-retarget info FILE                   recognised keypoints of a motion or a robot
  robot-retarget doctor                      missing parts of this machine, and their cures

robot-retarget --help lists all commands; robot-retarget COMMAND --help has an example of each."""
"""The text of the command without arguments."""


def main() -> None:
    """Run the command line."""
    ending(app)
