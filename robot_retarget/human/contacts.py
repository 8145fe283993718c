"""The contact schedule: when toe and heel of each foot stand, for a clip and for a stream.

Both use the detector of `stance`. A clip is smoothed over time; a stream holds a change for the
shortest stance instead. The ankle represents the heel.
"""

from math import exp

import numpy as np

from robot_retarget.base.arrays import Bools, Floats, Ints, lengths
from robot_retarget.human.match import Match
from robot_retarget.human.stance import StanceRule, standing, without_flicker

DOWN = np.array([-1.0, 1.0])
"""Sign of the slope of a foot's forward whose toe, or heel, points down."""
PARTS = ("toe", "ankle")
"""Keypoints of a foot, in the order of the columns of a schedule."""
TILT = 0.5
"""A foot bears on a side that faces the floor by this cosine: 60° at most [-]."""
CAUSAL_AVERAGE = 0.06
"""Time constant of the speed of a stream [s]: shorter than the average of a clip, because it looks back only."""


def contact_schedule(
    x: Floats, match: Match, fps: float, contacts: Bools | None = None, rule: StanceRule | None = None
) -> dict[str, Bools]:
    """Detect the contacts of a clip.

    Args:
        x: (T, K, 3) keypoints over level ground [m].
        contacts: (T, 4) contacts that the source gives: left heel, left toe, right heel, right toe. They replace detection.

    Returns:
        Per foot (`l`, `r`) (T, 2): whether the toe stands, and whether the heel stands.
    """
    chosen = rule or StanceRule()
    if contacts is not None:
        feet = {s: contacts[:, [2 * k + 1, 2 * k]] for k, s in enumerate("lr") if f"{s}_ankle" in match.keypoints}
        return {side: without_flicker(given, fps, chosen) for side, given in feet.items()}
    found: dict[str, Bools] = {}
    for column, part in enumerate(PARTS):
        present = [f"{s}_{part}" for s in "lr" if f"{s}_{part}" in match.keypoints]
        if not present:
            continue
        points = x[:, [match.index(k) for k in present]] / match.human_leg
        height = points[:, :, 2] - chosen.floor_height(points[:, :, 2])
        for k, keypoint in enumerate(present):
            stands = found.setdefault(keypoint[0], np.zeros((len(x), 2), dtype=bool))
            stands[:, column] = standing(points[:, k], height[:, k], fps, chosen)
    return found


def on_soles(contacts: dict[str, Bools], segments: dict[str, Floats]) -> dict[str, Bools]:
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


class CausalContacts:
    """Causal contact detector of a stream."""

    rule: StanceRule
    leg: float
    columns: list[int]
    """Of each point, among the feet and `PARTS`."""
    speed: Floats
    since: Floats

    def __init__(self, match: Match, x: Floats, rule: StanceRule | None = None):
        """Start with the floor of calibration frames.

        Args:
            x: (T, K, 3) keypoints of the calibration over level ground [m].
        """
        self.rule, self.leg = rule or StanceRule(), match.human_leg
        named = [(side, part) for part in PARTS for side in "lr" if f"{side}_{part}" in match.keypoints]
        self.points: Ints = np.array([match.index(f"{side}_{part}") for side, part in named], dtype=np.int64)
        self.feet: tuple[str, ...] = tuple(dict.fromkeys(side for side, _ in named))
        self.rows: list[int] = [self.feet.index(side) for side, _ in named]
        self.columns = [PARTS.index(part) for _, part in named]
        low = {part: [match.index(k) for k in match.keypoints if k[2:] == part] for part in PARTS}
        self.floor: Floats = np.array([self.rule.floor_height(x[:, low[part], 2]) for _, part in named])
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
        return dict(zip(self.feet, found, strict=True))

    def _measure_speed(self, points: Floats, seconds: float) -> None:
        """Update the exponential average of the speeds [leg lengths / s]; it begins with the second frame."""
        if self._before is not None:
            speed = lengths(points - self._before) / (seconds * self.leg)
            known, share = self.frames > 1, 1 - exp(-2 * seconds / CAUSAL_AVERAGE)
            self.speed = self.speed + share * (speed - self.speed) if known else speed
        self._before, self.frames = points, self.frames + 1
