"""OmniRetarget's archives: `omniretarget`, the output of its retargeter, and `omniretarget-training`."""

from pathlib import Path

import numpy as np

from robot_retarget.base.arrays import Floats
from robot_retarget.base.errors import TrajectoryError, UsageError
from robot_retarget.base.untrusted.arrays import save_npz, shaped
from robot_retarget.base.untrusted.rotations import UNIT_NORM
from robot_retarget.formats.bodies import body_tracks, central, turning, velocities
from robot_retarget.formats.columns import Columns
from robot_retarget.formats.robot_motion import RobotMotion
from robot_retarget.formats.source import TrajectorySource, declared
from robot_retarget.formats.tracking import KEYS

# Format `omniretarget`: what OmniRetarget's retargeter saves, and its published set.
#
# `qpos` (T, 7 + n [+ 7 of an object]). The retargeter writes the root **position first**, x y z then w x y z; the set on
# Hugging Face has the **quaternion first**. Both use the same key: the reader tests which of columns 0–3 and 3–6 is a unit quaternion.
# Written position first.
#
# `fps` has two meanings too: holosoma's retargeter writes 30, and its converter `convert_data_format_mj.py` takes the value for
# the seconds between frames and fails at 30. Both take 30 frames per second where the key is absent, so it is not written;
# a stored value below one is read as seconds.

NAMED = {"qpos", "fps", "human_joints", "cost", "joint_names"}
OBJECT = 7
"""Columns of an object's pose behind the joints."""


def write_omniretarget(motion: RobotMotion, path: Path) -> None:
    """Write the archive; a moving body of the scene comes behind the joints.

    Raises:
        UsageError: several bodies move.
    """
    body = moving_body(motion, OMNIRETARGET.name)
    behind = np.zeros((len(motion), 0)) if body is None else body
    qpos = np.column_stack([motion.position, motion.quaternion, motion.angles, behind])
    save_npz(path, qpos=qpos, joint_names=np.array(motion.joints))


def moving_body(motion: RobotMotion, format: str) -> Floats | None:
    """Return the poses (T, 7) of the body that moves in a scene; None without one.

    Raises:
        UsageError: several bodies move.
    """
    scene = motion.trajectory.scene
    moving = [] if scene is None else [k for k, body in enumerate(scene.bodies) if not body.fixed]
    if len(moving) > 1:
        raise UsageError(f"format {format!r} holds one moving body, the trajectory has {len(moving)}")
    return scene.poses(len(motion))[:, moving[0]] if scene is not None and moving else None


def read_omniretarget(source: TrajectorySource) -> Columns:
    """Read the archive.

    Raises:
        TrajectoryError: qpos has another width than root, joints and object, or no order of the root fits.
    """
    qpos = shaped(source.array("qpos"), (None, None), "qpos")
    width = len(source.options.joints or source.names() or source.robot.joint_names)
    if qpos.shape[1] not in (7 + width, 7 + width + OBJECT):
        raise TrajectoryError(
            f"{qpos.shape[1]} columns of qpos; 7 of a root and {width} joints are {7 + width}, with an object {14 + width}"
        )
    root = _root(qpos)
    behind = qpos[:, 7 + width :][:, root] if qpos.shape[1] > 7 + width else None
    free = qpos[:, :7][:, root]
    return Columns(qpos[:, 7 : 7 + width], source.names(), free[:, :3], free[:, 3:], _rate(source), object=behind)


def _rate(source: TrajectorySource) -> float | None:
    """Frames per second, for both meanings of `fps`."""
    stored = source.rate
    if stored is None:
        return source.sidecar_fps
    return 1 / stored if 0 < stored < 1 else stored


def _root(qpos: Floats) -> list[int]:
    """Return the columns of position and quaternion of a free body, in the order of the file.

    Raises:
        TrajectoryError: both or neither of the two places hold unit quaternions.
    """
    first, second = (np.abs(np.linalg.norm(qpos[:, k : k + 4], axis=1) - 1).max() < UNIT_NORM for k in (0, 3))
    if first == second:
        what = "both columns 0–3 and 3–6 are" if first else "neither columns 0–3 nor 3–6 are"
        raise TrajectoryError(f"{what} unit quaternions: the order of the root is ambiguous")
    return [4, 5, 6, 0, 1, 2, 3] if first else [0, 1, 2, 3, 4, 5, 6]


OMNIRETARGET = declared(
    "omniretarget", write_omniretarget, read_omniretarget, lambda source: {"qpos"} <= source.arrays.keys() <= NAMED
)


# Format `omniretarget-training`: what holosoma's `convert_data_format_mj.py` makes for training.
#
# `joint_pos` (T, 7 + n) and `joint_vel` (T, 6 + n) **with the root**, w x y z; bodies **with the world** as body 0;
# `joint_names` without the root. `body_lin_vel_w` is that of the bodies' centres of mass. Velocities by central differences
# over two frames; the root's angular velocity is in the root's axes, as MuJoCo has it (holosoma's script puts it there
# in the world's).

OBJECT_KEYS = ("object_pos_w", "object_quat_w")
"""Pose of an object, in archives of tasks with one."""


def write_training(motion: RobotMotion, path: Path) -> None:
    """Write the archive; a moving body of the scene has `object_…` arrays.

    Raises:
        UsageError: several bodies move.
    """
    qvel, model = velocities(motion), motion.robot.model
    tracks = body_tracks(motion, qvel)
    save_npz(
        path,
        fps=np.array([motion.fps]),
        joint_pos=motion.qpos,
        joint_vel=qvel,
        body_pos_w=tracks.positions,
        body_quat_w=tracks.quaternions,
        body_lin_vel_w=tracks.linear_of_mass,
        body_ang_vel_w=tracks.angular,
        joint_names=np.array(motion.robot.joint_names),
        body_names=np.array([model.body(b).name for b in range(model.nbody)]),
        **_object(motion),
    )


def _object(motion: RobotMotion) -> dict[str, Floats]:
    """Return the arrays of a moving body: its pose, and its velocities in the world [m/s, rad/s]; none without one."""
    poses = moving_body(motion, TRAINING.name)
    if poses is None:
        return {}
    linear, angular = central(poses[:, :3], motion.fps), turning(poses[:, 3:], motion.fps)
    return {
        OBJECT_KEYS[0]: poses[:, :3],
        OBJECT_KEYS[1]: poses[:, 3:],
        "object_lin_vel_w": linear,
        "object_ang_vel_w": angular,
    }


def read_training(source: TrajectorySource) -> Columns:
    """Read the archive."""
    names = source.names()
    if names is None:
        raise TrajectoryError("no joint_names")
    rows = shaped(source.array("joint_pos"), (None, 7 + len(names)), "joint_pos")
    beside = None
    if OBJECT_KEYS[0] in source.arrays:
        beside = np.hstack(
            [shaped(source.array(key), (len(rows), width), key) for key, width in zip(OBJECT_KEYS, (3, 4), strict=True)]
        )
    return Columns(rows[:, 7:], names, rows[:, :3], rows[:, 3:7], source.rate, object=beside)


def claims_training(source: TrajectorySource) -> bool:
    """Whether the archive has the keys, and positions one column more than velocities, as a free root has."""
    if not set(KEYS) <= source.arrays.keys():
        return False
    positions, rates = source.arrays["joint_pos"], source.arrays["joint_vel"]
    return positions.ndim == rates.ndim == 2 and positions.shape[1] == rates.shape[1] + 1


TRAINING = declared("omniretarget-training", write_training, read_training, claims_training)
