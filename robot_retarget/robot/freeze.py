"""Joints that keep an angle, or follow a file: the bounds of their range become it, for every stage that reads the robot."""

from collections.abc import Sequence
from dataclasses import replace
from fnmatch import fnmatchcase

import numpy as np

from robot_retarget.base.errors import TrajectoryError, UsageError, known
from robot_retarget.robot.anatomy import limb_hinges
from robot_retarget.robot.model import Robot
from robot_retarget.robot.recognise import recognise
from robot_retarget.trajectory import Trajectory, load_trajectory

PARTS = {"arms": ("l_hand", "r_hand"), "upper": ("l_ankle", "r_ankle")}
"""Keypoints at the ends of the limbs that alone may move (arms), or that alone may not (upper)."""
SLACK = 1e-6
"""Angles beyond a range by rounding alone are within it [rad]."""


def freeze(robot: Robot, joints: Sequence[str] = (), only: str | None = None) -> Robot:
    """Return the robot with joints that keep an angle,  lower = upper.

    Args:
        joints: names or patterns, `waist_*`, each with an angle if it is not that of the standing pose,
            `waist_yaw_joint=0.2` [rad], or follow a trajectory file, `waist_*=bow.npz`, in time with the motion.
        only: `arms` freezes all joints but those of the arms, `upper` those of the legs.

    Raises:
        UsageError: a pattern fits no joint, an angle is no number or out of a joint's range, or the robot lacks the part.
        TrajectoryError: a file is no trajectory of these joints.
    """
    angles, led = _only(robot, only) if only else {}, dict(robot.led)
    for line in joints:
        pattern, given, text = (part.strip() for part in line.partition("="))
        fitting = [k for k, name in enumerate(robot.joint_names) if fnmatchcase(name, pattern)]
        if not fitting:
            raise UsageError(
                f"freeze {pattern!r} fits no joint of {robot.name}; {known(robot.joint_names, 40, typed=pattern)}"
            )
        if text.endswith(".npz"):
            led |= dict.fromkeys(fitting, load_trajectory(text))
        else:
            angles |= {k: _angle(robot, k, text) if given else _standing(robot, k) for k in fitting}
    if not angles and not led:
        return robot
    lower, upper = np.array(robot.lower), np.array(robot.upper)
    lower[list(angles)] = upper[list(angles)] = list(angles.values())
    for k in led:
        lower[k], upper[k] = _span(robot, k, led[k])
    return replace(robot, lower=lower, upper=upper, whole=robot.whole or robot, led=led)


def held(trajectory: Trajectory, robot: Robot) -> Trajectory:
    """Return a trajectory whose frozen joints have their angles, without goals."""
    qpos = trajectory.qpos.copy()
    lower, upper = robot.ranges(np.arange(len(trajectory)) / trajectory.fps)
    still = (lower == upper).all(axis=0)
    qpos[:, robot.qpos_index[still]] = lower[:, still]
    return trajectory.altered(qpos=qpos)


def _span(robot: Robot, joint: int, trajectory: Trajectory) -> tuple[float, float]:
    """The least and the largest angle of a joint in a trajectory, within its range [rad]."""
    name = robot.joint_names[joint]
    if name not in trajectory.joint_names:
        raise TrajectoryError(
            f"freeze {name}: the trajectory lacks this joint; {known(trajectory.joint_names, 40, typed=name)}"
        )
    angles = trajectory.angles[:, trajectory.joint_names.index(name)]
    return _within(robot, joint, float(angles.min())), _within(robot, joint, float(angles.max()))


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
    try:
        return _within(robot, joint, float(text))
    except ValueError:
        name = robot.joint_names[joint]
        raise UsageError(f"freeze {name}={text}: expected an angle in radians or a trajectory .npz") from None


def _within(robot: Robot, joint: int, angle: float) -> float:
    """Return an angle, if it is within the range of its joint [rad]."""
    name, low, high = robot.joint_names[joint], robot.lower[joint], robot.upper[joint]
    if not low - SLACK <= angle <= high + SLACK:
        raise UsageError(f"freeze {name}={angle:g}: outside its range {low:.3f} … {high:.3f} rad")
    return float(np.clip(angle, low, high))
