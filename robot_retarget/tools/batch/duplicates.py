"""Clips that are nearly the same motion."""

from collections.abc import Iterable, Sequence

import numpy as np
from scipy.spatial import KDTree

from robot_retarget.tools.batch.task import Row

ALIKE = 0.01
"""Mean and deviation of every hinge differ by less than this [rad]."""
LENGTH = 0.02
"""Durations differ by less than this share [-]."""


def near_duplicates(rows: Iterable[Row]) -> list[tuple[str, str, str]]:
    """(robot, first, clip): clips whose hinges have the means and deviations of an earlier one, and its duration.

    Each clip is listed once, with the first clip that it is like: without those listed, one of each remains.
    """
    by_robot: dict[str, list[Row]] = {}
    for row in sorted(rows, key=lambda row: row.key):
        if row.signature and row.frames:
            by_robot.setdefault(row.robot, []).append(row)
    return [
        (robot, alike[first].clip, alike[k].clip)
        for robot, alike in by_robot.items()
        for k, first in _first_of(alike).items()
    ]


def _first_of(alike: Sequence[Row]) -> dict[int, int]:
    """The first row that each duplicate is like."""
    signatures = np.array([row.signature for row in alike])
    lengths = np.array([row.frames / row.fps for row in alike])
    tree, first = KDTree(signatures), dict[int, int]()
    for k in range(len(alike)):
        if k in first:
            continue
        near = np.array(tree.query_ball_point(signatures[k], ALIKE, p=np.inf))
        off = np.abs(lengths[near] - lengths[k]) <= LENGTH * np.maximum(lengths[near], lengths[k])
        first |= {int(other): k for other in near[off] if other > k and int(other) not in first}
    return dict(sorted(first.items()))
