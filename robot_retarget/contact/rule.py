"""The rule of contact: a point is on a surface while it is within a thickness of it, and stands there while it is also slow.

Both have an enter and a leave threshold (a Schmitt trigger in speed and height). Lengths and speeds are over the leg of the
body, so that one rule serves bodies of every size.
"""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import median_filter, minimum_filter1d, uniform_filter1d

from robot_retarget.base.arrays import Bools, Floats, intervals

WINDOW = 0.6
"""A body touches the floor at least once in twice this time, because no jump lasts longer [s]."""


@dataclass(frozen=True)
class ContactRule:
    """Thresholds of contact with a surface."""

    enter_speed: float = 0.3
    leave_speed: float = 0.4
    """[leg lengths / s]"""
    enter_height: float = 0.08
    leave_height: float = 0.10
    """Thickness between a point and the surface [leg lengths]: skin, shoe and errors of a capture."""
    shortest: float = 0.075
    """Contacts and gaps no longer than this are noise [s]."""
    averaged: float = 0.1
    """Time over which speeds are averaged [s]: one tenth, so that the frame rate does not matter."""
    brief: float = 0.067
    """Time in which a short contact is slow [s]: three frames at 30 a second."""
    floor: float = 0.02
    """Quantile of the heights that is the floor: lower ones are outliers [-]."""
    high: float = 0.12
    """A flight has all parts of the feet higher than this [leg lengths] ..."""
    flight: float = 0.15
    """... for longer than this [s]."""

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
            height: (…) above the surface [leg lengths].
        """
        enter = (speed < self.enter_speed) & (height < self.enter_height)
        return enter, (speed < self.leave_speed) & (height < self.leave_height)


JOINTS = ContactRule()
"""Of toe and ankle joints of a captured human, over the lowest heights that they have."""
SOLES = ContactRule(enter_speed=0.1, leave_speed=0.2, enter_height=0.015, leave_height=0.025, averaged=0.0)
"""Of the points of a robot's soles, whose places are exact: 3 and 5 mm high on the OP3, 9 and 15 mm on the G1. A transfer of a walk to the
robot itself keeps every joint within 2e-3 rad; with speeds of 0.3 and 0.4, feet that land are held too early (3e-2 rad)."""


def standing(points: Floats, height: Floats, fps: float, rule: ContactRule = JOINTS) -> Bools:
    """Detect when a point stands, from the whole clip.

    A contact that is too short for the average of the speed stands throughout its time on the surface.

    Args:
        points: (T, 3) [leg lengths].
        height: (T,) above the surface [leg lengths].
        fps: frames per second [1/s].
        rule: thresholds.

    Returns:
        (T,) True while the point stands.
    """
    stands = entered_runs(*rule.triggers(speed_of(points, fps, rule), height))
    found = stands.copy()
    for start, stop in intervals(touching_down(points, height, fps, rule)):
        found[start:stop] |= not stands[start:stop].any()
    return without_flicker(found, fps, rule)


def touching_down(points: Floats, height: Floats, fps: float, rule: ContactRule = JOINTS) -> Bools:
    """Detect when a point is on a surface: near it, and slow in some window of `rule.brief` that holds the frame.

    Arguments and result are those of `standing`, whose frames are fewer: there a foot that lands or leaves is too fast.
    """
    if len(points) < 2:
        return height < rule.enter_height
    step = np.linalg.norm(np.diff(points, axis=0), axis=-1) * fps
    width = min(max(1, round(rule.brief * fps)), len(step))
    slow = np.convolve(step, np.full(width, 1 / width), mode="valid")
    least = np.full(len(points), np.inf)
    for offset in range(width + 1):
        least[offset : offset + len(slow)] = np.minimum(least[offset : offset + len(slow)], slow)
    return entered_runs(*rule.triggers(least, height))


def on_surface(heights: Floats, rule: ContactRule = JOINTS) -> Bools:
    """Return when the lowest of some points is on a surface, at any speed.

    Args:
        heights: (T, P) of points above the surface [leg lengths].
        rule: thresholds.

    Returns:
        (T,) True while it is within the thickness.
    """
    low = heights.min(axis=1)
    return entered_runs(low < rule.enter_height, low < rule.leave_height)


def without_flicker(stands: Bools, fps: float, rule: ContactRule = JOINTS) -> Bools:
    """Remove contacts and gaps (T, …) no longer than `rule.shortest`.

    Args:
        stands: (T, …) whether points are in contact.
        fps: frames per second [1/s].
        rule: thresholds.
    """
    width = 2 * int(rule.shortest * fps) + 1
    size = (width, *(1,) * (stands.ndim - 1))
    return median_filter(stands.astype(np.uint8), size, mode="nearest").astype(bool)


def speed_of(points: Floats, fps: float, rule: ContactRule = JOINTS) -> Floats:
    """Return the speed (T, …) of points (T, …, 3), averaged over `rule.averaged`.

    Args:
        points: (T, …, 3) [leg lengths].
        fps: frames per second [1/s].
        rule: thresholds.
    """
    if len(points) < 2:
        return np.zeros(points.shape[:-1])
    step = np.linalg.norm(np.diff(points, axis=0), axis=-1) * fps
    step = np.concatenate([step[:1], (step[:-1] + step[1:]) / 2, step[-1:]])
    return uniform_filter1d(step, max(1, round(rule.averaged * fps)), axis=0, mode="nearest")


def entered_runs(enter: Bools, stay: Bools) -> Bools:
    """Return the runs (T,) of `stay` that contain a frame of `enter`."""
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
