"""Format `protomotions-pyroki`: the archive between PyRoki's retargeting and ProtoMotions' own `.motion`.

`base_frame_pos` (T, 3) [m], `base_frame_wxyz` (T, 4), `joint_angles` (T, n) [rad] in the model's order; `fps` if
present, else 30. ProtoMotions' `.motion` itself is a torch file that its converter makes of this.
"""

from pathlib import Path

import numpy as np

from robot_retarget.base.untrusted.arrays import save_npz, shaped
from robot_retarget.formats.columns import Columns
from robot_retarget.formats.format import TrajectoryFormat
from robot_retarget.formats.robot_motion import RobotMotion
from robot_retarget.formats.source import TrajectorySource

KEYS = ("base_frame_pos", "base_frame_wxyz", "joint_angles")


def write(motion: RobotMotion, path: Path) -> None:
    """Write the archive."""
    save_npz(
        path,
        base_frame_pos=motion.position,
        base_frame_wxyz=motion.quaternion,
        joint_angles=motion.angles,
        joint_names=np.array(motion.joints),
        fps=motion.fps,
    )


def read(source: TrajectorySource) -> Columns:
    """Read the archive."""
    position = shaped(source.array("base_frame_pos"), (None, 3), "base_frame_pos")
    quaternion = shaped(source.array("base_frame_wxyz"), (len(position), 4), "base_frame_wxyz")
    angles = shaped(source.array("joint_angles"), (len(position), None), "joint_angles")
    return Columns(angles, source.names(), position, quaternion, source.rate)


FORMAT = TrajectoryFormat(
    name="protomotions-pyroki",
    suffix=".npz",
    description="ProtoMotions' PyRoki stage: base frame xyz and wxyz, joint angles",
    write=write,
    read=read,
    claims=lambda source: set(KEYS) <= source.arrays.keys(),
    readers="ProtoMotions (convert_pyroki_retargeted_robot_motions_to_proto.py)",
    fps=30.0,
    ordered=True,
    plain=True,
)
