"""The contact schedule: when toe and heel of each foot stand, for a clip and for a stream.

Both use the rule of `rule`. A clip is smoothed over time; a stream holds a change for the shortest contact instead. The
ankle represents the heel.
"""

from collections.abc import Mapping, Sequence
from math import exp

import numpy as np

from robot_retarget.base.arrays import Bools, Floats, Ints, lengths
from robot_retarget.contact.rule import JOINTS, ContactRule, over_lowest, standing, touching_down, without_flicker

PARTS = ("toe", "ankle")
"""Keypoints of a foot, in the order of the columns of a schedule."""
DOWN = np.array([-1.0, 1.0])
"""Sign of the slope of a foot's forward whose toe, or heel, points down."""
TILT = 0.5
"""A foot bears on a side that faces the floor by this cosine: 60° at most [-]."""
CAUSAL_AVERAGE = 0.06
"""Time constant of the speed of a stream [s]: shorter than the average of a clip, because it looks back only."""


def contact_schedule(
    points: Mapping[str, Floats], leg: float, fps: float, given: Bools | None = None, rule: ContactRule = JOINTS
) -> dict[str, Bools]:
    """Detect the contacts of a clip.

    Args:
        points: (T, 3) per keypoint, over level ground [m]; toes and ankles are read.
        leg: length of the leg [m].
        fps: frames per second [1/s].
        given: (T, 4) contacts that the source gives: left heel, left toe, right heel, right toe. They replace detection.
        rule: thresholds.

    Returns:
        Per foot (`l`, `r`) (T, 2): whether the toe stands, and whether the heel stands. A foot without a toe stands on both.
    """
    if given is not None:
        feet = {side: given[:, [2 * k + 1, 2 * k]] for k, side in enumerate("lr") if f"{side}_ankle" in points}
        return {side: without_flicker(own, fps, rule) for side, own in feet.items()}
    found: dict[str, Bools] = {}
    for column, part in enumerate(PARTS):
        sides = [side for side in "lr" if f"{side}_{part}" in points]
        if not sides:
            continue
        places = np.stack([points[f"{side}_{part}"] for side in sides], axis=1) / leg
        height = places[:, :, 2] - rule.floor_height(places[:, :, 2])
        for k, side in enumerate(sides):
            stands = found.setdefault(side, np.zeros((len(places), 2), dtype=bool))
            stands[:, column] = standing(places[:, k], height[:, k], fps, rule)
    for side, stands in found.items():
        if f"{side}_toe" not in points:
            stands[:, 0] = stands[:, 1]
    return found


def in_the_air(
    points: Mapping[str, Floats], leg: float, fps: float, given: Bools | None = None, rule: ContactRule = JOINTS
) -> Bools:
    """Return (T,) whether neither toe nor ankle of any foot is on the ground; arguments as of `contact_schedule`."""
    if given is not None:
        return ~np.asarray(given.any(axis=1))
    down = []
    for part in PARTS:
        places = [points[f"{side}_{part}"] / leg for side in "lr" if f"{side}_{part}" in points]
        floor = rule.floor_height(np.array(places)[..., 2]) if places else 0.0
        down += [touching_down(place, place[:, 2] - floor, fps, rule) for place in places]
    return ~np.any(down, axis=0) if down else np.zeros(len(next(iter(points.values()))), dtype=bool)


def on_soles(contacts: Mapping[str, Bools], segments: Mapping[str, Floats]) -> dict[str, Bools]:
    """Return a schedule without feet that lie on a side or on the instep.

    A toe and a heel stand while the sole faces the floor. A toe also stands while the toes point down, and a heel while the
    heel does.

    Args:
        contacts: per foot (T, 2), whether toe and heel stand.
        segments: axes of the body, with (T, 3, 3) per foot that is known.
    """
    borne = dict(contacts)
    for foot, stands in contacts.items():
        if (axes := segments.get(f"{foot}_foot")) is not None:
            ahead, up = axes[:, 2, :1], axes[:, 2, 2:]
            borne[foot] = stands & (np.maximum(ahead * DOWN, up) > TILT)
    return borne


def high_feet(heights: Floats, fps: float, rule: ContactRule = JOINTS) -> Bools:
    """Return (T,) whether all parts of the feet are high over the lowest that they are within `WINDOW` of each frame.

    On tiptoe the toes stay low.

    Args:
        heights: (T, K) of toes and ankles [leg lengths].
        fps: frames per second [1/s].
        rule: thresholds.
    """
    own = heights - rule.floor_height(heights, axis=0)
    return over_lowest(own.min(axis=1, keepdims=True), fps)[:, 0] > rule.high


class CausalContacts:
    """Causal contact detector of a stream."""

    leg: float
    columns: list[int]
    """Of each point, among the feet and `PARTS`."""
    blunt: list[int]
    """Feet without a toe, which stand on both."""
    speed: Floats
    since: Floats

    def __init__(self, keypoints: Sequence[str], leg: float, x: Floats, rule: ContactRule = JOINTS):
        """Start with the floor of calibration frames.

        Args:
            keypoints: K names.
            leg: length of the leg [m].
            x: (T, K, 3) keypoints of the calibration over level ground [m].
            rule: thresholds.
        """
        self.rule, self.leg, keypoints = rule, leg, tuple(keypoints)
        named = [(side, part) for part in PARTS for side in "lr" if f"{side}_{part}" in keypoints]
        self.points: Ints = np.array([keypoints.index(f"{side}_{part}") for side, part in named], dtype=np.int64)
        self.feet: tuple[str, ...] = tuple(dict.fromkeys(side for side, _ in named))
        self.rows: list[int] = [self.feet.index(side) for side, _ in named]
        self.columns = [PARTS.index(part) for _, part in named]
        self.blunt = [k for k, side in enumerate(self.feet) if f"{side}_toe" not in keypoints]
        low = {part: [k for k, name in enumerate(keypoints) if name[2:] == part] for part in PARTS}
        self.floor: Floats = np.array([rule.floor_height(x[:, low[part], 2]) for _, part in named])
        self.stands: Bools = np.zeros(len(self.points), dtype=bool)
        self.speed, self.since = np.full(len(self.points), np.inf), np.full(len(self.points), np.inf)
        self._before: Floats | None = None
        self.frames: int = 0

    def step(self, x: Floats, seconds: float) -> dict[str, Bools]:
        """Detect the contacts of the next frame.

        Args:
            x: (K, 3) keypoints over level ground [m].
            seconds: since the frame before [s].

        Returns:
            Per foot (1, 2): whether the toe stands, and whether the heel stands.
        """
        points = x.take(self.points, axis=0)
        self._measure_speed(points, seconds)
        enter, stay = self.rule.triggers(self.speed, (points[:, 2] - self.floor) / self.leg)
        self.since += seconds
        changed = ((enter | (stay & self.stands)) != self.stands) & (self.since >= self.rule.shortest)
        if changed.any():
            self.stands = self.stands ^ changed
            self.since[changed] = 0.0
        found = np.zeros((len(self.feet), 1, len(PARTS)), dtype=bool)
        found[self.rows, 0, self.columns] = self.stands
        found[self.blunt, 0, 0] = found[self.blunt, 0, 1]
        return dict(zip(self.feet, found, strict=True))

    def _measure_speed(self, points: Floats, seconds: float) -> None:
        """Update the exponential average of the speeds [leg lengths / s]; it begins with the second frame."""
        if self._before is not None:
            speed = lengths(points - self._before) / (seconds * self.leg)
            known, share = self.frames > 1, 1 - exp(-2 * seconds / CAUSAL_AVERAGE)
            self.speed = self.speed + share * (speed - self.speed) if known else speed
        self._before, self.frames = points, self.frames + 1
