"""Format `phc`: the joblib dictionary of PHC for humanoids, which ASAP and PBHC read too.

{clip: {`root_trans_offset` (T, 3) [m], `root_rot` (T, 4) **x y z w**, `dof` (T, n) [rad], `pose_aa` (T, 1 + n + 3, 3), `fps`}},
all in single precision, as their torch code wants them. `pose_aa` holds rotation vectors: the root's, every joint's angle
times its axis, and three rows of zeros for bodies that these projects add to a G1. The 23 joints of their G1 are named by
`--joints`.
"""

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from robot_retarget.base.arrays import Floats
from robot_retarget.base.errors import TrajectoryError
from robot_retarget.base.untrusted.arrays import rate_of
from robot_retarget.base.untrusted.pickles import dump_pickle
from robot_retarget.formats.columns import Columns
from robot_retarget.formats.format import TrajectoryFormat
from robot_retarget.formats.pickles.dictionary import array_in, holds
from robot_retarget.formats.quaternions import FIRST_LAST, LAST_FIRST
from robot_retarget.formats.robot_motion import RobotMotion
from robot_retarget.formats.source import TrajectorySource

ADDED = 3
"""Rows of zeros behind the joints."""


def write(motion: RobotMotion, path: Path) -> None:
    """Write the dictionary of one clip, called as the motion's source."""
    clip = {
        "root_trans_offset": motion.position.astype(np.float32),
        "pose_aa": _rotation_vectors(motion).astype(np.float32),
        "dof": motion.angles.astype(np.float32),
        "root_rot": motion.quaternion[:, LAST_FIRST].astype(np.float32),
        "fps": int(motion.fps) if motion.fps == int(motion.fps) else motion.fps,
    }
    path.write_bytes(dump_pickle({Path(motion.trajectory.source).stem or "motion": clip}))


def _rotation_vectors(motion: RobotMotion) -> Floats:
    robot = motion.robot
    axes = robot.model.jnt_axis[[robot.joint_ids[robot.joint_names.index(name)] for name in motion.joints]]
    root = Rotation.from_quat(motion.quaternion, scalar_first=True).as_rotvec()[:, None]
    return np.concatenate([root, motion.angles[..., None] * axes, np.zeros((len(motion), ADDED, 3))], axis=1)


def read(source: TrajectorySource) -> Columns:
    """Read the only clip.

    Raises:
        TrajectoryError: there are more, which are named.
    """
    clips = source.pickled
    if not isinstance(clips, dict) or len(clips) != 1:
        raise TrajectoryError(f"one clip a file is read; it has {', '.join(map(str, clips or ())) or 'none'}")
    ((name, clip),) = clips.items()
    position = array_in(clip, "root_trans_offset", (None, 3))
    quaternion = array_in(clip, "root_rot", (len(position), 4))[:, FIRST_LAST]
    angles = array_in(clip, "dof", (len(position), None))
    return Columns(angles, source.names(), position, quaternion, rate_of(clip), source=str(name))


def claims(source: TrajectorySource) -> bool:
    """Whether every value of a dictionary is a clip."""
    clips = source.pickled
    keys = ("root_trans_offset", "root_rot", "dof")
    return isinstance(clips, dict) and bool(clips) and all(holds(clip, *keys) for clip in clips.values())


FORMAT = TrajectoryFormat(
    name="phc",
    suffix=".pkl",
    description="PHC's joblib dictionary: root, rotation vectors, joints; single precision",
    write=write,
    read=read,
    claims=claims,
    readers="PHC, PBHC, ASAP",
    complete=False,
    ordered=True,
    exact=False,
    quaternion="xyzw",
    plain=True,
)
