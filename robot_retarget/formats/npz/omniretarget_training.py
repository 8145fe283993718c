"""Format `omniretarget-training`: what holosoma's `convert_data_format_mj.py` makes for training.

`joint_pos` (T, 7 + n) and `joint_vel` (T, 6 + n) **with the root**, w x y z; bodies **with the world** as body 0;
`joint_names` without the root. `body_lin_vel_w` is that of the bodies' centres of mass. Velocities by central differences
over two frames; the root's angular velocity is in the root's axes, as MuJoCo has it (holosoma's script puts it there
in the world's).
"""

from pathlib import Path

import numpy as np

from robot_retarget.base.arrays import Floats
from robot_retarget.base.errors import TrajectoryError
from robot_retarget.base.untrusted.arrays import save_npz, shaped
from robot_retarget.formats.bodies import body_tracks, central, turning, velocities
from robot_retarget.formats.columns import Columns
from robot_retarget.formats.format import TrajectoryFormat
from robot_retarget.formats.npz.omniretarget import moving_body
from robot_retarget.formats.npz.tracking import KEYS
from robot_retarget.formats.robot_motion import RobotMotion
from robot_retarget.formats.source import TrajectorySource

OBJECT = ("object_pos_w", "object_quat_w")
"""Pose of an object, in archives of tasks with one."""


def write(motion: RobotMotion, path: Path) -> None:
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
    poses = moving_body(motion, FORMAT.name)
    if poses is None:
        return {}
    linear, angular = central(poses[:, :3], motion.fps), turning(poses[:, 3:], motion.fps)
    return {OBJECT[0]: poses[:, :3], OBJECT[1]: poses[:, 3:], "object_lin_vel_w": linear, "object_ang_vel_w": angular}


def read(source: TrajectorySource) -> Columns:
    """Read the archive."""
    names = source.names()
    if names is None:
        raise TrajectoryError("no joint_names")
    rows = shaped(source.array("joint_pos"), (None, 7 + len(names)), "joint_pos")
    beside = None
    if OBJECT[0] in source.arrays:
        beside = np.hstack(
            [shaped(source.array(key), (len(rows), width), key) for key, width in zip(OBJECT, (3, 4), strict=True)]
        )
    return Columns(rows[:, 7:], names, rows[:, :3], rows[:, 3:7], source.rate, object=beside)


def claims(source: TrajectorySource) -> bool:
    """Whether the archive has the keys, and positions one column more than velocities, as a free root has."""
    if not set(KEYS) <= source.arrays.keys():
        return False
    positions, rates = source.arrays["joint_pos"], source.arrays["joint_vel"]
    return positions.ndim == rates.ndim == 2 and positions.shape[1] == rates.shape[1] + 1


FORMAT = TrajectoryFormat(
    name="omniretarget-training",
    suffix=".npz",
    description="joints with the root, bodies with the world, with velocities",
    write=write,
    read=read,
    claims=claims,
    readers="holosoma (training)",
    fps=50.0,
    plain=True,
)
