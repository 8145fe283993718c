"""How long bones are, and whether a source's are a robot's own."""

import numpy as np

from robot_retarget.arrays import Floats, Ints, frozen
from robot_retarget.robot import Points, Robot, world_points

OWN = 0.003
"""A source whose bones are all within this of what the robot's can be is the robot itself [-]."""
POSES = 64
"""Drawn within the joints' ranges to see how long bones can be."""


def bone_lengths(positions: Floats, parents: Ints) -> Floats:
    """(K,) of the bones to the parents in the middle of positions (T, K, 3), 0 at the root [m]."""
    return frozen(np.median(_lengths(positions, parents), axis=0))


def own_bones(robot: Robot, points: Points, keypoints: tuple[str, ...], parents: Ints, source: Floats) -> Floats | None:
    """The bones of a source (K,) at the robot's scale [m] if the robot could have them all, else None.

    Some bones are longer in one pose than in another, as a shoulder's that turns with the arm. No human's are all what a
    robot's can be; where a source's are, it is the robot itself that moved, and shows how long they were.
    """
    lengths, joined = _lengths(_captured(robot, points, keypoints), parents), parents >= 0
    scaled = source * np.median(lengths[0, joined] / np.maximum(source[joined], 1e-9))
    could = (scaled >= lengths.min(axis=0) * (1 - OWN)) & (scaled <= lengths.max(axis=0) * (1 + OWN))
    return frozen(scaled) if could.all() else None


def _lengths(positions: Floats, parents: Ints) -> Floats:
    return np.where(parents >= 0, np.linalg.norm(positions - positions[:, parents], axis=2), 0.0)


def _captured(robot: Robot, points: Points, keypoints: tuple[str, ...]) -> Floats:
    """(P, K, 3) where a motion capture of the robot would find its keypoints: at rest, standing and in drawn poses [m].

    Its pelvis would be the middle of the hips, which swings about the robot's where hinges of the hip do not meet.
    """
    drawn = np.tile(robot.neutral(), (POSES, 1))
    drawn[:, robot.qpos_index] = np.random.default_rng(0).uniform(robot.lower, robot.upper, (POSES, len(robot.lower)))
    x = world_points(robot, points, np.vstack([robot.neutral(), robot.standing(), drawn]))
    hips = [keypoints.index(k) for k in ("l_hip", "r_hip") if k in keypoints]
    if "pelvis" in keypoints and len(hips) == 2:
        x[:, keypoints.index("pelvis")] = x[:, hips].mean(axis=1)
    return x
