"""Clips that are nearly the same motion."""

from collections.abc import Iterable

import numpy as np
from scipy.spatial import KDTree

from robot_retarget.batch.manifest import Row

ALIKE = 0.01
"""Mean and deviation of every hinge differ by less than this [rad]."""
LENGTH = 0.02
"""Durations differ by less than this share [-]."""


def near_duplicates(rows: Iterable[Row]) -> list[tuple[str, str, str]]:
    """(robot, clip, clip) whose hinges have the same means and deviations and whose durations agree, sorted."""
    by_robot: dict[str, list[Row]] = {}
    for row in rows:
        if row.signature and row.frames:
            by_robot.setdefault(row.robot, []).append(row)
    found = list[tuple[str, str, str]]()
    for robot, alike in by_robot.items():
        tree = KDTree(np.array([row.signature for row in alike]))
        for a, b in tree.query_pairs(ALIKE, p=np.inf):
            first, second = sorted((alike[a].clip, alike[b].clip))
            lengths = sorted(row.frames / row.fps for row in (alike[a], alike[b]))
            if lengths[1] - lengths[0] <= LENGTH * lengths[1]:
                found.append((robot, first, second))
    return sorted(found)
