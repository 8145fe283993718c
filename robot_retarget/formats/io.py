"""Trajectories into files of others and out of them."""

from dataclasses import replace
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules

from robot_retarget.base.arrays import Floats
from robot_retarget.base.errors import FileError, TrajectoryError, UsageError, known
from robot_retarget.base.files import replacing, replacing_folder, require_writable, write_text
from robot_retarget.base.untrusted.limits import refusing
from robot_retarget.formats.columns import Columns, assembled, doubt, holds, reordered
from robot_retarget.formats.robot_motion import FormatOptions, RobotMotion, continuous, robot_motion
from robot_retarget.formats.source import ROWS, TrajectoryFormat, TrajectorySource, sidecar_path, sidecar_text
from robot_retarget.robot.catalog import Played, as_robot, on_robot
from robot_retarget.robot.model import Robot
from robot_retarget.robot.timing import resample
from robot_retarget.scene import Scene, read_scene
from robot_retarget.scene.mjcf import mjcf_file
from robot_retarget.scene.shape import ShapeKind
from robot_retarget.trajectory import Trajectory
from robot_retarget.trajectory import load_trajectory as load_native

# The table of formats: those of the modules of this folder, in the order of `formats.toml`; a new format is a row there and `declared` in a module.

_NAMES = {module.name for module in iter_modules([str(Path(__file__).parent)])} - {"io"}
_MODULES = [import_module(f"robot_retarget.formats.{name}") for name in _NAMES]
_FOUND = {one.name: one for module in _MODULES for one in vars(module).values() if isinstance(one, TrajectoryFormat)}
FORMATS: dict[str, TrajectoryFormat] = {name: _FOUND[name] for name in ROWS}


OBJECT_LEFT_OUT = "The object's pose is left out: the file has no shape for it. Name the file of its scene (--scene)."


def companion_path(path: Path) -> Path:
    """Where the bodies of a motion stand."""
    return path.with_name(path.name + ".scene.xml")


def write_companion(motion: RobotMotion, target: Path) -> None:
    """Write the bodies of a motion next to it; without bodies remove those of an earlier motion."""
    scene, where = motion.trajectory.scene, companion_path(target)
    if scene is None:
        where.unlink(missing_ok=True)
    else:
        write_text(where, mjcf_file(scene, len(motion), motion.fps))


def among_bodies(trajectory: Trajectory, columns: Columns, source: TrajectorySource) -> Trajectory:
    """Return a trajectory with the bodies of its file, of the user's scene, or of the file next to it.

    Raises:
        SceneError: the scene cannot be read.
        TrajectoryError: the bodies have another number of frames.
        UsageError: a joint of a human carries a body, or it is not clear which body the file moves.
    """
    given = source.options.scene or companion_path(source.path)
    known = source.options.scene is not None or given.is_file()
    scene = read_scene(given) if known and columns.scene is None else columns.scene
    if scene is None:
        return trajectory if columns.object is None else replace(trajectory, notes=(*trajectory.notes, OBJECT_LEFT_OUT))
    carried = next((body for body in scene.bodies if body.carrier), None)
    if carried is not None:
        raise UsageError(f"{carried.title}: joint {carried.carrier!r} of a human carries it; the file holds a robot")
    if columns.object is not None and scene.frames is None:
        scene = _moved(scene, columns.object)
    return replace(trajectory, scene=scene)


def _moved(scene: Scene, poses: Floats) -> Scene:
    """Return a scene with the poses (T, 7) of a file for its only body that is no plane."""
    solid = [body for body in scene.bodies if body.shape.kind is not ShapeKind.PLANE]
    if len(solid) != 1:
        raise UsageError(
            f"the file moves one body, and {scene.source} has {len(solid)}: give a scene with that one alone"
        )
    bodies = tuple(replace(body, poses=poses) if body is solid[0] else body for body in scene.bodies)
    return replace(scene, bodies=bodies)


SENTENCES = (
    (
        ("action_traj",),
        "a file of ToddlerBot that holds motor positions only. Open it in robot-keyframe-kit, play it and save it: that "
        "file holds qpos",
    ),
    (
        ("keyframes",),
        "keyframes of ToddlerBot without a motion between them. Open it in robot-keyframe-kit, play it and save it",
    ),
)
"""Keys of a pickled dictionary, and the sentence about it."""


def unsupported(source: TrajectorySource) -> str:
    """The sentence about a file of a known program; empty for any other."""
    return next((sentence for keys, sentence in SENTENCES if holds(source.pickled, *keys)), "")


def export(
    trajectory: Played,
    robot: Robot | str | Path | None,
    format: str,
    path: str | Path,
    options: FormatOptions | None = None,
) -> Path:
    """Write a trajectory in one of the `FORMATS`, whole or not at all.

    A format without joint names and quaternion order gets a JSON file next to it that states them, one without the bodies of a
    scene an MJCF file that holds them.

    Args:
        trajectory: a result of `retarget`, a trajectory, or its file.
        robot: a robot, or a name or model file that `load_robot` loads; None takes the trajectory's.
        format: one of the `FORMATS`.

    Raises:
        UsageError: the format is not known, or the robot does not suit it.
        TrajectoryError: the trajectory belongs to another robot.
        OutputError: the file cannot be written.
    """
    kind, options, target = _format(format), options or FormatOptions(), Path(path)
    played, model = on_robot(trajectory, robot)
    motion = robot_motion(played, model, options, kind.fps, kind.ordered, kind.name)
    if kind.plain:
        motion.require_plain(kind.name)
    for beside, needed in ((sidecar_path, not kind.complete), (companion_path, motion.trajectory.scene is not None)):
        if needed:
            require_writable(beside(target))
    with (replacing if kind.suffix else replacing_folder)(target) as scratch:
        kind.write(motion, scratch)
        message = "" if kind.complete else sidecar_text(motion, kind.name, kind.quaternion, scratch)
    if message:
        write_text(sidecar_path(target), message)
    if not kind.bodies:
        write_companion(motion, target)
    return target


def import_motion(
    path: str | Path, robot: Robot | str | Path, format: str | None = None, options: FormatOptions | None = None
) -> Trajectory:
    """Read the motion of a robot from a file in any of the `FORMATS`.

    Args:
        format: one of the `FORMATS`; None finds out, and asks where more than one fits.

    Raises:
        UsageError: the format is not known, or more than one fits the file.
        TrajectoryError: no format fits, or the file is not as its format has it; names the file.
    """
    where, robot, options = Path(path), as_robot(robot), options or FormatOptions()
    if not where.exists():
        raise TrajectoryError(f"cannot read {where}: the file or folder does not exist")
    source = TrajectorySource(where, robot, options)
    kind = _format(format) if format else recognised(source)
    found = _read(source, kind)
    trajectory = found if found.source else replace(found, source=str(where))
    return trajectory if options.fps is None else resample(trajectory, robot, options.fps)


def _read(source: TrajectorySource, kind: TrajectoryFormat) -> Trajectory:
    """The trajectory in a file of a format; errors name the file."""
    described = source.sidecar is not None
    try:
        with refusing(source.path, kind.name):
            found = kind.read(source)
            if isinstance(found, Trajectory):
                return found
            return among_bodies(_of_robot(found, kind, source, described), found, source)
    except (FileError, TrajectoryError) as error:
        raise TrajectoryError(_about(source.path, kind, error)) from None


def _of_robot(columns: Columns, kind: TrajectoryFormat, source: TrajectorySource, described: bool) -> Trajectory:
    """A trajectory of the robot from columns, with a note where the order of the quaternions is in doubt.

    Args:
        described: a JSON file next to the file states the order.
    """
    robot, given = source.robot, source.options.quaternion
    if given is not None:
        if columns.quaternion is None:
            raise UsageError(f"--quaternion: format {kind.name!r} holds none whose order could be another")
        columns = replace(columns, quaternion=reordered(columns.quaternion, kind.quaternion, given))
    trajectory = continuous(assembled(columns, robot, source.options, kind.fps), robot)
    if given is not None or columns.quaternion is None or kind.complete or described:
        return trajectory
    return replace(trajectory, notes=(*trajectory.notes, *doubt(columns.quaternion, kind.quaternion, robot)))


def load_trajectory(
    path: str | Path,
    robot: Robot | str | Path | None = None,
    format: str | None = None,
    options: FormatOptions | None = None,
) -> Trajectory:
    """Read a trajectory file, or with a robot the file of any known format.

    Raises:
        TrajectoryError, UsageError: as `import_motion`; without a robot, it is no trajectory file of this package.
    """
    return load_native(path) if robot is None else import_motion(path, robot, format, options)


def recognised(source: TrajectorySource) -> TrajectoryFormat:
    """The format of a file: the one in the JSON file next to it, or the only one that claims it.

    Raises:
        UsageError: more than one claims it.
        TrajectoryError: none does.
    """
    if source.sidecar and source.sidecar["format"] in FORMATS:
        return FORMATS[source.sidecar["format"]]
    try:
        with refusing(source.path, "file of robot motion"):
            claimed = [kind for kind in FORMATS.values() if kind.claims(source)]
    except FileError as error:
        raise TrajectoryError(str(error)) from error
    if len(claimed) > 1:
        names = " or ".join(kind.name for kind in claimed)
        raise UsageError(f"{source.path} may be {names}, which have equal contents: choose one with --format")
    if not claimed:
        raise TrajectoryError(
            f"{source.path}: {unsupported(source) or f'no known format of robot motion (a human motion goes to robot-retarget run); {known(FORMATS)}'}"
        )
    return claimed[0]


def _format(name: str) -> TrajectoryFormat:
    if name not in FORMATS:
        raise UsageError(f"unknown format {name!r}; {known(FORMATS, len(FORMATS), typed=name)}")
    return FORMATS[name]


def _about(path: Path, kind: TrajectoryFormat, error: FileError | TrajectoryError) -> str:
    message = str(error).removeprefix(f"{path}: ")
    return message if message.startswith((str(path), "cannot read")) else f"{path} as {kind.name!r}: {message}"
