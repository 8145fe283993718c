"""The way from one frame to the next, on which links are not to pass through each other either."""

from dataclasses import dataclass

import numpy as np

from robot_retarget.arrays import Floats
from robot_retarget.robot import Robot
from robot_retarget.robot.kinematics import difference, integrate

TURN = 0.07
"""Links are looked at once on the way, and once more for every so far that a hinge turns [rad]."""


@dataclass(frozen=True)
class Between:
    """A configuration on the way from this frame to a neighbour in time, at which links are kept apart as well."""

    neighbour: Floats
    share: float
    """How far from the neighbour it is: 0 there, 1 at this frame."""

    def at(self, robot: Robot, q: Floats) -> Floats:
        """The configuration (nq,) when the frame's is q."""
        return integrate(robot, self.neighbour, self.share * difference(robot, self.neighbour, q))


def on_the_way(robot: Robot, neighbour: Floats, q: Floats) -> tuple[Between, ...]:
    """Where links are looked at between a frame's configuration and a neighbour's (nq,): evenly, no hinge past `TURN`."""
    hinges = robot.qpos_index
    looks = int(np.abs(q[hinges] - neighbour[hinges]).max(initial=0.0) / TURN) + 1
    return tuple(Between(neighbour, k / (looks + 1)) for k in range(1, looks + 1))
