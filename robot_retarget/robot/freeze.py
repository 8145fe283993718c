"""Joints that keep an angle: the bounds of their range become it, for every stage that reads the robot."""

from collections.abc import Sequence
from dataclasses import replace
from fnmatch import fnmatchcase

import numpy as np

from robot_retarget.errors import UsageError, known
from robot_retarget.robot.anatomy import limb_hinges
from robot_retarget.robot.model import Robot
from robot_retarget.robot.recognise import recognise

PARTS = {"arms": ("l_hand", "r_hand"), "upper": ("l_ankle", "r_ankle")}
"""Keypoints at the ends of the limbs that alone may move (arms), or that alone may not (upper)."""


def freeze(robot: Robot, joints: Sequence[str] = (), only: str | None = None) -> Robot:
    """Return the robot with joints that keep an angle,  lower = upper.

    Args:
        robot: the robot.
        joints: names or patterns, `waist_*`, each with an angle if it is not that of the standing pose,
            `waist_yaw_joint=0.2` [rad].
        only: `arms` freezes all joints but those of the arms, `upper` those of the legs.

    Raises:
        UsageError: a pattern fits no joint, an angle is no number or out of a joint's range, or the robot lacks the part.
    """
    angles = _only(robot, only) if only else {}
    for line in joints:
        pattern, given, text = (part.strip() for part in line.partition("="))
        fitting = [k for k, name in enumerate(robot.joint_names) if fnmatchcase(name, pattern)]
        if not fitting:
            raise UsageError(
                f"freeze {pattern!r} fits no joint of {robot.name}; {known(robot.joint_names, 40, typed=pattern)}"
            )
        angles |= {k: _angle(robot, k, text) if given else _standing(robot, k) for k in fitting}
    if not angles:
        return robot
    lower, upper = np.array(robot.lower), np.array(robot.upper)
    lower[list(angles)] = upper[list(angles)] = list(angles.values())
    return replace(robot, lower=lower, upper=upper, whole=robot.whole or robot)


def _only(robot: Robot, part: str) -> dict[int, float]:
    """The angle of every joint that does not belong to a part."""
    if part not in PARTS:
        raise UsageError(f"only {part!r} is no part; {known(PARTS, typed=part)}")
    anatomy = recognise(robot)
    ends = [end for end in PARTS[part] if end in anatomy.sites]
    if not ends and part == "arms":
        raise UsageError(f"{robot.name} has no arms")
    limbs = {int(k) for end in ends for k in limb_hinges(robot, anatomy, end)}
    still = limbs if part == "upper" else set(range(len(robot.joint_names))) - limbs
    return {k: _standing(robot, k) for k in sorted(still)}


def _standing(robot: Robot, joint: int) -> float:
    angle = robot.standing()[robot.qpos_index[joint]]
    return float(np.clip(angle, robot.lower[joint], robot.upper[joint]))


def _angle(robot: Robot, joint: int, text: str) -> float:
    """The angle of a line, within the range of the joint [rad]."""
    name, low, high = robot.joint_names[joint], robot.lower[joint], robot.upper[joint]
    try:
        angle = float(text)
    except ValueError:
        raise UsageError(f"freeze {name}={text}: expected an angle in radians") from None
    if not low <= angle <= high:
        raise UsageError(f"freeze {name}={text}: outside its range {low:.3f} … {high:.3f} rad")
    return angle
