"""Whether a repair leaves a motion at least as smooth as it was: no point moves farther between two frames."""

import numpy as np

from robot_retarget.base.arrays import Floats

REFUSED = "not repaired, since bridging would make the motion less smooth"
ROUNDING = 1e-9
"""Share by which equal steps may differ."""


def is_smoother(before: Floats, after: Floats) -> bool:
    """Compare the longest step of every point.

    Args:
        before: (T, P, 3) points over the frames that a repair changes, with one frame on either side.
        after: (T, P, 3) the same points repaired.
    """
    longest = [np.linalg.norm(np.diff(points, axis=0), axis=2).max(axis=0, initial=0.0) for points in (before, after)]
    return bool((longest[1] <= longest[0] * (1 + ROUNDING)).all())
