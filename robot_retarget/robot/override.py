"""Lines of a map file that replace what was recognised in a robot."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from robot_retarget.arrays import Floats
from robot_retarget.errors import MatchError, known
from robot_retarget.keypoints import KEYPOINTS
from robot_retarget.robot.anatomy import Anatomy, Spot
from robot_retarget.robot.model import Robot
from robot_retarget.robot.recognise import recognise

FARTHEST = 10.0
"""A keypoint farther from its body is a mistake [m]."""
FORWARD = "forward"
"""The line that says where the robot looks."""


def recognise_with(robot: Robot, table: Mapping[str, Any]) -> Anatomy:
    """What is recognised in a robot, given the table `[robot]` of a map file.

    The line `forward = [x, y, z]` says where the robot looks in its reference pose; left and right follow. Lines
    `keypoint = ["body", x, y, z]` replace keypoints (`override`).

    Raises:
        MatchError: the robot is no humanoid, or a line is not of these forms.
    """
    lines = {keypoint: line for keypoint, line in table.items() if keypoint != FORWARD}
    return override(recognise(robot, _told(table[FORWARD]) if FORWARD in table else None), robot, lines)


def _told(line: Any) -> Floats:
    if not (_are_numbers(line, 3) and np.linalg.norm(line[:2])):
        raise MatchError(f"forward must be [x, y, z], not straight up or down, got {line!r}")
    return np.array(line, dtype=float)


def _are_numbers(values: Any, count: int) -> bool:
    """Whether a value is a list of so many numbers that are finite and within `FARTHEST`."""
    return (
        isinstance(values, list)
        and len(values) == count
        and all(isinstance(v, int | float) and not isinstance(v, bool) and abs(v) <= FARTHEST for v in values)
    )


def override(anatomy: Anatomy, robot: Robot, table: Mapping[str, Any]) -> Anatomy:
    """Replace keypoints by lines `keypoint = ["body", x, y, z]` of a correspondence file.

    Raises:
        MatchError: an unknown keypoint or body, or a line of another form.
    """
    bodies = {robot.model.body(b).name: b for b in range(1, robot.model.nbody)}
    spots = dict(anatomy.spots)
    for keypoint, line in table.items():
        if keypoint not in KEYPOINTS:
            raise MatchError(f"override names the keypoint {keypoint!r}; {known((*KEYPOINTS, FORWARD))}")
        if not (isinstance(line, list) and line and isinstance(line[0], str) and _are_numbers(line[1:], 3)):
            raise MatchError(f'override of {keypoint} must be ["body", x, y, z], within {FARTHEST:g} m, got {line!r}')
        if line[0] not in bodies:
            raise MatchError(f"override of {keypoint}: {robot.name} has no body {line[0]!r}; {known(bodies)}")
        spots[keypoint] = Spot(bodies[line[0]], np.array(line[1:], dtype=float), 1.0, "override")
    return replace(anatomy, spots=spots)
