"""Layers over a robot in motion: keypoints, joints, footholds and support, near pairs."""

from collections.abc import Iterator
from dataclasses import dataclass

import mujoco
import numpy as np
from scipy.spatial import ConvexHull, QhullError

from robot_retarget.base.arrays import Floats, Ints
from robot_retarget.base.errors import MatchError
from robot_retarget.base.keypoints import parents_within
from robot_retarget.collision.warn import Warnings
from robot_retarget.robot.body_distances import RobotAmongBodies
from robot_retarget.robot.dynamics import Stance
from robot_retarget.robot.geoms import collision_geoms
from robot_retarget.robot.kinematics import world_points
from robot_retarget.robot.model import Robot
from robot_retarget.robot.recognise import recognise
from robot_retarget.scene.geoms import PREFIX, moving_bodies, place_bodies
from robot_retarget.scene.scene import Scene
from robot_retarget.tools.view.staging import Staging

PAIRS = 12
"""Number of pairs of links that are shown, the nearest first."""
NEAR = 0.05
"""Pairs whose interaction distance is under this part of the robot's height are near."""


@dataclass(frozen=True, eq=False)
class Keypoints:
    """K recognised points of a robot over T frames."""

    names: tuple[str, ...]
    points: Floats
    """(T, K, 3) [m]."""
    bones: Ints
    """(B, 2)."""


def keypoints_of(robot: Robot, qpos: Floats) -> Keypoints | None:
    """The keypoints at configurations (T, nq); None for a robot that is no humanoid."""
    try:
        anatomy = recognise(robot)
    except MatchError:
        return None
    names = anatomy.names
    tree = parents_within(names)
    bones = np.array([(names.index(child), names.index(parent)) for child, parent in tree.items()])
    return Keypoints(names, world_points(robot, anatomy.points, qpos), bones.reshape(-1, 2))


def anchors(robot: Robot, qpos: Floats) -> Floats:
    """Where the hinges are (T, n, 3) at configurations (T, nq) [m]."""
    data, found = mujoco.MjData(robot.model), np.empty((len(qpos), len(robot.joint_ids), 3))
    for t, q in enumerate(qpos):
        data.qpos[:] = q
        mujoco.mj_kinematics(robot.model, data)
        found[t] = data.xanchor[robot.joint_ids]
    return found


@dataclass(frozen=True, eq=False)
class Foothold:
    """A stance of one foot."""

    foot: str
    first: int
    last: int
    """Frames."""
    outline: Floats
    """(N, 2) of the sole points that carry, in the middle of that time [m]."""
    height: float
    """Mean of theirs [m]."""


def outline(corners: Floats) -> Floats:
    """The convex hull (N, 2) of points (M, 2), anticlockwise; points without an interior are returned unchanged [m]."""
    try:
        return corners[ConvexHull(corners).vertices]
    except (QhullError, ValueError):
        return corners


def footholds(stance: Stance, fps: float) -> list[Foothold]:
    """Every stretch of a foot on the floor, by feet, in order of time; `stance` at times of frames."""
    found = []
    for k, name in enumerate(stance.feet.names):
        mine = stance.feet.owner == k
        for first, last in runs(stance.touching[:, k]):
            middle = (first + last) // 2
            carrying = mine & stance.down[middle]
            if carrying.any():
                points = stance.points[middle, carrying]
                found.append(Foothold(name, first, last, outline(points[:, :2]), float(points[:, 2].mean())))
    return found


def runs(flags: np.ndarray) -> Iterator[tuple[int, int]]:
    """First and last place of every stretch of flags (T,)."""
    edge = np.diff(np.asarray(flags).astype(np.int8), prepend=0, append=0)
    return zip(np.flatnonzero(edge == 1).tolist(), (np.flatnonzero(edge == -1) - 1).tolist(), strict=True)


@dataclass(frozen=True, eq=False)
class NearestPairs:
    """The P pairs of links that come nearest, over T frames."""

    columns: Ints
    """(P,) their places in the warnings."""
    ends: Floats
    """(T, P, 2, 3) the nearest points of their surfaces, NaN if they are far apart [m]."""


def near_pairs(staging: Staging, warnings: Warnings) -> NearestPairs:
    """Where the surfaces of pairs that come near are nearest to each other, by MuJoCo's distance of geoms.

    Pairs that are near most of the time are neighbours by construction; they are shown during warnings only.

    Args:
        staging: of all frames of the warnings.
    """
    robot, qpos, scene = staging.robot, staging.qpos, staging.scene
    near = warnings.ahead < min(NEAR * staging.height, warnings.reach)
    shown = (near & (near.mean(axis=0) < 0.5)) | warnings.flagged
    columns = np.flatnonzero(shown.any(axis=0))
    columns = columns[np.argsort(warnings.ahead[:, columns].min(axis=0), kind="stable")][:PAIRS]
    model = robot.model if scene is None else RobotAmongBodies(robot, scene).model
    data, around = mujoco.MjData(model), Scene(()) if scene is None else scene
    moving, poses = moving_bodies(model, around), around.poses(len(qpos))
    geoms = {robot.model.body(link).name: own for link, own in collision_geoms(robot).items()}
    geoms |= {name: [model.geom(PREFIX + name).id] for name in around.names}
    ends = np.full((len(qpos), len(columns), 2, 3), np.nan)
    for t in np.flatnonzero(shown[:, columns].any(axis=1)).tolist():
        data.qpos[:] = qpos[t]
        place_bodies(data, poses[t], moving)
        mujoco.mj_kinematics(model, data)
        for p in np.flatnonzero(shown[t, columns]).tolist():
            first, second = warnings.pairs[columns[p]]
            ends[t, p] = _nearest(model, data, geoms[first], geoms[second])
    return NearestPairs(columns, ends)


def _nearest(model: mujoco.MjModel, data: mujoco.MjData, first: list[int], second: list[int]) -> Floats:
    """The ends (2, 3) of the shortest line between two lists of geoms [m]."""
    best, line, found = np.inf, np.zeros(6), np.full(6, np.nan)
    for a in first:
        for b in second:
            distance = mujoco.mj_geomDistance(model, data, a, b, 1.0, line)
            if distance < min(best, 1.0):
                best, found = distance, line.copy()
    return found.reshape(2, 3)
