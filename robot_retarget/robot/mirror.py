"""Reflection of a robot in its sagittal plane: counterpart and sign of every hinge."""

from dataclasses import dataclass
from functools import cached_property

import mujoco
import numpy as np

from robot_retarget.base.arrays import ALIGNED, Floats, Ints
from robot_retarget.robot.model import Robot
from robot_retarget.robot.symmetrize import SLIGHT


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
