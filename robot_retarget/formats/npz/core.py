"""Format `core`: CoRe's `core-robot-motion-v1`.

`qpos` (T, nq): root x y z, w x y z, then the joints that `joint_names` lists; `timestamps_s` (T,), `fps`; contacts of feet
and hands, here marked as not available; sha256 of the model and of the motion. No pickles.
"""

import hashlib
from pathlib import Path

import numpy as np

from robot_retarget.base.errors import TrajectoryError
from robot_retarget.base.untrusted.arrays import save_npz, shaped
from robot_retarget.formats.columns import Columns
from robot_retarget.formats.format import TrajectoryFormat
from robot_retarget.formats.robot_motion import RobotMotion
from robot_retarget.formats.source import TrajectorySource

TITLE = "core-robot-motion-v1"
LAYOUT = "root_xyz_quat_wxyz_then_model_joint_qpos"
ROOT_NAMES = ("root_x", "root_y", "root_z", "root_quat_w", "root_quat_x", "root_quat_y", "root_quat_z")
CONTACTS = ("left_foot", "right_foot", "left_hand", "right_hand")


def write(motion: RobotMotion, path: Path) -> None:
    """Write the archive."""
    frames, model = len(motion), hashlib.sha256(motion.robot.path.read_bytes()).hexdigest()
    save_npz(
        path,
        schema_version=np.int32(1),
        format=TITLE,
        core_version="robot-retarget",
        robot_id=motion.robot.name,
        model_sha256=model,
        scene_sha256=model,
        source_motion_sha256=hashlib.sha256(motion.qpos.tobytes()).hexdigest(),
        fps=motion.fps,
        timestamps_s=np.arange(frames) / motion.fps,
        qpos=motion.qpos,
        qpos_layout=LAYOUT,
        root_qpos_names=np.array(ROOT_NAMES),
        joint_names=np.array(motion.joints),
        contact_label_names=np.array(CONTACTS),
        contact_labels=np.zeros((frames, 4), bool),
        contact_confidence=np.zeros((frames, 4)),
        contact_availability=np.zeros(4, bool),
        flight_labels=np.zeros(frames, bool),
        left_contact_segments=np.zeros((0, 2), np.int64),
        right_contact_segments=np.zeros((0, 2), np.int64),
        contact_source="unspecified",
        hand_contact_source="unspecified",
    )


def read(source: TrajectorySource) -> Columns:
    """Read the archive.

    Raises:
        TrajectoryError: another layout of qpos than that of version 1, or a missing array.
    """
    layout, names = str(source.array("qpos_layout")), source.names()
    if layout != LAYOUT or names is None:
        raise TrajectoryError(f"qpos_layout is {layout!r}, this reader knows {LAYOUT!r} with joint_names")
    qpos = shaped(source.array("qpos"), (None, 7 + len(names)), "qpos")
    return Columns(qpos[:, 7:], names, qpos[:, :3], qpos[:, 3:7], source.rate)


FORMAT = TrajectoryFormat(
    name="core",
    suffix=".npz",
    description="CoRe's core-robot-motion-v1: qpos, time, names",
    write=write,
    read=read,
    claims=lambda source: str(source.arrays.get("format")) == TITLE,
    readers="CoRe",
    plain=True,
)
