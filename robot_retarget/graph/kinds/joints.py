"""Joint range and joint speed: bounds on the hinges."""

import numpy as np

from robot_retarget.graph.kind import Form, Kind, RetargetContext, Role, Track
from robot_retarget.graph.role import STEP
from robot_retarget.graph.track import limit


class RangeKind(Kind):
    """Angle of every hinge [rad], within the robot's range."""

    name = "range"
    role = Role.BOUND
    form = Form.JOINT
    follows_human = False

    def targets(self, context: RetargetContext) -> Track | None:
        """[lower, upper] of the robot."""
        robot, frames = context.robot, len(context.human)
        lower, upper = robot.ranges(np.arange(frames) / context.human.fps)
        return limit(self, [(j, "zero") for j in robot.joint_names], lower, upper, frames)


class SpeedKind(Kind):
    """Speed of every hinge from frame to frame [rad/s], within the robot's."""

    name = "speed"
    role = Role.BOUND
    stencil = STEP
    form = Form.JOINT
    follows_human = False

    def targets(self, context: RetargetContext) -> Track | None:
        """[−v, v] of the robot."""
        robot = context.robot
        most = np.asarray(robot.max_speed)
        return limit(self, [(j, f"{j} a frame before") for j in robot.joint_names], -most, most, len(context.human))
