"""The servos that turn a robot's joints, and the limits that they set on planned motions."""

from dataclasses import replace

import numpy as np

from robot_retarget.actuators.map import ServoMap
from robot_retarget.base.errors import RobotError, known
from robot_retarget.robot.model import Robot


def with_servos(robot: Robot, servo_map: ServoMap) -> Robot:
    """Return the robot on the servos of a map: ranges and speeds are limited to those of its goals.

    Args:
        servo_map: the servos that turn its joints.

    Raises:
        RobotError: a joint has no servo, or its range does not overlap that of its servo.
        MapError: a map without servos has a gain for an absent joint.
    """
    if not servo_map.servos:
        servo_map.require_gains_of(robot.joint_names)
        return replace(robot, servo_map=servo_map)
    bare = [joint for joint in robot.joint_names if joint not in (*servo_map.joints, *servo_map.passive)]
    if bare:
        raise RobotError(f"{robot.name}: no servo for the joint {bare[0]!r}; {known(servo_map.joints)}")
    lower, upper, speed = (np.array(values) for values in (robot.lower, robot.upper, robot.max_speed))
    for k, joint in enumerate(robot.joint_names):
        if joint in servo_map.joints:
            low, high = servo_map[joint].reach
            lower[k], upper[k] = max(lower[k], low), min(upper[k], high)
            speed[k] = min(speed[k], servo_map.limits.speed)
    return replace(robot, lower=lower, upper=upper, max_speed=speed, servo_map=servo_map)
