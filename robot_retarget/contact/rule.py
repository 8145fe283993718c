"""The rule of contact: a point is on a surface while it is within a thickness of it, and stands there while it is also slow.

Both have an enter and a leave threshold (a Schmitt trigger in speed and height). Lengths and speeds are over the leg of the
body, so that one rule serves bodies of every size.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import exp

import numpy as np
from scipy.ndimage import median_filter, minimum_filter1d, uniform_filter1d

from robot_retarget.base.arrays import Bools, Floats, Ints, intervals, lengths
from robot_retarget.base.keypoints import SIDES
from robot_retarget.contact.record import ContactRecord, standing_on

TOUCHES_FLOOR = 0.6
"""A body touches the floor at least once in twice this time [s]: a jump of 1.2 s would rise 1.8 m."""


@dataclass(frozen=True)
class ContactRule:
    """Thresholds of contact with a surface.

    Measured on the 192 clear ones of 240 frames that a person labelled (tests/contact/test_labels.py): 2 are wrong. Half and
    double of a speed make 4 and 0 (enter) or 14 and 3 (leave), of a height 8 and 2 at most, of any other field 2 or 3.
    """

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

DRAFT = ContactRule(enter_speed=0.6, leave_speed=0.6, enter_height=0.06, leave_height=0.06)
"""Of the soles of a draft, which balance puts flat: a low foot stands that is slower than a swing. With `SOLES` and `JOINTS` the OP3 takes 1.22 and
1.26 instead of 1.01 times the human's time for a turn, and a foot slides by 12 and 14 instead of 1 mm; the verdict allows 10."""


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
    """Detect when a point is on a surface: near it, and slow in some window of `ContactRule.brief` that holds the frame.

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
    """Remove contacts and gaps (T, …) no longer than `ContactRule.shortest`.

    Args:
        stands: (T, …) whether points are in contact.
        fps: frames per second [1/s].
        rule: thresholds.
    """
    width = 2 * int(rule.shortest * fps) + 1
    size = (width, *(1,) * (stands.ndim - 1))
    return median_filter(stands.astype(np.uint8), size, mode="nearest").astype(bool)


def speed_of(points: Floats, fps: float, rule: ContactRule = JOINTS) -> Floats:
    """Return the speed (T, …) of points (T, …, 3), averaged over `ContactRule.averaged`.

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
    """Return the lowest of heights (T, K) within `TOUCHES_FLOOR` to either side of each frame (T,), smoothed."""
    reach = max(1, round(TOUCHES_FLOOR * fps))
    lowest = minimum_filter1d(heights.min(axis=1), 2 * reach + 1, mode="nearest")
    return uniform_filter1d(lowest, reach, mode="nearest")


def over_lowest(low: Floats, fps: float) -> Floats:
    """Return heights (T, F) over the lowest of all within `TOUCHES_FLOOR` to either side of each frame: captures drift in height."""
    floor = minimum_filter1d(low.min(axis=1), 2 * round(TOUCHES_FLOOR * fps) + 1, mode="nearest")
    return low - floor[:, None]


# The contact schedule: when toe and heel of each foot stand, for a clip and for a stream.
#
# A clip is smoothed over time; a stream holds a change for the shortest contact instead. The
# ankle represents the heel.

PARTS = ("toe", "ankle")
"""Keypoints of a foot, in the order of the columns of a schedule."""
DOWN = np.array([-1.0, 1.0])
"""Sign of the slope of a foot's forward whose toe, or heel, points down."""
TILT = 0.5
"""A foot bears on a side that faces the floor by this cosine: 60° at most [-]."""
CAUSAL_AVERAGE = 0.06
"""Time constant of the speed of a stream [s]: shorter than the average of a clip, because it looks back only. A stream
agrees with the clip in 93.6 % of the frames of six clips, with half in 95.0 and with double in 90.9 %."""


def contact_schedule(
    points: Mapping[str, Floats], leg: float, fps: float, given: ContactRecord | None = None
) -> ContactRecord:
    """Detect the contacts of a clip.

    A foot without a toe stands on both.

    Args:
        points: (T, 3) per keypoint, over level ground [m]; toes and ankles are read.
        leg: length of the leg [m].
        fps: frames per second [1/s].
        given: contacts that the source gives; they replace detection.
    """
    if given is not None:
        return settled(given, fps)
    feet = tuple(side for side in SIDES if points.keys() & {f"{side}_{part}" for part in PARTS})
    stands = np.zeros((len(next(iter(points.values()))), len(feet), len(PARTS)), dtype=bool)
    down = np.zeros(stands.shape[:2], dtype=bool)
    for column, part in enumerate(PARTS):
        places = {foot: points[f"{side}_{part}"] / leg for foot, side in enumerate(feet) if f"{side}_{part}" in points}
        floor = JOINTS.floor_height(np.array([*places.values()])[..., 2]) if places else 0.0
        for foot, place in places.items():
            height = place[:, 2] - floor
            stands[:, foot, column] = standing(place, height, fps)
            down[:, foot] |= touching_down(place, height, fps)
    blunt = [foot for foot, side in enumerate(feet) if f"{side}_toe" not in points]
    stands[:, blunt, 0] = stands[:, blunt, 1]
    return ContactRecord(feet, down | stands.any(axis=2), stands)


def settled(contacts: ContactRecord, fps: float) -> ContactRecord:
    """Return contacts without stances and lifts that are too brief to be true; a foot that stands is down."""
    stands = without_flicker(contacts.stands, fps)
    return replace(contacts, down=contacts.down | stands.any(axis=2), stands=stands)


def on_soles(contacts: ContactRecord, segments: Mapping[str, Floats]) -> ContactRecord:
    """Return contacts in which no foot stands that lies on a side or on the instep.

    A toe and a heel stand while the sole faces the floor. A toe also stands while the toes point down, and a heel while the
    heel does.

    Args:
        contacts: of T frames.
        segments: axes of the body, with (T, 3, 3) per foot that is known.
    """
    stands = contacts.stands.copy()
    for k, foot in enumerate(contacts.feet):
        if (axes := segments.get(f"{foot}_foot")) is not None:
            ahead, up = axes[:, 2, :1], axes[:, 2, 2:]
            stands[:, k] &= np.maximum(ahead * DOWN, up) > TILT
    return replace(contacts, stands=stands)


def high_feet(heights: Floats, fps: float) -> Bools:
    """Return (T,) whether all parts of the feet are high over the lowest that they are within `TOUCHES_FLOOR` of each frame.

    On tiptoe the toes stay low.

    Args:
        heights: (T, K) of toes and ankles [leg lengths].
        fps: frames per second [1/s].
    """
    own = heights - JOINTS.floor_height(heights, axis=0)
    return over_lowest(own.min(axis=1, keepdims=True), fps)[:, 0] > JOINTS.high


class CausalContacts:
    """Causal contact detector of a stream."""

    leg: float
    columns: list[int]
    """Of each point, among the feet and `PARTS`."""
    blunt: list[int]
    """Feet without a toe, which stand on both."""
    speed: Floats
    since: Floats

    def __init__(self, keypoints: Sequence[str], leg: float, x: Floats):
        """Start with the floor of calibration frames.

        Args:
            keypoints: K names.
            leg: length of the leg [m].
            x: (T, K, 3) keypoints of the calibration over level ground [m].
        """
        self.leg, keypoints = leg, tuple(keypoints)
        named = [(side, part) for part in PARTS for side in "lr" if f"{side}_{part}" in keypoints]
        self.points: Ints = np.array([keypoints.index(f"{side}_{part}") for side, part in named], dtype=np.int64)
        self.feet: tuple[str, ...] = tuple(dict.fromkeys(side for side, _ in named))
        self.rows: list[int] = [self.feet.index(side) for side, _ in named]
        self.columns = [PARTS.index(part) for _, part in named]
        self.blunt = [k for k, side in enumerate(self.feet) if f"{side}_toe" not in keypoints]
        low = {part: [k for k, name in enumerate(keypoints) if name[2:] == part] for part in PARTS}
        self.floor: Floats = np.array([JOINTS.floor_height(x[:, low[part], 2]) for _, part in named])
        self.stands: Bools = np.zeros(len(self.points), dtype=bool)
        self.speed, self.since = np.full(len(self.points), np.inf), np.full(len(self.points), np.inf)
        self._before: Floats | None = None
        self.frames: int = 0

    def step(self, x: Floats, seconds: float) -> ContactRecord:
        """Detect the contacts of the next frame; a foot is down where a part of it stands.

        Args:
            x: (K, 3) keypoints over level ground [m].
            seconds: since the frame before [s].
        """
        points = x.take(self.points, axis=0)
        self._measure_speed(points, seconds)
        enter, stay = JOINTS.triggers(self.speed, (points[:, 2] - self.floor) / self.leg)
        self.since += seconds
        changed = ((enter | (stay & self.stands)) != self.stands) & (self.since >= JOINTS.shortest)
        if changed.any():
            self.stands = self.stands ^ changed
            self.since[changed] = 0.0
        found = np.zeros((1, len(self.feet), len(PARTS)), dtype=bool)
        found[0, self.rows, self.columns] = self.stands
        found[0, self.blunt, 0] = found[0, self.blunt, 1]
        return standing_on(self.feet, found)

    def _measure_speed(self, points: Floats, seconds: float) -> None:
        """Update the exponential average of the speeds [leg lengths / s]; it begins with the second frame."""
        if self._before is not None:
            speed = lengths(points - self._before) / (seconds * self.leg)
            known, share = self.frames > 1, 1 - exp(-2 * seconds / CAUSAL_AVERAGE)
            self.speed = self.speed + share * (speed - self.speed) if known else speed
        self._before, self.frames = points, self.frames + 1
