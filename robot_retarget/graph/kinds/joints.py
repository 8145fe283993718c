"""Joint range and joint speed: bounds on the hinges."""

from dataclasses import dataclass

import numpy as np

from robot_retarget.graph.kinds.kind import FRAME, RetargetContext, Role
from robot_retarget.graph.role import STEP
from robot_retarget.graph.track import Track, limit


@dataclass(frozen=True)
class RangeKind:
    """Angle of every hinge [rad], within the robot's range."""

    name: str = "range"
    role: Role = Role.BOUND
    stencil: tuple[int, ...] = FRAME

    def targets(self, context: RetargetContext) -> Track | None:
        """[lower, upper] of the robot."""
        robot = context.robot
        return limit(self, [(j, "zero") for j in robot.joint_names], robot.lower, robot.upper, len(context.human))


@dataclass(frozen=True)
class SpeedKind:
    """Speed of every hinge from frame to frame [rad/s], within the robot's."""

    name: str = "speed"
    role: Role = Role.BOUND
    stencil: tuple[int, ...] = STEP

    def targets(self, context: RetargetContext) -> Track | None:
        """[−v, v] of the robot."""
        robot = context.robot
        most = np.asarray(robot.max_speed)
        return limit(self, [(j, f"{j} a frame before") for j in robot.joint_names], -most, most, len(context.human))
