"""The motion from one frame to the next, on which links must not pass through each other either."""

from dataclasses import dataclass

import numpy as np

from robot_retarget.base.arrays import Floats, Ints
from robot_retarget.robot import Robot
from robot_retarget.robot.kinematics import difference, integrate

TURN = 0.07
"""Largest change of a hinge between two checks of the links [rad]."""


@dataclass(frozen=True)
class SweptConfiguration:
    """A configuration between this frame and a neighbour in time, at which links are kept apart as well."""

    neighbour: Floats
    share: float
    """Position between the two: 0 at the neighbour, 1 at this frame."""

    def at(self, robot: Robot, q: Floats) -> Floats:
        """Return the configuration (nq,) for a frame at q."""
        return integrate(robot, self.neighbour, self.share * difference(robot, self.neighbour, q))


def parts_between(robot: Robot, first: Floats, second: Floats) -> Ints:
    """Return (…) the number of equal parts of the way between configurations (…, nq), each below `TURN` in every hinge."""
    turn = np.abs(second - first)[..., robot.qpos_index].max(axis=-1, initial=0.0)
    return (turn / TURN).astype(np.int64) + 1


def swept_configurations(robot: Robot, neighbour: Floats, q: Floats) -> tuple[SweptConfiguration, ...]:
    """Return evenly spaced configurations between two frames, one at least, less than `TURN` apart in every hinge.

    Args:
        neighbour: (nq,) configuration of the neighbour in time.
        q: (nq,) configuration of the frame.
    """
    checks = int(parts_between(robot, neighbour, q))
    return tuple(SweptConfiguration(neighbour, k / (checks + 1)) for k in range(1, checks + 1))
