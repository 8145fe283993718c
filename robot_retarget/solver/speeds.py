"""Paths of hinge angles within the speeds of joints."""

import numpy as np

from robot_retarget.base.arrays import Floats


def within_speeds(angles: Floats, reach: Floats, fixed: int = 0) -> Floats:
    """Return (T, n) angles that change by at most `reach` per frame; a path that does so already stays unchanged.

    The result is halfway between the highest such path below the angles and the lowest above them: both keep the
    speeds, and so does their mean. The first `fixed` frames stay, and the frames after them are limited to angles
    within reach of them.

    Args:
        angles: (T, n) [rad].
        reach: (n,) or (T − 1, n) largest change from a frame to the next [rad].
        fixed: number of first frames that stay unchanged.
    """
    reach = np.broadcast_to(reach, (max(len(angles) - 1, 0), angles.shape[1]))
    over, under = _bounded(angles, reach, np.maximum), _bounded(angles, reach, np.minimum)
    path = (over + under) / 2
    if fixed:
        path[:fixed] = angles[:fixed]
        room = np.cumsum(reach[fixed - 1 :], axis=0)
        path[fixed:] = np.clip(path[fixed:], angles[fixed - 1] - room, angles[fixed - 1] + room)
    return path


def _bounded(angles: Floats, reach: Floats, extreme: np.ufunc) -> Floats:
    """Return the lowest path over the angles, or the highest under them, that changes by at most `reach` per frame."""
    path, way = angles.copy(), -reach if extreme is np.maximum else reach
    for t in range(1, len(path)):
        path[t] = extreme(path[t], path[t - 1] + way[t - 1])
    for t in range(len(path) - 2, -1, -1):
        path[t] = extreme(path[t], path[t + 1] + way[t])
    return path
