"""The contacts of a robot's soles: which are on the ground, and which parts of them stand there.

Places of soles are exact, so their thickness is small; their speeds are judged as those of a human's feet.
"""

from dataclasses import dataclass

import numpy as np

from robot_retarget.base.arrays import Bools, Floats
from robot_retarget.base.keypoints import SIDES
from robot_retarget.contact.rule import SOLES, on_surface, standing
from robot_retarget.robot import Anatomy, Points, Robot, world_points
from robot_retarget.scene.geoms import SolidGround
from robot_retarget.scene.scene import Scene


@dataclass(frozen=True, eq=False)
class SoleContacts:
    """Contacts of F feet over T frames."""

    feet: tuple[str, ...]
    floor: float
    """Height of the lowest that the soles are [m]; 0 among bodies."""
    heights: Floats
    """(T, F) of the lowest point of each sole over the ground [m]."""
    down: Bools
    """(T, F) whether a sole is on the ground, at any speed."""
    stands: Bools
    """(T, F, 2) whether the front half of a sole stands, and whether the rear half does: on the ground and slow."""

    @property
    def flying(self) -> Bools:
        """(T,) whether no sole is on the ground; never for a robot without feet."""
        return ~np.asarray(self.down.any(axis=1)) if self.feet else np.zeros(len(self.down), dtype=bool)

    @property
    def labels(self) -> Bools:
        """(T, 2 F) per foot whether its heel stands, and whether its toe does, as sources of motions give contacts."""
        return self.stands[:, :, ::-1].reshape(len(self.stands), -1)


def sole_contacts(robot: Robot, anatomy: Anatomy, qpos: Floats, fps: float, scene: Scene | None = None) -> SoleContacts:
    """Detect the contacts of a robot's soles.

    Without bodies, the floor is at the lowest height that the soles have, so that a clip may float as a whole.

    Args:
        robot: the robot.
        anatomy: its soles.
        qpos: (T, nq) configurations.
        fps: frames per second [1/s].
        scene: bodies around the robot; those at rest are ground.
    """
    ground, leg, feet = SolidGround(scene), leg_of(robot, anatomy), tuple(f for f in SIDES if f in anatomy.treads)
    heights, down = np.zeros((len(qpos), len(feet))), np.zeros((len(qpos), len(feet)), dtype=bool)
    stands = np.zeros((*down.shape, 2), dtype=bool)
    places = [world_points(robot, anatomy.treads[foot], qpos) for foot in feet]
    over = [ground.over(points) for points in places]
    floor = 0.0
    if feet and ground.level:
        floor = float(SOLES.floor_height(np.min([own.min(axis=1) for own in over], axis=0)))
    for k, (foot, points) in enumerate(zip(feet, places, strict=True)):
        height = over[k] - floor
        heights[:, k] = height.min(axis=1)
        down[:, k] = on_surface(height / leg, SOLES)
        ahead = anatomy.treads[foot].offsets @ anatomy.frames[f"{foot}_foot"][1][:, 0]
        front = ahead > (ahead.min() + ahead.max()) / 2
        for column, edge in enumerate((front, ~front)):
            stands[:, k, column] = standing(
                points[:, edge].mean(axis=1) / leg, height[:, edge].min(axis=1) / leg, fps, SOLES
            )
    return SoleContacts(feet, floor, heights, down, stands)


def leg_of(robot: Robot, anatomy: Anatomy) -> float:
    """Return the length of a robot's leg, the mean of both: hip to knee to ankle in the reference pose; 1 without legs [m]."""
    lengths = []
    for side in "lr":
        sites = [anatomy.sites.get(f"{side}_{part}") for part in ("hip", "knee", "ankle")]
        if all(sites):
            points = Points(np.array([s.body for s in sites if s]), np.array([s.offset for s in sites if s]))
            places = world_points(robot, points, robot.neutral()[None])[0]
            lengths.append(np.linalg.norm(np.diff(places, axis=0), axis=1).sum())
    return float(np.mean(lengths)) if lengths else 1.0
