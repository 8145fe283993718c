"""The feet as the floor sees them: which bodies may stand on it, and the corners of their soles."""

from dataclasses import dataclass

import numpy as np

from robot_retarget.errors import MatchError
from robot_retarget.robot.kinematics import Points
from robot_retarget.robot.model import Robot
from robot_retarget.robot.recognise import recognise


@dataclass(frozen=True, eq=False)
class Feet:
    """What stands on the floor."""

    names: tuple[str, ...]
    """F names, such as `left_foot`; none where the robot is no humanoid."""
    bodies: tuple[frozenset[int], ...]
    """F: the bodies of each foot, toes too."""
    soles: Points
    """Sole points of all feet, K in all."""
    owner: np.ndarray
    """(K,) the place of the foot that each sole point belongs to."""

    @property
    def all_bodies(self) -> list[int]:
        """Bodies of any foot."""
        return sorted(set().union(*self.bodies))


def feet_of(robot: Robot) -> Feet:
    """The recognised feet; empty for a robot that is no humanoid."""
    try:
        soles = recognise(robot).soles
    except MatchError:
        soles = {}
    names = tuple(soles)
    bodies = tuple(with_toes(robot, {int(b) for b in soles[name].bodies}) for name in names)
    if not names:
        return Feet((), (), Points(np.zeros(0, int), np.zeros((0, 3))), np.zeros(0, int))
    points = Points(
        np.concatenate([soles[name].bodies for name in names]), np.concatenate([soles[name].offsets for name in names])
    )
    owner = np.repeat(np.arange(len(names)), [len(soles[name].bodies) for name in names])
    return Feet(names, bodies, points, owner)


def with_toes(robot: Robot, foot: set[int]) -> frozenset[int]:
    """A foot's bodies with all that hang on them."""
    for body in range(1, robot.model.nbody):  # parents come before their children
        if robot.model.body_parentid[body] in foot or robot.model.body_weldid[body] in foot:
            foot.add(body)
    return frozenset(foot)
