"""Lines of a map file that replace recognised keypoints of a robot."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from robot_retarget.base.arrays import Floats, unit
from robot_retarget.base.errors import MatchError, known
from robot_retarget.base.keypoints import KEYPOINTS, SIDES
from robot_retarget.robot.anatomy import Anatomy, KeypointSite
from robot_retarget.robot.facing import Facing
from robot_retarget.robot.links import Links
from robot_retarget.robot.model import Robot
from robot_retarget.robot.recognise import assemble, recognise
from robot_retarget.robot.soles import flat_footed

FARTHEST = 10.0
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
    """Whether a value is a list of `count` finite numbers within `FARTHEST`."""
    return (
        isinstance(values, list)
        and len(values) == count
        and all(isinstance(v, int | float) and not isinstance(v, bool) and abs(v) <= FARTHEST for v in values)
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
            raise MatchError(f'override of {keypoint} must be ["body", x, y, z], within {FARTHEST:g} m, got {line!r}')
        if line[0] not in bodies:
            raise MatchError(
                f"override of {keypoint}: {robot.name} has no body {line[0]!r}; {known(bodies, typed=line[0])}"
            )
        sites[keypoint] = KeypointSite(bodies[line[0]], np.array(line[1:], dtype=float), 1.0, "override")
    return sites
