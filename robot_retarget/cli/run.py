"""`run` and `demo`: everything from a motion to a judged trajectory with its report."""

from pathlib import Path
from typing import Annotated

import typer

from robot_retarget.cli import console
from robot_retarget.cli.options import (
    Balance,
    BodyModel,
    DefaultRobot,
    Draws,
    Feedback,
    Fps,
    Frames,
    Freeze,
    Height,
    Json,
    Legs,
    Limits,
    MotionFile,
    Only,
    Overrides,
    Preset,
    Quiet,
    Repair,
    RobotName,
    SceneFile,
    SceneScale,
    Servos,
    SourceFps,
    Up,
)
from robot_retarget.cli.stages import RetargetOptions, fill_folder, load, read_clip, shipped_clip

commands: typer.Typer = typer.Typer()


@commands.command(epilog="Example: robot-retarget run dance.bvh --robot op3 --out dance")
def run(
    motion: MotionFile,
    robot: DefaultRobot = "",
    out: Annotated[Path, typer.Option("-o", "--out", "--output", help="Folder for the results.")] = Path("out"),
    frames: Frames = None,
    fps: Fps = None,
    source_fps: SourceFps = None,
    body_model: BodyModel = None,
    up: Up = None,
    repair: Repair = True,
    height: Height = None,
    map_file: Overrides = None,
    freeze: Freeze = None,
    only: Only = None,
    limits: Limits = None,
    servos: Servos = None,
    scene: SceneFile = None,
    scene_scale: SceneScale = "human",
    preset: Preset = "balanced",
    legs: Legs = "auto",
    balance: Balance = "auto",
    video: Annotated[bool, typer.Option("--video", help="Make a film as well: video.mp4.")] = False,
    draws: Draws = 10,
    feedback: Feedback = None,
    json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Retarget, warn, simulate, report: trajectory.npz, report.json, report.html, viewer.html, warnings.csv, strip.png."""
    options = RetargetOptions(fps, map_file, legs, balance, preset=preset, scene=scene, scene_scale=scene_scale)
    verdict = fill_folder(
        read_clip(motion, frames, source_fps, body_model, up, repair, height),
        load(robot, limits, servos, freeze, only),
        out,
        options,
        video,
        json,
        draws,
        feedback,
    )
    raise typer.Exit(0 if verdict == "pass" else 1)


@commands.command(epilog="Example: robot-retarget demo --out demo")
def demo(
    out: Annotated[Path, typer.Option("-o", "--out", "--output", help="Folder for the results.")] = Path("demo"),
    clip: Annotated[str, typer.Option(help="A shipped clip.")] = "wave",
    robot: RobotName = "op3",
    legs: Legs = "auto",
    balance: Balance = "auto",
    video: Annotated[bool, typer.Option(help="Make a film as well.")] = True,
    draws: Draws = 10,
    feedback: Feedback = None,
    json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Carry a shipped clip over to the OP3-class robot, simulate it, show it, and play it on emulated servos."""
    options = RetargetOptions(None, None, legs, balance)
    motion = read_clip(shipped_clip(clip), None)
    verdict = fill_folder(motion, load(robot, None), out, options, video, json, draws, feedback, play=True)
    if verdict != "pass" and not json:
        console.say("not played: the verdict is fail")
