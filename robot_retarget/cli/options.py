"""Options and arguments that several commands share."""

from pathlib import Path
from typing import Annotated, Literal

import typer

from robot_retarget.cli import console
from robot_retarget.cli.kinds import require_motion, require_trajectory

DEFAULT_ROBOT = "op3"


def named_robot(name: str) -> str:
    """The robot that was named, or `DEFAULT_ROBOT` with a note."""
    if not name:
        console.note(f"no --robot given: {DEFAULT_ROBOT} is used")
    return name or DEFAULT_ROBOT


MotionFile = Annotated[
    Path,
    typer.Argument(
        callback=require_motion,
        help="A motion: BVH, AMC, C3D, glTF, GLB, VRMA, SMPL or AMASS, DeepMimic, HumanML3D, landmarks, joint positions; "
        "FILE#NAME where a file holds several.",
    ),
]
SourceFps = Annotated[
    float | None, typer.Option(help="Frames per second of the motion file; overrides the stored rate.")
]
BodyModel = Annotated[
    Path | None, typer.Option(help="Your .npz of an SMPL model, for the skeleton of SMPL parameters; else a mean one.")
]
TrajectoryFile = Annotated[
    Path, typer.Argument(callback=require_trajectory, help="Trajectory .npz, as solve writes it.")
]
RobotName = Annotated[
    str, typer.Option("--robot", "-r", help="A shipped name (op3), an MJCF file, or a robot_descriptions name.")
]
DefaultRobot = Annotated[
    str,
    typer.Option(
        "--robot",
        "-r",
        callback=named_robot,
        help=f"A shipped name (op3), an MJCF file, or a robot_descriptions name; by default {DEFAULT_ROBOT}.",
    ),
]
SceneFile = Annotated[
    Path | None,
    typer.Option("--scene", help="Bodies around the human: a TOML of shapes, or an MJCF or URDF (docs/scenes.md)."),
]
SceneScale = Annotated[
    str,
    typer.Option(
        help="Size of the bodies beside the robot: `human` scales them with the human, 1 keeps their size, or a number."
    ),
]
Json = Annotated[bool, typer.Option("--json", help="Print JSON.")]
Quiet = Annotated[
    bool,
    typer.Option(
        "--quiet",
        "-q",
        callback=console.set_quiet,
        is_eager=True,
        help="Say nothing but errors, and what --json prints.",
    ),
]
"""Has done its work when the command begins."""
Frames = Annotated[
    str | None,
    typer.Option(help="Part of the clip: START:STOP in frames (30:90) or seconds (1s:3s), after what reading drops."),
]
Fps = Annotated[
    float | None, typer.Option(help="Frames per second of the trajectory; by default the motion's own, 30 at most.")
]
Overrides = Annotated[Path | None, typer.Option("--map", help="TOML file that replaces lines of the keypoint map.")]
Thresholds = Annotated[Path | None, typer.Option(help="TOML file with thresholds of the verdict.")]
Legs = Annotated[
    Literal["auto", "follow", "stand"],
    typer.Option(
        help="follow the human's legs, or stand with both feet in place; auto follows if the result is like the human."
    ),
]
Balance = Annotated[
    Literal["auto", "static", "dynamic", "off"],
    typer.Option(
        help="static (centre of mass over the soles), dynamic (zero moment point), off; auto: static for robots with a "
        "servos.toml and for legs that stand."
    ),
]
Preset = Annotated[
    Literal["directions", "balanced", "distances"],
    typer.Option(
        "--preset",
        "--favour",
        help="Weights: favour directions of limbs, distances between parts, or the blend that looks best.",
    ),
]
Edges = Annotated[Path | None, typer.Option(help="TOML file of edges to add, weigh or drop.")]
Freeze = Annotated[
    list[str] | None,
    typer.Option(
        help="Joints that keep their standing angle, waist_*, or another, waist_yaw_joint=0.2 [rad]; repeatable."
    ),
]
Only = Annotated[
    Literal["arms", "upper"] | None,
    typer.Option(help="Move the arms alone, or all but the legs; the other joints keep their standing angles."),
]
Limits = Annotated[Path | None, typer.Option(help="TOML file with joint ranges, speeds and torques the MJCF lacks.")]
Servos = Annotated[
    str | None,
    typer.Option(
        "--servos",
        "-s",
        help="Servo map (.toml) or name of a shipped robot; by default servos.toml in the folder of the MJCF.",
    ),
]
Port = Annotated[str, typer.Option("--port", "-p", help="Serial port, or that of an emulator.")]
Baud = Annotated[int | None, typer.Option(help="Baud rate; the map's by default.")]
Height = Annotated[
    float | None,
    typer.Option(help="Stature of the human [m], which sets the scale; by default the unit of the file."),
]
Up = Annotated[
    str | None,
    typer.Option(help="The axis of the file that points up (x, y, z, -y …); by default inferred from the poses."),
]
Force = Annotated[bool, typer.Option("--force", help="Accept a motion other than the source of the trajectory.")]
Repair = Annotated[
    bool,
    typer.Option(
        "--repair/--no-repair",
        help="Repair defects of the motion (jumps, gaps under 0.3 s, noise), or only report them.",
    ),
]
Feedback = Annotated[
    bool | None,
    typer.Option(
        "--feedback/--no-feedback",
        help="Judge goals with the balance feedback of the servo map's sensor; by default where the robot stands free and the map has one.",
    ),
]
Draws = Annotated[
    int,
    typer.Option(
        min=0,
        help="Worlds with other mass, friction, servos and tilt that it has to stay upright in, nine of ten; 0: none.",
    ),
]
