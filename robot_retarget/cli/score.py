"""`score`: the figures by which retargeters are compared."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from robot_retarget.cli import console
from robot_retarget.cli.formats import FileFormat, Joints, MotionOfRobot, Quaternion, SourceRate, options_of
from robot_retarget.cli.options import BodyModel, Frames, Json, Limits, Overrides, Quiet, RobotName, Up
from robot_retarget.cli.stages import load, read_clip
from robot_retarget.errors import TrajectoryError

if TYPE_CHECKING:
    from robot_retarget.motion import Motion
    from robot_retarget.trajectory import Trajectory

commands: typer.Typer = typer.Typer()


@commands.command(epilog="Example: robot-retarget score dance.npz --robot op3 --motion dance.bvh")
def score(
    trajectory: MotionOfRobot,
    robot: RobotName,
    motion: Annotated[
        Path | None,
        typer.Option("--motion", "-m", help="The human motion it comes from; without one, figures of the robot."),
    ] = None,
    frames: Frames = None,
    map_file: Overrides = None,
    format: FileFormat = None,
    rate: SourceRate = None,
    joints: Joints = None,
    quaternion: Quaternion = None,
    motion_fps: Annotated[
        float | None, typer.Option(help="Frames per second of the motion file; overrides the file.")
    ] = None,
    body_model: BodyModel = None,
    up: Up = None,
    limits: Limits = None,
    output: Annotated[Path | None, typer.Option("-o", "--out", "--output", help="A JSON file to write.")] = None,
    json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Score any known file of robot motion: likeness to the human, contacts, feet, limits, smoothness, physics."""
    from robot_retarget.files import replacing, require_writable
    from robot_retarget.formats import import_motion
    from robot_retarget.score.score import score as measure

    if output is not None:
        require_writable(output)
    model = load(robot, limits)
    played = import_motion(trajectory, model, format, options_of(joints, None, None, rate, quaternion))
    human = None if motion is None else read_clip(motion, frames, motion_fps, body_model, up, repair=False)
    if human is not None and played.source != str(trajectory):  # other tools' files name no motion
        _note_source(played, human)
    found = measure(played, model, human, overrides=map_file)
    if output is not None:
        with replacing(output) as scratch:
            scratch.write_text(console.as_json(found.contract()) + "\n", encoding="utf-8")
    if json:
        console.dump(found.contract())
    else:
        console.show_score(found)


def _note_source(played: "Trajectory", human: "Motion") -> None:
    """Say that a trajectory names another motion as its source than the one it is compared with."""
    try:
        played.require_source(human.source, human.source_sha256)
    except TrajectoryError as error:
        console.note(f"{error}; the figures compare them all the same")
