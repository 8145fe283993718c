"""Own keypoints in place of recognised ones, and joints that stay still."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from fnmatch import fnmatchcase
from typing import Any

import numpy as np

from robot_retarget.base.arrays import Floats, unit
from robot_retarget.base.errors import MatchError, TrajectoryError, UsageError, known
from robot_retarget.base.keypoints import KEYPOINTS, SIDES
from robot_retarget.robot.anatomy import Anatomy, KeypointSite, limb_hinges
from robot_retarget.robot.facing import Facing
from robot_retarget.robot.links import Links
from robot_retarget.robot.model import Robot
from robot_retarget.robot.recognise import assemble, recognise
from robot_retarget.robot.soles import flat_footed
from robot_retarget.trajectory import Trajectory, load_trajectory

# Lines of a map file that replace recognised keypoints of a robot.

OUTLYING = 10.0
"""A keypoint farther from its body is a mistake [m]."""
FORWARD = "forward"
"""The line that sets the robot's heading."""
FREEZE = "freeze"
"""The line of joints that keep an angle."""


def recognise_with(robot: Robot, table: Mapping[str, Any]) -> Anatomy:
    """Recognise a robot, given the table `[robot]` of a map file.

    The line `forward = [x, y, z]` sets the robot's heading in its reference pose; left and right follow. Lines
    `keypoint = ["body", x, y, z]` replace keypoints (`override`). A table of all keypoints applies even if recognition
    fails. The line `freeze` is not about keypoints (`frozen_lines`).

    Args:
        table: keypoints by name, as in a map file.

    Raises:
        MatchError: recognition fails and the table lacks a keypoint, or a line is not of these forms.
    """
    lines = {keypoint: line for keypoint, line in table.items() if keypoint not in (FORWARD, FREEZE)}
    forward = _heading(table[FORWARD]) if FORWARD in table else None
    try:
        found = recognise(robot, forward)
    except MatchError as error:
        if not lines.keys() >= set(KEYPOINTS):
            raise
        found = _from_map(robot, _sites(robot, lines), forward, str(error))
    return override(found, robot, lines)


def frozen_lines(table: Mapping[str, Any]) -> list[str]:
    """Return the joints of the line `freeze = ["waist_*", "head_pan=0.2"]` of the table `[robot]`.

    Raises:
        MatchError: the line is no list of names.
    """
    lines = table.get(FREEZE, [])
    if not (isinstance(lines, list) and all(isinstance(line, str) for line in lines)):
        raise MatchError(f'freeze must be ["JOINT", "PATTERN=ANGLE", …], got {lines!r}')
    return lines


def _from_map(robot: Robot, sites: dict[str, KeypointSite], forward: Floats | None, reason: str) -> Anatomy:
    """The anatomy of a robot whose keypoints are all given: left is from the right hip to the left one.

    Args:
        forward: (3,) where the robot looks, if it is given too.
        reason: Why nothing was recognised.
    """
    links = Links(robot)
    across = links.place(sites["l_hip"].body, sites["l_hip"].offset)
    across = across - links.place(sites["r_hip"].body, sites["r_hip"].offset)
    up = np.array([0.0, 0.0, 1.0])
    left = unit(np.cross(up, forward) if forward is not None else across * [1, 1, 0])
    notes = (f"{reason}; the map, which names every keypoint, is used",)
    ankles = sorted({int(links.weld[sites[f"{side}_ankle"].body]) for side in SIDES})
    return assemble((links, flat_footed(links, ankles)), sites, Facing(np.cross(left, up), left, notes))


def _heading(line: Any) -> Floats:
    """Return the heading (3,) that a map gives; refuse one that is not along the floor."""
    if not (_are_numbers(line, 3) and np.linalg.norm(line[:2])):
        raise MatchError(f"forward must be [x, y, z], not straight up or down, got {line!r}")
    return np.array(line, dtype=float)


def _are_numbers(values: Any, count: int) -> bool:
    """Whether a value is a list of `count` finite numbers within `OUTLYING`."""
    return (
        isinstance(values, list)
        and len(values) == count
        and all(isinstance(v, int | float) and not isinstance(v, bool) and abs(v) <= OUTLYING for v in values)
    )


def override(anatomy: Anatomy, robot: Robot, table: Mapping[str, Any]) -> Anatomy:
    """Replace keypoints by lines `keypoint = ["body", x, y, z]` of a correspondence file.

    Args:
        anatomy: the robot's keypoints.
        table: keypoint → ["body", x, y, z] [m].

    Raises:
        MatchError: an unknown keypoint or body, or a line of another form.
    """
    return replace(anatomy, sites={**anatomy.sites, **_sites(robot, table)})


def _sites(robot: Robot, table: Mapping[str, Any]) -> dict[str, KeypointSite]:
    """The keypoints of lines `keypoint = ["body", x, y, z]`."""
    bodies = {robot.model.body(b).name: b for b in range(1, robot.model.nbody)}
    sites = {}
    for keypoint, line in table.items():
        if keypoint not in KEYPOINTS:
            raise MatchError(
                f"override names the keypoint {keypoint!r}; {known((*KEYPOINTS, FORWARD, FREEZE), typed=keypoint)}"
            )
        if not (isinstance(line, list) and line and isinstance(line[0], str) and _are_numbers(line[1:], 3)):
            raise MatchError(f'override of {keypoint} must be ["body", x, y, z], within {OUTLYING:g} m, got {line!r}')
        if line[0] not in bodies:
            raise MatchError(
                f"override of {keypoint}: {robot.name} has no body {line[0]!r}; {known(bodies, typed=line[0])}"
            )
        sites[keypoint] = KeypointSite(bodies[line[0]], np.array(line[1:], dtype=float), 1.0, "override")
    return sites


# Joints that keep an angle, or follow a file: the bounds of their range become it, for every stage that reads the robot.

PARTS = {"arms": ("l_hand", "r_hand"), "upper": ("l_ankle", "r_ankle")}
"""Keypoints at the ends of the limbs that alone may move (arms), or that alone may not (upper)."""
RANGE_ROUNDING = 1e-6
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
    if not any(hand in anatomy.sites for hand in PARTS["arms"]):
        raise UsageError(
            f"only {part!r}: {robot.name} has no two arms that mirror each other, and a single one is not recognised; "
            "freeze joints by name instead (--freeze)"
        )
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
    if not low - RANGE_ROUNDING <= angle <= high + RANGE_ROUNDING:
        raise UsageError(f"freeze {name}={angle:g}: outside its range {low:.3f} … {high:.3f} rad")
    return float(np.clip(angle, low, high))
