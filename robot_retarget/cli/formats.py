"""`export`, `import`, `convert`: motions of robots in the formats of others."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from robot_retarget.cli import console
from robot_retarget.cli.options import Json, Limits, Quiet, RobotName, TrajectoryFile
from robot_retarget.cli.stages import load

if TYPE_CHECKING:
    from robot_retarget.formats import FormatOptions

commands: typer.Typer = typer.Typer()


def _list(wanted: bool) -> None:
    if not wanted:
        return
    from robot_retarget.formats import FORMATS

    rows = [
        (kind.name, kind.suffix or "folder", f"{kind.fps:g} fps" if kind.fps else "", kind.description, kind.readers)
        for kind in FORMATS.values()
    ]
    console.table("", ("format", "file", "rate", "holds", "read by"), rows)
    raise typer.Exit


MotionOfRobot = Annotated[Path, typer.Argument(help="File or folder with the motion of a robot.")]
FileFormat = Annotated[
    str | None, typer.Option("--format", "-f", help="Its format; found out by default. export --list names all.")
]
Rate = Annotated[float | None, typer.Option(help="Frames per second of the output; resampled, the root by slerp.")]
SourceRate = Annotated[float | None, typer.Option(help="Frames per second of a file that says none, or says it wrong.")]
Joints = Annotated[
    str | None,
    typer.Option(help="Names of the joint columns in their order, a,b,…, or a file of them; _ for one to leave out."),
]
Quaternion = Annotated[
    str | None, typer.Option(help="wxyz or xyzw: the root's order in a file that has another than its format.")
]
Servos = Annotated[str | None, typer.Option(help="Servo map of servo-ticks: a shipped robot's name or a TOML file.")]
List = Annotated[bool, typer.Option("--list", callback=_list, is_eager=True, help="Print the known formats and exit.")]


@commands.command(epilog="Example: robot-retarget export dance.npz --robot op3 --format csv -o dance.csv")
def export(
    trajectory: TrajectoryFile,
    robot: RobotName,
    output: Annotated[Path, typer.Option("-o", "--out", "--output", help="The file or folder to write.")],
    format: Annotated[str, typer.Option("--format", "-f", help="See --list.")] = "csv",
    fps: Rate = None,
    joints: Joints = None,
    servos: Servos = None,
    limits: Limits = None,
    json: Json = False,
    quiet: Quiet = False,
    list: List = False,
) -> None:
    """Write a trajectory in a format that others read."""
    from robot_retarget.formats import export as write
    from robot_retarget.trajectory import load_trajectory

    options = options_of(joints, fps, servos)
    write(load_trajectory(trajectory), load(robot, limits), format, output, options)
    console.show_result({"output": str(output), "format": format}, f"wrote {output}", json)


@commands.command(
    "import", epilog="Example: robot-retarget import dance.pkl --robot unitree_g1.xml --format gmr -o dance.npz"
)
def import_(
    file: MotionOfRobot,
    robot: RobotName,
    output: Annotated[Path, typer.Option("-o", "--out", "--output", help="The trajectory to write (.npz).")],
    format: FileFormat = None,
    fps: Rate = None,
    source_fps: SourceRate = None,
    joints: Joints = None,
    quaternion: Quaternion = None,
    servos: Servos = None,
    limits: Limits = None,
    json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Read the motion of a robot that others made, for warn, simulate, view and play."""
    from robot_retarget.formats import import_motion

    trajectory = import_motion(
        file, load(robot, limits), format, options_of(joints, fps, servos, source_fps, quaternion)
    )
    for note in trajectory.notes:
        console.note(note)
    trajectory.save(output)
    facts = {"output": str(output), "frames": len(trajectory), "fps": trajectory.fps, "notes": list(trajectory.notes)}
    console.show_result(
        facts, f"wrote {output}: {len(trajectory)} frames at {trajectory.fps:g} frames per second", json
    )


@commands.command(
    epilog="Example: robot-retarget convert dance.csv --from unitree --to mjlab --robot unitree_g1.xml -o dance.npz"
)
def convert(
    file: MotionOfRobot,
    robot: RobotName,
    to: Annotated[str, typer.Option("--to", "-t", help="Format to write; export --list names all.")],
    output: Annotated[Path, typer.Option("-o", "--out", "--output", help="The file or folder to write.")],
    source: Annotated[str | None, typer.Option("--from", "-f", help="Format to read; found out by default.")] = None,
    fps: Rate = None,
    source_fps: SourceRate = None,
    joints: Joints = None,
    quaternion: Quaternion = None,
    to_joints: Annotated[str | None, typer.Option(help="As --joints, for the output.")] = None,
    servos: Servos = None,
    limits: Limits = None,
    json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Read a motion in one format and write it in another."""
    from robot_retarget.formats import export as write
    from robot_retarget.formats import import_motion

    model = load(robot, limits)
    trajectory = import_motion(file, model, source, options_of(joints, None, servos, source_fps, quaternion))
    for note in trajectory.notes:
        console.note(note)
    write(trajectory, model, to, output, options_of(to_joints, fps, servos))
    facts = {"output": str(output), "format": to, "frames": len(trajectory), "notes": list(trajectory.notes)}
    console.show_result(facts, f"wrote {output}", json)


def options_of(
    joints: str | None,
    fps: float | None,
    servos: str | None,
    source_fps: float | None = None,
    quaternion: str | None = None,
) -> "FormatOptions":
    """Return the options of readers and writers from the command line."""
    from robot_retarget.formats import FormatOptions

    return FormatOptions(_names(joints), fps, source_fps, quaternion, servos)


def _names(joints: str | None) -> tuple[str, ...] | None:
    """The names in a list with commas, or in a file, one a line or with commas."""
    if joints is None:
        return None
    text = Path(joints).read_text(encoding="utf-8") if "," not in joints and Path(joints).is_file() else joints
    return tuple(name.strip() for name in text.replace("\n", ",").split(",") if name.strip())
