"""The one detector of foot contact: a point stands while it is slow and near its lowest height.

Speeds are in leg lengths per second, heights in leg lengths. A point starts to stand below the enter thresholds and stops
above the leave thresholds (a Schmitt trigger in speed and height).
"""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import median_filter, minimum_filter1d, uniform_filter1d

from robot_retarget.base.arrays import Bools, Floats

WINDOW = 0.6
"""A body touches the floor at least once in twice this time, because no jump lasts longer [s]."""


@dataclass(frozen=True)
class StanceRule:
    """Thresholds of the contact detector."""

    enter_speed: float = 0.3
    leave_speed: float = 0.4
    """[leg lengths / s]"""
    enter_height: float = 0.08
    leave_height: float = 0.10
    """Above the floor [leg lengths]."""
    shortest: float = 0.075
    """Stances and swings no longer than this are noise [s]."""
    flight: float = 0.15
    """A longer time with both feet in the air is a flight [s]."""
    averaged: float = 0.1
    """Time over which speeds are averaged [s]: one tenth, so that the frame rate does not matter."""
    floor: float = 0.02
    """Quantile of the heights that is the floor: lower ones are outliers [-]."""

    def floor_height(self, heights: Floats, axis: int | None = None) -> Floats:
        """Return the floor under points, from their heights [m or leg lengths].

        Args:
            heights: of points over time [m or leg lengths].
            axis: axis of time; by default all axes.
        """
        return np.quantile(heights, self.floor, axis=axis)

    def triggers(self, speed: Floats, height: Floats) -> tuple[Bools, Bools]:
        """Return whether points may start to stand, and whether points that stand may stay.

        Args:
            speed: (…) [leg lengths / s].
            height: (…) above the floor [leg lengths].
        """
        enter = (speed < self.enter_speed) & (height < self.enter_height)
        return enter, (speed < self.leave_speed) & (height < self.leave_height)


def standing(points: Floats, height: Floats, fps: float, rule: StanceRule) -> Bools:
    """Detect when a point stands, from the whole clip.

    Args:
        points: (T, 3) [leg lengths].
        height: (T,) above the floor [leg lengths].

    Returns:
        (T,) True while the point stands.
    """
    return without_flicker(_hysteresis(*rule.triggers(speed_of(points, fps, rule), height)), fps, rule)


def without_flicker(stands: Bools, fps: float, rule: StanceRule) -> Bools:
    """Remove stances and swings (T, …) no longer than `rule.shortest`.

    Args:
        stands: (T, …) whether points stand.
        fps: frames per second [1/s].
    """
    width = 2 * int(rule.shortest * fps) + 1
    size = (width, *(1,) * (stands.ndim - 1))
    return median_filter(stands.astype(np.uint8), size, mode="nearest").astype(bool)


def speed_of(points: Floats, fps: float, rule: StanceRule) -> Floats:
    """Return the speed (T, …) of points (T, …, 3), averaged over `rule.averaged`.

    Args:
        points: (T, …, 3) [leg lengths].
        fps: frames per second [1/s].
    """
    if len(points) < 2:
        return np.zeros(points.shape[:-1])
    step = np.linalg.norm(np.diff(points, axis=0), axis=-1) * fps
    step = np.concatenate([step[:1], (step[:-1] + step[1:]) / 2, step[-1:]])
    return uniform_filter1d(step, max(1, round(rule.averaged * fps)), axis=0, mode="nearest")


def _hysteresis(enter: Bools, stay: Bools) -> Bools:
    """Return the runs of `stay` that contain a frame of `enter`."""
    runs = np.cumsum(np.concatenate([[True], stay[1:] != stay[:-1]]))
    entered = np.zeros(runs[-1] + 1, dtype=bool)
    entered[runs[enter]] = True
    return stay & entered[runs]


def lowest_over_time(heights: Floats, fps: float) -> Floats:
    """Return the lowest of heights (T, K) within `WINDOW` to either side of each frame (T,), smoothed."""
    reach = max(1, round(WINDOW * fps))
    lowest = minimum_filter1d(heights.min(axis=1), 2 * reach + 1, mode="nearest")
    return uniform_filter1d(lowest, reach, mode="nearest")


def over_lowest(low: Floats, fps: float) -> Floats:
    """Return heights (T, F) over the lowest of all within `WINDOW` to either side of each frame: captures drift in height."""
    floor = minimum_filter1d(low.min(axis=1), 2 * round(WINDOW * fps) + 1, mode="nearest")
    return low - floor[:, None]
