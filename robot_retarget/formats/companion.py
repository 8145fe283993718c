"""The bodies around a robot, in an MJCF file next to a motion in a format without them: `dance.csv` has `dance.csv.scene.xml`.

Moving bodies are free bodies, so that trainers simulate them; keyframes hold their poses at each frame of the motion.
"""

from dataclasses import replace
from pathlib import Path

from robot_retarget.base.arrays import Floats
from robot_retarget.base.errors import UsageError
from robot_retarget.base.files import write_text
from robot_retarget.formats.columns import Columns
from robot_retarget.formats.robot_motion import RobotMotion
from robot_retarget.formats.source import TrajectorySource
from robot_retarget.scene import Scene, read_scene
from robot_retarget.scene.mjcf_text import mjcf_file
from robot_retarget.scene.shape import ShapeKind
from robot_retarget.trajectory import Trajectory

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
