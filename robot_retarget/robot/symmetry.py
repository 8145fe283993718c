"""Left and right of a robot: points made symmetric, and the counterpart of every hinge."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import mujoco
import numpy as np

from robot_retarget.base.arrays import ALIGNED, Floats, Ints
from robot_retarget.base.keypoints import mirrored
from robot_retarget.robot.model import Robot

# Symmetrize points measured on meshes.
#
# The joint axes of most robots mirror each other exactly; their meshes differ by tenths of a millimetre and more. Toes, hands,
# head and soles are measured on meshes, so each is replaced by the mean of itself and its mirror image. A motion and its
# mirror image then pose the same problem. Sides that differ by more stay unchanged.

SLIGHT = 0.02
"""Sides that differ by less than this share of the body, or of the foot, are symmetrized, and hinges whose mirrored lines
do are counterparts [-]."""


def symmetric_places(places: Mapping[str, Floats], left: Floats) -> dict[str, Floats]:
    """Return keypoints (3,) [m], each the mean of itself and of the mirror image of its counterpart.

    Args:
        left: (3,) unit vector from the right to the left.
    """
    paired = [k for k in places if mirrored(k) != k and mirrored(k) in places]
    if not paired:
        return dict(places)
    middle = float(np.median([places[k] @ left for k in paired]))
    size = float(np.ptp(np.array(list(places.values())), axis=0).max())
    found = {}
    for keypoint, place in places.items():
        seen = places.get(mirrored(keypoint), place)
        image = seen + 2 * (middle - seen @ left) * left
        found[keypoint] = (place + image) / 2 if np.linalg.norm(image - place) < SLIGHT * size else place
    return found


def symmetric_soles(clouds: Mapping[str, Floats], ankles: Mapping[str, Floats], left: Floats) -> dict[str, Floats]:
    """Return the points of both feet (P, 3) [m], each joined with the mirror image of the other foot.

    Args:
        clouds: per foot `l`, `r` points of its surface in the standing pose.
        ankles: per foot (3,), the origin of its mirror image [m].
    """
    if len(clouds) < 2:
        return dict(clouds)
    own = {side: clouds[side] - ankles[side] for side in "lr"}
    image = {a: own[b] - 2 * (own[b] @ left)[:, None] * left for a, b in ("lr", "rl")}
    ends = [np.array([cloud.min(axis=0), cloud.max(axis=0)]) for cloud in (own["l"], image["l"])]
    if np.abs(ends[0] - ends[1]).max() > SLIGHT * np.ptp(ends[0], axis=0).max():
        return dict(clouds)
    return {side: ankles[side] + np.vstack([own[side], image[side]]) for side in "lr"}


# Reflection of a robot in its sagittal plane: counterpart and sign of every hinge.


@dataclass(frozen=True)
class Mirror:
    """The reflection in the sagittal plane, hinge by hinge."""

    partner: Ints
    """(n,) counterpart on the other side; a hinge in the middle is its own, −1 marks a hinge without a counterpart."""
    sign: Floats
    """(n,) mirrored angle of the partner = sign · angle."""
    left: Floats
    """(3,) the robot's left in the frame of its root body."""

    @property
    def whole(self) -> bool:
        """Whether every hinge has a counterpart."""
        return bool((self.partner >= 0).all())

    def angles(self, angles: Floats) -> Floats:
        """Return the hinge angles (…, n) of the mirrored robot [rad]; hinges without a counterpart are 0."""
        other, sign = self._seen
        return angles[..., other] * sign

    @cached_property
    def _seen(self) -> tuple[Ints, Floats]:
        """Return the source of every mirrored angle, and its sign: 0 for a hinge without a counterpart."""
        other = np.maximum(self.partner, 0)
        return other, np.where(self.partner >= 0, self.sign[other], 0.0)


def mirror_of(robot: Robot, left: Floats) -> Mirror:
    """Find the counterpart of each hinge from its line and direction in the reference pose.

    A rotation by θ about the axis a through p becomes, in the mirror M = 1 − 2 ℓℓᵀ, one by θ about −M a through M p.

    Args:
        left: (3,) unit vector, the robot's left at `qpos0`, in world coordinates.
    """
    data = mujoco.MjData(robot.model)
    mujoco.mj_kinematics(robot.model, data)
    plane = np.eye(3) - 2 * np.outer(left, left)
    middle, size = data.xpos[robot.root_body], float(np.ptp(data.xpos[1:], axis=0).max())
    place, axis = data.xanchor[robot.joint_ids] - middle, data.xaxis[robot.joint_ids]
    gap, turn = (place @ plane)[:, None] - place, -(axis @ plane) @ axis.T
    along = np.abs((gap * axis).sum(axis=2)) / size
    across = np.linalg.norm(gap - (gap * axis).sum(axis=2, keepdims=True) * axis, axis=2) / size
    fit = np.where((across < SLIGHT) & (np.abs(turn) > ALIGNED), across + along, np.inf)
    best, rows = fit.argmin(axis=1), np.arange(len(fit))
    found = np.isfinite(fit[rows, best]) & (best[best] == rows)
    own = data.xmat[robot.root_body].reshape(3, 3).T @ left
    return Mirror(np.where(found, best, -1), np.where(found, np.sign(turn[rows, best]), 0.0), own)
