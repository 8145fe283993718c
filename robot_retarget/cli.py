"""The command line. Every command reads files, calls one stage of the package and says what came of it.

Exit codes: 0 done, 1 the verdict is fail, 2 bad input (one or two lines on stderr, nothing written).
"""

import sys
from pathlib import Path
from typing import Annotated

import typer

from robot_retarget import __version__, console
from robot_retarget.cli_servos import play, servos_app
from robot_retarget.cli_stages import (
    Wishes,
    carried_over,
    draw_warnings,
    fill_folder,
    foreseen,
    judged,
    load,
    names_robot,
    play_on_emulated,
    read_clip,
    shipped_clip,
    write_page,
)
from robot_retarget.errors import RobotRetargetError, UsageError
from robot_retarget.shipped import MODELS

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    help="Carry human motion over to humanoid robots: read, retarget, simulate, export.",
)


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


MotionFile = Annotated[Path, typer.Argument(help="BVH file, or joint positions as .npy or .npz.")]
TrajectoryFile = Annotated[Path, typer.Argument(help="Trajectory .npz, as solve writes it.")]
RobotName = Annotated[
    str, typer.Option("--robot", "-r", help="A shipped name (op3), an MJCF file, or a robot_descriptions name.")
]
Json = Annotated[bool, typer.Option("--json", help="Print JSON.")]
Frames = Annotated[str | None, typer.Option(help="Part of the clip, START:STOP in frames of the file.")]
Fps = Annotated[
    float | None, typer.Option(help="Frames per second of the trajectory; by default the motion's own, 30 at most.")
]
Overrides = Annotated[Path | None, typer.Option("--map", help="TOML file that replaces lines of the keypoint map.")]
Thresholds = Annotated[Path | None, typer.Option(help="TOML file that overrides what is still a pass.")]
Legs = Annotated[str, typer.Option(help="follow the human's, or stand: both feet stay where they are.")]
Balance = Annotated[
    str,
    typer.Option(
        help="static (centre of mass over the soles), dynamic (zero moment point), off; auto: static for robots with a "
        "servos.toml and for legs that stand."
    ),
]
Limits = Annotated[Path | None, typer.Option(help="TOML file with joint ranges, speeds and torques the MJCF lacks.")]


@app.command(epilog="Example: robot-retarget info dance.bvh")
def info(
    file: Annotated[str | None, typer.Argument(help="A motion, an MJCF file or a robot's name.")] = None,
    robot: Annotated[
        str | None, typer.Option("--robot", "-r", help="A robot, where its name is also a file's.")
    ] = None,
    limits: Limits = None,
    json: Json = False,
) -> None:
    """Say what a motion or a robot is, and what was recognised in it."""
    from robot_retarget.describe import describe_motion, describe_robot

    if (file is None) == (robot is None):
        raise UsageError("info takes one thing: a motion, an MJCF file, or --robot NAME")
    if robot is not None or names_robot(str(file)):
        facts = describe_robot(load(str(robot or file), limits))
    else:
        facts = describe_motion(read_clip(Path(str(file)), None))
    if json:
        console.dump(facts)
    elif facts["kind"] == "robot":
        console.show_robot(facts)
    else:
        console.show_motion(facts)


@app.command(epilog="Example: robot-retarget solve dance.bvh --robot op3 -o dance.npz")
def solve(
    motion: MotionFile,
    robot: RobotName,
    output: Annotated[Path, typer.Option("-o", "--output", help="The trajectory to write (.npz).")],
    frames: Frames = None,
    fps: Fps = None,
    map_file: Overrides = None,
    limits: Limits = None,
    legs: Legs = "follow",
    balance: Balance = "auto",
    explain: Annotated[bool, typer.Option(help="Print the edges that lost most.")] = False,
    json: Json = False,
) -> None:
    """Retarget a motion: the trajectory only."""
    from robot_retarget.describe import describe_solution
    from robot_retarget.files import require_writable

    require_writable(output)
    wishes = Wishes(fps, map_file, legs, balance)
    result = carried_over(read_clip(motion, frames), load(robot, limits), wishes, quiet=json)
    result.trajectory.save(output)
    facts = describe_solution(result.solution, result.notes)
    if json:
        console.dump(facts)
    else:
        console.show_solution(facts, explain)
        console.say(f"wrote {output}")


@app.command(epilog="Example: robot-retarget run dance.bvh --robot op3 --out dance")
def run(
    motion: MotionFile,
    robot: RobotName,
    out: Annotated[Path, typer.Option(help="Folder for the results.")] = Path("out"),
    frames: Frames = None,
    fps: Fps = None,
    map_file: Overrides = None,
    limits: Limits = None,
    legs: Legs = "follow",
    balance: Balance = "auto",
    json: Json = False,
) -> None:
    """Retarget, warn, simulate, report: trajectory.npz, report.json, report.html, warnings.csv, strip.png, video.mp4."""
    wishes = Wishes(fps, map_file, legs, balance)
    verdict = fill_folder(read_clip(motion, frames), load(robot, limits), out, wishes, json)
    raise typer.Exit(0 if verdict == "pass" else 1)


@app.command(epilog="Example: robot-retarget demo --out demo")
def demo(
    out: Annotated[Path, typer.Option(help="Folder for the results.")] = Path("demo"),
    clip: Annotated[str, typer.Option(help="A shipped clip.")] = "wave",
    robot: RobotName = "op3",
    legs: Legs = "follow",
    balance: Balance = "auto",
    json: Json = False,
) -> None:
    """Carry a shipped clip over to the OP3-class robot, simulate it, show it, and play it on emulated servos."""
    wishes = Wishes(None, None, legs, balance)
    verdict = fill_folder(read_clip(shipped_clip(clip), None), load(robot, None), out, wishes, json)
    if json or not (MODELS / robot / "servos.toml").is_file():
        return
    if verdict == "pass":
        play_on_emulated(robot, out)
    else:
        console.say("not played: the verdict is fail")


@app.command(epilog="Example: robot-retarget simulate dance.npz --robot op3 --mode free")
def simulate(
    trajectory: TrajectoryFile,
    robot: RobotName,
    mode: Annotated[str, typer.Option(help="pinned (the pelvis is held) or free (standing on a floor).")] = "pinned",
    compensate: Annotated[
        bool, typer.Option(help="Send goals that make up for lag and load, or the trajectory as it is.")
    ] = True,
    servos: Annotated[
        bool,
        typer.Option("--servos/--own-actuators", help="Servos by the robot's servos.toml, or the MJCF's actuators."),
    ] = True,
    thresholds: Thresholds = None,
    page: Annotated[Path | None, typer.Option(help="A page with charts to write (.html).")] = None,
    limits: Limits = None,
    json: Json = False,
) -> None:
    """Play a trajectory on simulated servos and pass a verdict."""
    from robot_retarget.files import require_writable
    from robot_retarget.trajectory import load_trajectory

    if page is not None:
        require_writable(page)
    model, played = load(robot, limits), load_trajectory(trajectory)
    warnings = foreseen(played, model)
    report = judged(trajectory, model, mode, compensate, servos, thresholds, warnings)
    if page is not None:
        write_page(report, trajectory, warnings, page)
    if json:
        console.dump(report.contract())
    else:
        console.show_report(report.contract())
    raise typer.Exit(0 if report.verdict == "pass" else 1)


@app.command(epilog="Example: robot-retarget warn dance.npz --robot op3 --plot warnings.png")
def warn(
    trajectory: TrajectoryFile,
    robot: RobotName,
    horizon: Annotated[float, typer.Option(help="How far ahead to look [s].")] = 0.5,
    output: Annotated[Path, typer.Option("-o", "--output", help="The table of events to write (.csv).")] = Path(
        "warnings.csv"
    ),
    plot: Annotated[Path | None, typer.Option(help="A picture of D, distance and α to draw.")] = None,
    limits: Limits = None,
    json: Json = False,
) -> None:
    """Foresee a trajectory's self-collisions, frame by frame, and say what came of each warning."""
    from robot_retarget.files import require_writable
    from robot_retarget.retarget.events import figures_of, write_csv
    from robot_retarget.retarget.warn import WarnOptions, surfaces, warnings_of
    from robot_retarget.trajectory import load_trajectory
    from robot_retarget.view.approaches import require_drawable

    for path in filter(None, (output, plot)):
        require_writable(path)
    if plot is not None:
        require_drawable(plot)
    options = WarnOptions(horizon=horizon)
    model = load(robot, limits)
    known = surfaces(model)
    found = warnings_of(load_trajectory(trajectory), model, options, known)
    write_csv(found.events, output)
    figures = figures_of(found.events, len(found), found.fps) | {"fit_error_m": known.fit_error}
    if json:
        console.dump({"events": [event.contract() for event in found.events], "figures": figures})
    else:
        console.show_warnings([event.contract() for event in found.events], figures)
        console.say(f"wrote {output}")
    if plot is not None:
        draw_warnings(found, plot)


@app.command(epilog="Example: robot-retarget export dance.npz --robot op3 --format csv -o dance.csv")
def export(
    trajectory: TrajectoryFile,
    robot: RobotName,
    output: Annotated[Path, typer.Option("-o", "--output", help="The file to write.")],
    format: Annotated[str, typer.Option("--format", "-f", help="csv or unitree.")] = "csv",
    limits: Limits = None,
) -> None:
    """Write a trajectory in a format that others read."""
    from robot_retarget.export import export as write
    from robot_retarget.trajectory import load_trajectory

    write(load_trajectory(trajectory), load(robot, limits), format, output)
    console.say(f"wrote {output}")


app.add_typer(servos_app, name="servos")
app.command(epilog="Example: robot-retarget play dance.npz --servos op3 --port /dev/ttyUSB0")(play)


def main() -> None:
    """Run the command line; a user's mistake ends in a sentence and exit code 2."""
    try:
        app()
    except RobotRetargetError as error:
        console.err.print(f"error: {error}", markup=False, style="red")
        sys.exit(2)


if __name__ == "__main__":
    main()
