"""The command line. Every command reads files, calls one stage of the package and says what came of it.

Exit codes: 0 done, 1 the verdict is fail, 2 bad input (one or two lines on stderr, nothing written).
"""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from robot_retarget import console
from robot_retarget.cli_servos import play, servos_app
from robot_retarget.errors import RobotRetargetError, UsageError
from robot_retarget.shipped import MODELS

if TYPE_CHECKING:
    from robot_retarget.motion import Motion
    from robot_retarget.retarget.transfer import Result
    from robot_retarget.retarget.warn import Warnings
    from robot_retarget.robot import Robot
    from robot_retarget.simulate.report import Report
    from robot_retarget.trajectory import Trajectory

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    help="Carry human motion over to humanoid robots: read, retarget, simulate, export.",
)

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
    if robot is not None or _is_robot(str(file)):
        facts = describe_robot(_load_robot(str(robot or file), limits))
    else:
        facts = describe_motion(_read(Path(str(file)), None))
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
    wishes = _Wishes(fps, map_file, legs, balance)
    result = _retarget(_read(motion, frames), _load_robot(robot, limits), wishes, quiet=json)
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
    wishes = _Wishes(fps, map_file, legs, balance)
    verdict = _run(_read(motion, frames), _load_robot(robot, limits), out, wishes, json)
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
    wishes = _Wishes(None, None, legs, balance)
    verdict = _run(_read(_sample(clip), None), _load_robot(robot, None), out, wishes, json)
    if json or not (MODELS / robot / "servos.toml").is_file():
        return
    if verdict == "pass":
        _play_emulated(robot, out)
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
    model, played = _load_robot(robot, limits), load_trajectory(trajectory)
    warnings = _warnings(played, model)
    report = _simulate(trajectory, model, mode, compensate, servos, thresholds, warnings)
    if page is not None:
        _write_page(report, trajectory, warnings, page)
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

    for path in filter(None, (output, plot)):
        require_writable(path)
    options = WarnOptions(horizon=horizon)
    model = _load_robot(robot, limits)
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
        _plot_warnings(found, plot)


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

    write(load_trajectory(trajectory), _load_robot(robot, limits), format, output)
    console.say(f"wrote {output}")


app.add_typer(servos_app, name="servos")
app.command(epilog="Example: robot-retarget play dance.npz --servos op3 --port /dev/ttyUSB0")(play)


@dataclass(frozen=True)
class _Wishes:
    """What a user may say about how a motion is retargeted."""

    fps: float | None
    map_file: Path | None
    legs: str
    balance: str


def _run(motion: "Motion", robot: "Robot", out: Path, wishes: _Wishes, json: bool) -> str:
    """Solve, simulate (standing free what was balanced, else held), show: fill a folder. Returns the verdict."""
    from robot_retarget.describe import describe_solution
    from robot_retarget.files import folder
    from robot_retarget.retarget.events import write_csv
    from robot_retarget.simulate.rollout import simulate as roll_out

    target = folder(out)
    result = _retarget(motion, robot, wishes, quiet=json)
    result.trajectory.save(target / "trajectory.npz")
    warnings = result.warnings if len(result.trajectory) > 1 else None
    mode = "free" if result.balance else "pinned"
    report = roll_out(result.trajectory, robot, mode=mode, warnings=warnings)
    report.save(target / "report.json")
    if warnings is not None:
        write_csv(warnings.events, target / "warnings.csv")
    _show(result, robot, target, quiet=json)
    pictures = target / "strip.png", target / "video.mp4"
    _write_page(report, target / "trajectory.npz", warnings, target / "report.html", *pictures)
    solved = describe_solution(result.solution, result.notes)
    if json:
        files = sorted(path.name for path in target.iterdir())
        console.dump({"solution": solved, "report": report.contract(), "folder": str(target), "files": files})
    else:
        console.show_solution(solved, explain=False)
        console.show_report(report.contract())
        console.say(f"wrote {', '.join(sorted(p.name for p in target.iterdir()))} in {target}")
    return report.verdict


def _simulate(
    path: Path,
    robot: "Robot",
    mode: str,
    compensate: bool,
    servos: bool,
    thresholds: Path | None,
    warnings: "Warnings | None",
) -> "Report":
    from robot_retarget.simulate.rollout import simulate as roll_out
    from robot_retarget.simulate.thresholds import read_thresholds

    most = None if thresholds is None else read_thresholds(thresholds)
    drives = "auto" if servos else None
    return roll_out(path, robot, mode=mode, drives=drives, compensate=compensate, thresholds=most, warnings=warnings)


def _warnings(trajectory: "Trajectory", robot: "Robot") -> "Warnings | None":
    """The warnings of a trajectory; a single frame has no next one to warn of."""
    from robot_retarget.retarget.warn import warnings_of

    return warnings_of(trajectory, robot) if len(trajectory) > 1 else None


def _play_emulated(robot: str, folder: Path) -> None:
    """Play the folder's trajectory on an emulated bus with the robot's model behind it, and say how it went."""
    from robot_retarget.servo.emulated import followed, play_emulated
    from robot_retarget.servo.map import load_map
    from robot_retarget.trajectory import load_trajectory

    console.say("\nplaying on the emulated robot, in real time")
    outcome = play_emulated(load_trajectory(folder / "trajectory.npz"), load_map(robot), log=folder / "play.npz")
    console.table("", ("playback", "value"), [(k, v) for k, v in followed(outcome).items()])


def _show(result: "Result", robot: "Robot", target: Path, quiet: bool) -> None:
    """Draw the strip and the film; what cannot be drawn is said."""
    from robot_retarget.view import Picture, Unavailable, strip, video

    human = result.match.human_positions(result.motion)
    bones = result.match.bones
    picture = strip(robot, result.trajectory, human, bones)
    if isinstance(picture, Picture):
        picture.save(target / "strip.png")
    with console.progress("film", quiet) as advance:
        film = video(robot, result.trajectory, target / "video.mp4", human, bones, progress=advance)
    for sentence in {what.reason if isinstance(what, Unavailable) else what.note for what in (picture, film)} - {""}:
        console.note(sentence)


def _write_page(
    report: "Report",
    trajectory: Path,
    warnings: "Warnings | None",
    page: Path,
    strip: Path | None = None,
    film: Path | None = None,
) -> None:
    """Write the report's page; what hinders it is said."""
    from robot_retarget.view import Unavailable
    from robot_retarget.view.page import save_page

    drawn = save_page(report, trajectory, page, warnings=warnings, strip=strip, film=film)
    if isinstance(drawn, Unavailable):
        console.note(drawn.reason)


def _plot_warnings(warnings: "Warnings", path: Path) -> None:
    """Draw the pairs that were flagged; what cannot be drawn is said."""
    from robot_retarget.view import Unavailable
    from robot_retarget.view.approaches import plot_warnings

    drawn = plot_warnings(warnings, path)
    console.note(drawn.reason if isinstance(drawn, Unavailable) else f"drew {drawn}")


def _retarget(motion: "Motion", robot: "Robot", wishes: _Wishes, quiet: bool) -> "Result":
    from robot_retarget.retarget.transfer import retarget

    with console.progress(f"retarget to {robot.name}", quiet) as advance:
        return retarget(
            motion,
            robot,
            fps=wishes.fps,
            overrides=wishes.map_file,
            legs=wishes.legs,
            balance=wishes.balance,
            progress=advance,
        )


def _read(path: Path, frames: str | None) -> "Motion":
    from robot_retarget.motion import read_motion

    motion = read_motion(path)
    if frames is None:
        return motion
    start, colon, stop = frames.partition(":")
    try:
        return motion.frames(int(start or 0), int(stop) if stop else len(motion) if colon else int(start) + 1)
    except ValueError:
        raise UsageError(f"--frames takes START:STOP in whole numbers, got {frames!r}") from None


def _load_robot(name: str, limits: Path | None) -> "Robot":
    from robot_retarget.robot import load_robot

    return load_robot(name, limits)


def _is_robot(name: str) -> bool:
    from robot_retarget.robot import shipped_robots

    path = Path(name)
    return (
        path.suffix.lower() in (".xml", ".mjcf") or name in shipped_robots() or (not path.suffix and not path.exists())
    )


def _sample(name: str) -> Path:
    from robot_retarget.errors import known
    from robot_retarget.shipped import SAMPLES

    clips = {path.stem: path for path in sorted(SAMPLES.glob("*.bvh"))}
    if name not in clips:
        raise UsageError(f"no shipped clip {name!r}; {known(clips)}")
    return clips[name]


def main() -> None:
    """Run the command line; a user's mistake ends in a sentence and exit code 2."""
    try:
        app()
    except RobotRetargetError as error:
        console.err.print(f"error: {error}", markup=False, style="red")
        sys.exit(2)


if __name__ == "__main__":
    main()
