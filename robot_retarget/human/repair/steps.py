"""Steps between frames that no body makes: of the whole body, of its pose, of one limb."""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import median_filter

from robot_retarget.base.arrays import Floats


@dataclass(frozen=True)
class JumpRule:
    """Largest excess of a step over those around it; lengths in leg lengths."""

    around: int = 4
    """Steps to either side with which one is compared."""
    body: float = 0.1
    """Of the body as a whole, at any frame rate ..."""
    body_acceleration: float = 60.0
    """... and this on top over the squared frame rate [1/s²]: 5 g."""
    limb: float = 0.2
    """Of a keypoint relative to the body, at any frame rate ..."""
    limb_acceleration: float = 200.0
    """... and [1/s²]: 17 g, more than the fist of a boxer."""
    lowest_rate: float = 10.0
    """Least frame rate at which jumps are searched [1/s]."""

    def body_threshold(self, fps: float) -> float:
        """Return the largest step of the body as a whole [leg lengths]."""
        return self.body + self.body_acceleration / fps**2


def excess(steps: Floats, rule: JumpRule) -> Floats:
    """(T − 1, …, 3) of steps (T − 1, …, 3), what each has beyond the median of those around it."""
    size = (2 * rule.around + 1, *(1 for _ in steps.shape[1:]))
    return steps - median_filter(steps, size, mode="mirror")


def body_jumps(middle: Floats, fps: float, rule: JumpRule) -> Floats:
    """(T − 1, 3) jumps of the middle of the trunk (T, 3) [leg lengths]; 0 for steps that a body can make.

    Args:
        middle: (T, 3) middle of the trunk [leg lengths].
        fps: frames per second [1/s].
    """
    return _beyond(middle, rule.body_threshold(fps), rule)


def limb_jumps(points: Floats, middle: Floats, fps: float, rule: JumpRule) -> Floats:
    """(T − 1, K, 3) how points (T, K, 3) jump, seen from the middle of the trunk; 0 where they move by themselves.

    Args:
        points: (T, K, 3) keypoints [leg lengths].
        middle: (T, 3) middle of the trunk [leg lengths].
        fps: frames per second [1/s].
    """
    return _beyond(points - middle[:, None], rule.limb + rule.limb_acceleration / fps**2, rule)


def _beyond(places: Floats, most: float, rule: JumpRule) -> Floats:
    beyond = excess(np.diff(places, axis=0), rule)
    return np.where(np.linalg.norm(beyond, axis=-1, keepdims=True) > most, beyond, 0.0)
