"""Format `mimickit`: MimicKit's motion pickle.

`loop_mode` 0 (clamp) or 1 (wrap), `fps`, `frames`: T lists of root x y z [m], root rotation vector [rad], joints [rad] in the
model's order.
"""

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from robot_retarget.base.untrusted.arrays import rate_of
from robot_retarget.base.untrusted.pickles import dump_pickle
from robot_retarget.formats.columns import Columns
from robot_retarget.formats.format import TrajectoryFormat
from robot_retarget.formats.pickles.dictionary import array_in, holds
from robot_retarget.formats.robot_motion import RobotMotion
from robot_retarget.formats.source import TrajectorySource

CLAMP = 0
"""A motion ends where it ends."""


def write(motion: RobotMotion, path: Path) -> None:
    """Write the pickle, as lists of numbers."""
    turns = Rotation.from_quat(motion.quaternion, scalar_first=True).as_rotvec()
    frames = np.column_stack([motion.position, turns, motion.angles])
    path.write_bytes(dump_pickle({"loop_mode": CLAMP, "fps": motion.fps, "frames": frames.tolist()}))


def read(source: TrajectorySource) -> Columns:
    """Read the pickle, restricted to data."""
    frames = array_in(source.pickled, "frames", (None, None))
    quaternion = Rotation.from_rotvec(frames[:, 3:6]).as_quat(scalar_first=True)
    return Columns(frames[:, 6:], source.names(), frames[:, :3], quaternion, rate_of(source.pickled))


FORMAT = TrajectoryFormat(
    name="mimickit",
    suffix=".pkl",
    description="MimicKit's motion: root xyz, rotation vector, joints",
    write=write,
    read=read,
    claims=lambda source: holds(source.pickled, "loop_mode", "fps", "frames"),
    readers="MimicKit",
    complete=False,
    ordered=True,
    quaternion="rotvec",
    plain=True,
)
