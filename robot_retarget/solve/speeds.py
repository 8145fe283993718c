"""Paths that joints can follow at their speeds."""

import numpy as np

from robot_retarget.arrays import Floats


def within_speeds(angles: Floats, reach: Floats, fixed: int = 0) -> Floats:
    """(T, n) angles that change by no more than `reach` (n,) from frame to frame, and are themselves where they did not.

    Halfway between the highest such path under them and the lowest over them: both keep the speeds, and so does their mean.
    The first `fixed` frames stay, and what follows is what can be reached from them.
    """
    over, under = _bounded(angles, reach, np.maximum), _bounded(angles, reach, np.minimum)
    path = (over + under) / 2
    if fixed:
        path[:fixed] = angles[:fixed]
        room = np.arange(1, len(angles) - fixed + 1)[:, None] * reach
        path[fixed:] = np.clip(path[fixed:], angles[fixed - 1] - room, angles[fixed - 1] + room)
    return path


def _bounded(angles: Floats, reach: Floats, extreme: np.ufunc) -> Floats:
    """The least path over the angles (the greatest under them) that changes by no more than `reach` between frames."""
    path, way = angles.copy(), -reach if extreme is np.maximum else reach
    for t in range(1, len(path)):
        path[t] = extreme(path[t], path[t - 1] + way)
    for t in range(len(path) - 2, -1, -1):
        path[t] = extreme(path[t], path[t + 1] + way)
    return path
