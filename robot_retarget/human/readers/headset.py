"""Bodies of headsets: the 24 joints of XR_BD_body_tracking, which are those of SMPL, each with a flag whether it is tracked.

OpenXR's axes: x right, y up, z back. Ours: x' = −z, y' = −x, z' = y. Rotations are those of the joints in the world.
"""

import numpy as np
from scipy.spatial.transform import Rotation

from robot_retarget.base.arrays import Bools, Floats
from robot_retarget.human.readers.smpl.body import NAMES, PARENTS, mean_skeleton
from robot_retarget.human.skeleton import Skeleton

JOINTS = len(NAMES)
LENGTHS = (0.5, 1.5)
"""A quaternion of another length belongs to no tracked joint [-]; headsets send zeros for those."""


class HeldBody:
    """Joints that are not tracked keep their pose in their parent: a limb is held, it does not fly away.

    x_j = x_p + Q (y_j − y_p) with the parent p, the body y of the frame before, and Q the turn of the parent since then. The
    first frame follows the mean body in T-pose.
    """

    def __init__(self) -> None:
        mean, _ = mean_skeleton(None)
        self.skeleton: Skeleton = Skeleton(NAMES, PARENTS, mean.offsets[:, [2, 0, 1]])  # x left, y up, z ahead
        self._places, self._turns = self.skeleton.rest(), np.tile([1.0, 0, 0, 0], (JOINTS, 1))

    def step(self, poses: Floats, tracked: Bools) -> tuple[Floats, Floats] | None:
        """Return positions (24, 3) [m] and rotations (24, 4) w x y z of a frame; None without its pelvis.

        Args:
            poses: (24, 7) x y z [m] and quaternion x y z w in OpenXR's axes.
            tracked: (24,) flags.
        """
        lengths = np.linalg.norm(poses[:, 3:], axis=1)
        seen = tracked & np.isfinite(poses).all(axis=1) & (lengths > LENGTHS[0]) & (lengths < LENGTHS[1])
        if not seen[0]:
            return None
        x, y, z, qx, qy, qz, qw = np.where(seen[:, None], poses, [0, 0, 0, 0, 0, 0, 1.0]).T
        places = np.stack([-z, -x, y], axis=1)
        turns = np.stack([qw, -qz, -qx, qy], axis=1) / np.where(seen, lengths, 1.0)[:, None]
        for joint in np.flatnonzero(~seen):
            parent = PARENTS[joint]
            since = _rotation(turns[parent]) * _rotation(self._turns[parent]).inv()
            places[joint] = places[parent] + since.apply(self._places[joint] - self._places[parent])
            turns[joint] = (since * _rotation(self._turns[joint])).as_quat(scalar_first=True)
        self._places, self._turns = places, turns
        return places, turns


def _rotation(turn: Floats) -> Rotation:
    return Rotation.from_quat(turn, scalar_first=True)
