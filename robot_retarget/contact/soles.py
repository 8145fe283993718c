"""The contacts of a robot's soles: which are on the ground, and which parts of them stand there.

Places of soles are exact, so their thickness is small; their speeds are judged as those of a human's feet.
"""

import numpy as np

from robot_retarget.base.arrays import Floats
from robot_retarget.base.errors import MatchError
from robot_retarget.base.keypoints import SIDES
from robot_retarget.contact.record import ContactRecord
from robot_retarget.contact.rule import SOLES, ContactRule, on_surface, standing
from robot_retarget.robot import Anatomy, Points, Robot, recognise, world_points
from robot_retarget.scene.geoms import SolidGround
from robot_retarget.scene.scene import Scene
from robot_retarget.trajectory import Trajectory


def contacts_of(trajectory: Trajectory, robot: Robot, anatomy: Anatomy | None = None) -> ContactRecord:
    """Return the contacts of a trajectory's feet, the bodies around at rest being ground; no feet for a robot that is no humanoid.

    Args:
        trajectory: of T frames.
        robot: the robot that moves.
        anatomy: its soles; by default as recognised.
    """
    try:
        known = anatomy or recognise(robot)
    except MatchError:
        return ContactRecord((), np.zeros((len(trajectory), 0), bool), np.zeros((len(trajectory), 0, 2), bool))
    return sole_contacts(robot, known, trajectory.qpos, trajectory.fps, trajectory.scene)


def sole_contacts(
    robot: Robot, anatomy: Anatomy, qpos: Floats, fps: float, scene: Scene | None = None, rule: ContactRule = SOLES
) -> ContactRecord:
    """Detect the contacts of a robot's soles; toe and heel are the front and the rear half.

    Without bodies, the floor is at the lowest height that the soles have, so that a clip may float as a whole.

    Args:
        robot: the robot.
        anatomy: its soles.
        qpos: (T, nq) configurations.
        fps: frames per second [1/s].
        scene: bodies around the robot; those at rest are ground.
        rule: thresholds.
    """
    ground, leg, feet = SolidGround(scene), leg_of(robot, anatomy), tuple(f for f in SIDES if f in anatomy.treads)
    down = np.zeros((len(qpos), len(feet)), dtype=bool)
    stands = np.zeros((*down.shape, 2), dtype=bool)
    places = [world_points(robot, anatomy.treads[foot], qpos) for foot in feet]
    over = [ground.over(points) for points in places]
    floor = 0.0
    if feet and ground.level:
        floor = float(rule.floor_height(np.min([own.min(axis=1) for own in over], axis=0)))
    for k, (foot, points) in enumerate(zip(feet, places, strict=True)):
        height = (over[k] - floor) / leg
        down[:, k] = on_surface(height, rule)
        ahead = anatomy.treads[foot].offsets @ anatomy.frames[f"{foot}_foot"][1][:, 0]
        front = ahead > (ahead.min() + ahead.max()) / 2
        for column, edge in enumerate((front, ~front)):
            stands[:, k, column] = standing(points[:, edge].mean(axis=1) / leg, height[:, edge].min(axis=1), fps, rule)
    return ContactRecord(feet, down, stands, floor)


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
