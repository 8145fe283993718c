"""The standing pose of a model without a keyframe: its reference pose, with arms that point elsewhere hanging down."""

from functools import lru_cache
from itertools import product

import numpy as np
from scipy.optimize import least_squares

from robot_retarget.base.arrays import Floats, frozen, leftward, unit
from robot_retarget.base.errors import MatchError
from robot_retarget.base.keypoints import SIDES
from robot_retarget.robot.anatomy import Anatomy, limb_hinges
from robot_retarget.robot.kinematics import Points, world_points
from robot_retarget.robot.model import Robot
from robot_retarget.robot.recognise import KEPT, recognise

HANGING = np.pi / 4
"""An upper arm nearer to straight down hangs [rad]: the standing keyframes of OP3, T1, ToddlerBot and G1 have 0.17 to 0.3."""
ASIDE = 0.2
"""A hanging arm points aside by this angle, as in those keyframes (0.17 to 0.3), so that hands clear the hips [rad] ..."""
FOREARM_BENT = 0.3
"""... and its forearm forward by this one, which shows the twist of the arm [rad]: half and double change the
standing poses of 3 of 8 robots by this half and this whole."""
STAY = 0.01
"""Weight of the angles of hinges [1/rad] over that of the directions [-]: between equal poses the reference pose
decides. Half and double move hinges of eight robots by at most 4e-3 rad."""
TURNS_TRIED = 3
"""Number of quarter turns of the hinges that a descent starts from: the nearest. With 2 and 6 eight robots stand the
same."""


@lru_cache(maxsize=KEPT)
def with_arms_down(robot: Robot) -> Floats:
    """Return the standing pose (nq,) of a robot without a standing keyframe.

    The hinges from the chest to the elbow turn within their ranges until the upper arm points down and a little aside, and the
    forearm a little forward. Arms that hang in the reference pose, and robots that are no humanoids, keep it.
    """
    pose = np.array(robot.model.qpos0)
    try:
        anatomy = recognise(robot)
    except MatchError:
        return frozen(pose)
    for side in SIDES:
        if {f"{side}_{part}" for part in ("shoulder", "elbow", "hand")} <= anatomy.sites.keys():
            _hang(robot, anatomy, side, pose)
    return frozen(pose)


def _hang(robot: Robot, anatomy: Anatomy, side: str, pose: Floats) -> None:
    """Turn one arm of a pose (nq,) down."""
    points = anatomy.points_of([f"{side}_{part}" for part in ("shoulder", "elbow", "hand")])
    hinges = limb_hinges(robot, anatomy, f"{side}_elbow")
    if not hinges.size or _bones(robot, points, pose[None])[0, 0, 2] < -np.cos(HANGING):
        return
    ahead = unit(anatomy.forward * [1.0, 1.0, 0.0])
    aside = np.append(leftward(ahead[:2]), 0.0) * (1.0 if side == "l" else -1.0)
    wanted = np.array([[np.sin(ASIDE), 0.0, -np.cos(ASIDE)], [0.0, np.sin(FOREARM_BENT), -np.cos(FOREARM_BENT)]])
    wanted = wanted @ np.stack([aside, ahead, [0.0, 0.0, 1.0]])
    columns, bounds = robot.qpos_index[hinges], (robot.lower[hinges] - 1e-9, robot.upper[hinges] + 1e-9)
    own = np.clip(pose[columns], *bounds)

    def errors(angles: Floats) -> Floats:
        """Return (N, 6 + n) the errors of angles (N, n)."""
        turned = np.tile(pose, (len(angles), 1))
        turned[:, columns] = angles
        return np.hstack([(_bones(robot, points, turned) - wanted).reshape(len(angles), -1), STAY * (angles - own)])

    starts = np.clip(own + _starts(len(hinges)), *bounds)
    nearest = starts[np.argsort((errors(starts) ** 2).sum(axis=1))[:TURNS_TRIED]]
    found = [least_squares(lambda angles: errors(angles[None])[0], s, bounds=bounds, xtol=1e-6) for s in nearest]
    pose[columns] = min(found, key=lambda solved: solved.cost).x


def _starts(count: int) -> Floats:
    """Return quarter turns (S, n) either way of the first three of n hinges, one for each combination."""
    turns = np.array(list(product((0.0, np.pi / 2, -np.pi / 2), repeat=min(count, 3))))
    return np.pad(turns, ((0, 0), (0, count - turns.shape[1])))


def _bones(robot: Robot, points: Points, poses: Floats) -> Floats:
    """Return the directions (N, 2, 3) of upper arm and forearm in poses (N, nq)."""
    return unit(np.diff(world_points(robot, points, poses), axis=1))
