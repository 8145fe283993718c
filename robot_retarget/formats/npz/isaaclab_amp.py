"""Format `isaaclab-amp`: the archive of Isaac Lab's humanoid AMP, joints and bodies by name.

`fps`, `dof_names` (n,), `body_names` (B,), `dof_positions`, `dof_velocities` (T, n) [rad, rad/s], `body_positions` (T, B, 3)
[m], `body_rotations` (T, B, 4) w x y z, `body_linear_velocities` (T, B, 3) [m/s] and `body_angular_velocities` (T, B, 3)
[rad/s] of the bodies' frames in the world. The root is the first body. Its loader makes single precision of them.
"""

from pathlib import Path

import numpy as np

from robot_retarget.base.untrusted.arrays import save_npz, shaped
from robot_retarget.formats.bodies import body_tracks, velocities
from robot_retarget.formats.columns import Columns
from robot_retarget.formats.format import TrajectoryFormat
from robot_retarget.formats.orders import body_names, robot_bodies
from robot_retarget.formats.robot_motion import RobotMotion
from robot_retarget.formats.source import TrajectorySource

KEYS = {"dof_names", "body_names", "dof_positions", "body_positions", "body_rotations"}


def write(motion: RobotMotion, path: Path) -> None:
    """Write the archive."""
    robot, qvel = motion.robot, velocities(motion)
    tracks, bodies = body_tracks(motion, qvel), robot_bodies(robot)
    save_npz(
        path,
        fps=np.array(motion.fps),
        dof_names=np.array(robot.joint_names),
        body_names=np.array(body_names(robot, bodies)),
        dof_positions=motion.qpos[:, robot.qpos_index],
        dof_velocities=qvel[:, robot.dof_index],
        body_positions=tracks.positions[:, bodies],
        body_rotations=tracks.quaternions[:, bodies],
        body_linear_velocities=tracks.linear[:, bodies],
        body_angular_velocities=tracks.angular[:, bodies],
    )


def read(source: TrajectorySource) -> Columns:
    """Read joints by their names, and the root from the first body."""
    angles = shaped(source.array("dof_positions"), (None, None), "dof_positions").astype(float)
    places = shaped(source.array("body_positions"), (len(angles), None, 3), "body_positions").astype(float)
    turns = shaped(source.array("body_rotations"), (len(angles), places.shape[1], 4), "body_rotations").astype(float)
    return Columns(angles, source.names("dof_names"), places[:, 0], turns[:, 0], source.rate)


FORMAT = TrajectoryFormat(
    name="isaaclab-amp",
    suffix=".npz",
    description="Isaac Lab's humanoid AMP archive: named joints and bodies with velocities",
    write=write,
    read=read,
    claims=lambda source: source.arrays.keys() >= KEYS,
    readers="Isaac Lab (humanoid_amp)",
    plain=True,
)
