"""Format `gmr`: the pickled dictionary of GMR, which TWIST and TWIST2 train on.

`fps`; `root_pos` (T, 3); `root_rot` (T, 4) **x y z w**; `dof_pos` (T, n) in the model's order; `local_body_pos` (T, B, 3) of
all bodies in the root's frame and `link_body_list`, their names, which TWIST2 wants to be there. No joint names.
"""

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from robot_retarget.base.arrays import Floats
from robot_retarget.base.untrusted.arrays import rate_of
from robot_retarget.base.untrusted.pickles import dump_pickle
from robot_retarget.formats.columns import Columns
from robot_retarget.formats.format import TrajectoryFormat
from robot_retarget.formats.orders import body_names, robot_bodies
from robot_retarget.formats.pickles.dictionary import array_in, holds
from robot_retarget.formats.quaternions import FIRST_LAST, LAST_FIRST
from robot_retarget.formats.robot_motion import RobotMotion
from robot_retarget.formats.source import TrajectorySource
from robot_retarget.robot.kinematics import body_frames


def write(motion: RobotMotion, path: Path) -> None:
    """Write the rate, the pose of the root, the joint angles, and the bodies' positions in the frame of the root."""
    bodies = robot_bodies(motion.robot)
    path.write_bytes(
        dump_pickle(
            {
                "fps": int(motion.fps) if motion.fps == int(motion.fps) else motion.fps,
                "root_pos": motion.position,
                "root_rot": motion.quaternion[:, LAST_FIRST],
                "dof_pos": motion.angles,
                "local_body_pos": _in_root(motion, bodies),
                "link_body_list": list(body_names(motion.robot, bodies)),
            }
        )
    )


def _in_root(motion: RobotMotion, bodies: np.ndarray) -> Floats:
    """(T, B, 3) positions of bodies in the root's frame [m]."""
    places = body_frames(motion.robot, motion.qpos)[0][:, bodies] - motion.position[:, None]
    undo = Rotation.from_quat(motion.quaternion, scalar_first=True).inv().as_matrix()
    return np.einsum("tij,tbj->tbi", undo, places)


def read(source: TrajectorySource) -> Columns:
    """Read the pickle, restricted to data."""
    position = array_in(source.pickled, "root_pos", (None, 3))
    quaternion = array_in(source.pickled, "root_rot", (len(position), 4))[:, FIRST_LAST]
    angles = array_in(source.pickled, "dof_pos", (len(position), None))
    return Columns(angles, source.names(), position, quaternion, rate_of(source.pickled))


FORMAT = TrajectoryFormat(
    name="gmr",
    suffix=".pkl",
    description="GMR's dictionary: root xyz, quaternion xyzw, joints",
    write=write,
    read=read,
    claims=lambda source: holds(source.pickled, "root_pos", "root_rot", "dof_pos"),
    readers="GMR, TWIST, TWIST2, MimicKit (gmr_to_mimickit)",
    complete=False,
    ordered=True,
    quaternion="xyzw",
    plain=True,
)
