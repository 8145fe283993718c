"""Distances between keypoints over the length of the path that joins them: ‖x_u − x_v‖/τ_uv."""

import itertools

import numpy as np

from robot_retarget.arrays import Floats
from robot_retarget.robot.kinematics import BLOCK
from robot_retarget.score.pair import Pair


def pairs_of(pair: Pair) -> list[tuple[int, int]]:
    """All pairs of keypoints, in the order of the columns of `closeness`."""
    return list(itertools.combinations(range(len(pair.keypoints)), 2))


def closeness(pair: Pair) -> tuple[Floats, Floats]:
    """(T, P) of the human and of the robot, 0 (together) to 1 (stretched)."""
    human, robot = (_over_paths(pair, x, bones) for x, bones in zip((pair.human, pair.robot), pair.bones, strict=True))
    return human, robot


def _over_paths(pair: Pair, x: Floats, bones: Floats) -> Floats:
    """(T, P), a block of frames at a time."""
    (first, second), paths = np.array(pairs_of(pair)).T, _paths(pair, bones)
    found = np.empty((len(x), len(paths)))
    for start in range(0, len(x), BLOCK):
        block = x[start : start + BLOCK]
        found[start : start + BLOCK] = np.linalg.norm(block[:, first] - block[:, second], axis=2) / paths
    return found


def _paths(pair: Pair, bones: Floats) -> Floats:
    """(P,) length of the path over the skeleton [m]."""
    above = [set(_above(pair, k)) for k in range(len(pair.keypoints))]
    return np.array([bones[list(above[u] ^ above[v])].sum() for u, v in pairs_of(pair)])


def _above(pair: Pair, keypoint: int) -> list[int]:
    """A keypoint and its ancestors; the bone of each leads to its parent."""
    path = [keypoint]
    while (parent := int(pair.parents[path[-1]])) >= 0:
        path.append(parent)
    return path
