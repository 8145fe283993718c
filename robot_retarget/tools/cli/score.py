"""`score`: the figures by which retargeters are compared."""

from pathlib import Path
from typing import TYPE_CHECKING

import typer

from robot_retarget.base.errors import TrajectoryError
from robot_retarget.tools.cli import console
from robot_retarget.tools.cli.command import argument, command, option, options
from robot_retarget.tools.cli.formats import ColumnOptions, KnownOptions, options_of
from robot_retarget.tools.cli.options import OUT, MapOptions, PrintOptions, ReadOptions, RobotOptions

if TYPE_CHECKING:
    from robot_retarget.human.motion import Motion
    from robot_retarget.trajectory import Trajectory

commands: typer.Typer = typer.Typer()


@options
class ScoreOptions(ColumnOptions, KnownOptions, MapOptions, ReadOptions):
    """The motion of a robot and of the human."""

    trajectory: Path = argument("File or folder with the motion of a robot.")
    motion: Path | None = option(
        "The human motion it comes from; without one, figures of the robot.", "--motion", "-m", default=None
    )
    rate: float | None = option("Frames per second of a file that says none, or says it wrong.", default=None)
    source_fps: float | None = option(
        "Frames per second of the motion file; overrides the file.", "--motion-fps", default=None
    )
    repair: bool = option("Repair defects of the motion, as solve does.", default=False)
    output: Path | None = option("A JSON file to write.", *OUT, default=None)


@command(commands, epilog="Example: robot-retarget score dance.npz --robot op3 --motion dance.bvh")
def score(scored: ScoreOptions, robot: RobotOptions, printing: PrintOptions) -> None:
    """Score any known file of robot motion: likeness to the human, contacts, feet, limits, smoothness, physics."""
    from robot_retarget.base.files import require_writable, write_text
    from robot_retarget.formats import import_motion
    from robot_retarget.scores.score import score as measure

    if scored.output is not None:
        require_writable(scored.output)
    model, options = robot.load(), options_of(scored.joints, source_fps=scored.rate, quaternion=scored.quaternion)
    played = import_motion(scored.trajectory, model, scored.format, options)
    human = None if scored.motion is None else scored.read(scored.motion)
    if human is not None and played.source != str(scored.trajectory):  # other tools' files name no motion
        _note_source(played, human)
    found = measure(played, model, human, overrides=scored.map_file)
    if scored.output is not None:
        write_text(scored.output, console.as_json(found.contract()) + "\n")
    printing.show(found.contract(), lambda _: console.show_score(found))


def _note_source(played: "Trajectory", human: "Motion") -> None:
    """Say that a trajectory names another motion as its source than the one it is compared with."""
    try:
        played.require_source(human.source, human.source_sha256)
    except TrajectoryError as error:
        console.note(f"{error}; the figures compare them all the same")
