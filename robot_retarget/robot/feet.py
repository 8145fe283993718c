"""The feet of a robot: the bodies that may stand on the floor, and the corners of their soles."""

from dataclasses import dataclass, replace

import numpy as np

from robot_retarget.base.errors import MatchError
from robot_retarget.robot.anatomy import Anatomy
from robot_retarget.robot.kinematics import Points
from robot_retarget.robot.model import Robot
from robot_retarget.robot.recognise import recognise
from robot_retarget.scene.ground import filled

CORNER_NAMES = ("front left", "front right", "rear left", "rear right")
CORNERS = len(CORNER_NAMES)
LEAST = 0.01
"""Least length and width of a sole [m]; a shorter sole has no clear heading."""
NONE = Points(np.zeros(0, int), np.zeros((0, 3)))


@dataclass(frozen=True, eq=False)
class Feet:
    """The feet and their soles."""

    names: tuple[str, ...]
    """F names, `l` and `r`; none where the robot is no humanoid."""
    bodies: tuple[frozenset[int], ...]
    """F: the bodies of each foot, toes too."""
    soles: Points
    """The points on which all feet stand, K in all."""
    owner: np.ndarray
    """(K,) the place of the foot that each sole point belongs to."""
    corners: Points
    """Four of each foot, that span its sole."""

    @property
    def filled(self) -> "Feet":
        """The feet with points in rows all over their soles: on a step, any part may carry."""
        if not self.names:
            return self
        offsets = filled(self.corners.offsets.reshape(-1, CORNERS, 3))
        owner = np.repeat(np.arange(len(offsets)), offsets.shape[1])
        return replace(self, soles=Points(self.corners.bodies[CORNERS * owner], offsets.reshape(-1, 3)), owner=owner)

    @property
    def all_bodies(self) -> list[int]:
        """Bodies of any foot."""
        return sorted(set().union(*self.bodies))


def feet_of(robot: Robot) -> Feet:
    """The recognised feet; empty for a robot that is no humanoid."""
    try:
        anatomy = recognise(robot)
        treads = anatomy.treads
    except MatchError:
        anatomy, treads = None, {}
    names = tuple(treads)
    bodies = tuple(with_toes(robot, {int(b) for b in treads[name].bodies}) for name in names)
    if anatomy is None or not names:
        return Feet((), (), NONE, np.zeros(0, int), NONE)
    points = together([treads[name] for name in names])
    corners = together([sole_corners(anatomy, name) for name in names])
    owner = np.repeat(np.arange(len(names)), [len(treads[name].bodies) for name in names])
    return Feet(names, bodies, points, owner, corners)


def together(parts: list[Points]) -> Points:
    """Return the points of several parts, one after the other."""
    points = [NONE, *parts]
    return Points(np.concatenate([p.bodies for p in points]), np.concatenate([p.offsets for p in points]))


def with_toes(robot: Robot, foot: set[int]) -> frozenset[int]:
    """A foot's bodies with all that hang on them."""
    for body in range(1, robot.model.nbody):  # parents come before their children
        if robot.model.body_parentid[body] in foot or robot.model.body_weldid[body] in foot:
            foot.add(body)
    return frozenset(foot)


def sole_corners(anatomy: Anatomy, foot: str) -> Points:
    """Return the corners of the contact area of a foot, in the order of `CORNER_NAMES`.

    A foot that stands on a point or a line has the heading of its frame; a small rectangle along this heading replaces
    it.

    Args:
        anatomy: soles and frames of the robot.
        foot: `l` or `r`.
    """
    body, axes = anatomy.frames[f"{foot}_foot"]
    along = anatomy.treads[foot].offsets @ axes
    low, middle, half = along[:, 2].min(), (along.min(0) + along.max(0)) / 2, np.ptp(along, axis=0) / 2
    (back, right, _), (front, left, _) = (middle + way * np.maximum(half, LEAST / 2) for way in (-1, 1))
    corners = np.array([[front, left, low], [front, right, low], [back, left, low], [back, right, low]])
    return Points(np.full(CORNERS, body), corners @ axes.T)
