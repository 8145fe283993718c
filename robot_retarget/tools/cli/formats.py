"""`export`, `import`, `convert`: motions of robots in the formats of others."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

import robot_retarget as rr
from robot_retarget.tools.cli import console
from robot_retarget.tools.cli import options as opt
from robot_retarget.tools.cli.command import argument, command, option, options

if TYPE_CHECKING:
    from robot_retarget.formats import FormatOptions


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


@options
class FileOptions:
    """A file of others."""

    file: Path = argument("File or folder with the motion of a robot.")


@options
class KnownOptions:
    """The format of a file."""

    format: str | None = option("Its format; by default recognised (export --list).", "--format", "-f", default=None)


@options
class JointOptions:
    """The columns of a file."""

    joints: str | None = option(
        "Names of the joint columns in their order, a,b,…, or a file of them; _ for one to leave out.", default=None
    )


@options
class ColumnOptions(JointOptions):
    """Contents of a file's columns."""

    quaternion: str | None = option(
        "wxyz or xyzw: the root's order in a file that has another than its format.", default=None
    )


@options
class WriteOptions:
    """How a file is written."""

    fps: float | None = option("Frames per second of the output; resampled, the root by slerp.", default=None)
    servos: str | None = option("Servo map of servo-ticks: a shipped robot's name or a TOML file.", default=None)


@options
class ImportOptions(ColumnOptions, WriteOptions):
    """How a file of others is read."""

    source_fps: float | None = option("Frames per second of a file that says none, or says it wrong.", default=None)
    scene: Path | None = option(
        "Scene file of the bodies around the robot; FILE.scene.xml by default.", "--scene", default=None
    )


@options
class FileOutputOptions:
    """Where a motion goes."""

    output: Path = option("The file or folder to write.", *opt.OUT)


@command(epilog="Example: robot-retarget export dance.npz --robot op3 --format csv -o dance.csv")
def export(
    source: opt.TrajectoryOptions,
    robot: opt.RobotOptions,
    to: FileOutputOptions,
    written: WriteOptions,
    columns: JointOptions,
    ends: opt.StandOptions,
    printing: opt.PrintOptions,
    format: Annotated[str, typer.Option("--format", "-f", help="See --list.")] = "csv",
    list: Annotated[
        bool, typer.Option("--list", callback=_list, is_eager=True, help="Print the known formats and exit.")
    ] = False,
) -> None:
    """Write a trajectory in a format that others read."""
    from robot_retarget.edit.stands import between_stands

    options, model = options_of(columns.joints, written.fps, written.servos), robot.load(of=source.trajectory)
    trajectory = between_stands(rr.load_trajectory(source.trajectory), model, ends.stand)
    rr.export(trajectory, model, format, to.output, options)
    printing.result({"output": str(to.output), "format": format}, f"wrote {to.output}")


@command("import", epilog="Example: robot-retarget import dance.pkl --robot unitree_g1.xml --format gmr -o dance.npz")
def import_(
    source: FileOptions,
    robot: opt.RobotOptions,
    to: opt.OutputOptions,
    known: KnownOptions,
    made: ImportOptions,
    printing: opt.PrintOptions,
) -> None:
    """Read a robot's motion that another tool wrote.

    warn, simulate, view and play take the result.
    """
    from robot_retarget.formats import import_motion

    options = options_of(made.joints, made.fps, made.servos, made.source_fps, made.quaternion, made.scene)
    trajectory = import_motion(source.file, robot.load(of=source.file), known.format, options)
    facts = _noted(trajectory) | {"output": str(to.output), "fps": trajectory.fps}
    trajectory.save(to.output)
    frames = f"{len(trajectory)} frames at {trajectory.fps:g} frames per second"
    printing.result(facts, f"wrote {to.output}: {frames}")


@options
class ConvertOptions(ImportOptions):
    """Formats of a motion before and after."""

    to: str = option("Format to write; export --list names all.", "--to", "-t")
    source: str | None = option("Format to read; found out by default.", "--from", "-f", default=None)
    to_joints: str | None = option("As --joints, for the output.", default=None)


@command(
    epilog="Example: robot-retarget convert dance.csv --from unitree --to mjlab --robot unitree_g1.xml -o dance.npz",
)
def convert(
    source: FileOptions, robot: opt.RobotOptions, to: FileOutputOptions, how: ConvertOptions, printing: opt.PrintOptions
) -> None:
    """Read a motion in one format and write it in another."""
    from robot_retarget.formats import import_motion

    model = robot.load(of=source.file)
    read = options_of(how.joints, None, how.servos, how.source_fps, how.quaternion, how.scene)
    trajectory = import_motion(source.file, model, how.source, read)
    facts = _noted(trajectory) | {"output": str(to.output), "format": how.to}
    rr.export(trajectory, model, how.to, to.output, options_of(how.to_joints, how.fps, how.servos))
    printing.result(facts, f"wrote {to.output}")


def _noted(trajectory: "rr.Trajectory") -> dict[str, Any]:
    """Print the notes of a trajectory and return what `--json` says of it."""
    for note in trajectory.notes:
        console.note(note)
    return {"frames": len(trajectory), "notes": [*trajectory.notes]}


def options_of(
    joints: str | None,
    fps: float | None = None,
    servos: str | None = None,
    source_fps: float | None = None,
    quaternion: str | None = None,
    scene: Path | None = None,
) -> "FormatOptions":
    """Return the options of readers and writers from the command line."""
    from robot_retarget.formats import FormatOptions

    return FormatOptions(_names(joints), fps, source_fps, quaternion, servos, scene)


def _names(joints: str | None) -> tuple[str, ...] | None:
    """Return the names in a list with commas, or in a file, one a line or with commas."""
    if joints is None:
        return None
    text = Path(joints).read_text(encoding="utf-8") if "," not in joints and Path(joints).is_file() else joints
    return tuple(name.strip() for name in text.replace("\n", ",").split(",") if name.strip())
