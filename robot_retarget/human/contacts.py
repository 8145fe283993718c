"""The contact schedule: when toe and heel of each foot stand, for a clip and for a stream.

Both use the detector of `stance`. A clip is smoothed over time; a stream holds a change for half of the
shortest stance instead. The ankle represents the heel.
"""

import numpy as np

from robot_retarget.arrays import Bools, Floats
from robot_retarget.human.match import Match
from robot_retarget.human.stance import StanceRule, standing, without_flicker

PARTS = ("toe", "ankle")
"""Keypoints of a foot, in the order of the columns of a schedule."""
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


class CausalContacts:
    """Causal contact detector of a stream."""

    rule: StanceRule
    leg: float
    spots: list[tuple[str, int]]
    points: list[int]
    feet: tuple[str, ...]
    floor: Floats
    stands: Floats
    speed: Floats
    since: Floats

    def __init__(self, match: Match, x: Floats, rule: StanceRule | None = None):
        """Start with the floor of calibration frames.

        Args:
            x: (T, K, 3) keypoints of the calibration over level ground [m].
        """
        self.rule, self.leg = rule or StanceRule(), match.human_leg
        named = [(side, column, f"{side}_{part}") for column, part in enumerate(PARTS) for side in "lr"]
        self.spots = [(side, column) for side, column, keypoint in named if keypoint in match.keypoints]
        self.points = [match.index(keypoint) for *_, keypoint in named if keypoint in match.keypoints]
        self.feet = tuple(dict.fromkeys(side for side, _ in self.spots))
        low = {part: [match.index(k) for k in match.keypoints if k[2:] == part] for part in PARTS}
        self.floor = np.array([self.rule.floor_height(x[:, low[PARTS[column]], 2]) for _, column in self.spots])
        self.stands = np.zeros(len(self.points), dtype=bool)
        self.speed, self.since = np.full(len(self.points), np.inf), np.full(len(self.points), np.inf)
        self._before: Floats | None = None

    def step(self, x: Floats, seconds: float) -> dict[str, Bools]:
        """Detect the contacts of the next frame.

        Args:
            x: (K, 3) keypoints over level ground [m].
            seconds: since the frame before [s].

        Returns:
            Per foot (1, 2): whether the toe stands, and whether the heel stands.
        """
        points = x[self.points]
        self._measure_speed(points, seconds)
        enter, stay = self.rule.triggers(self.speed, (points[:, 2] - self.floor) / self.leg)
        self.since += seconds
        detected = np.where(self.stands, stay, enter)
        changed = (detected != self.stands) & (self.since >= self.rule.shortest / 2)
        self.stands, self.since = self.stands ^ changed, np.where(changed, 0.0, self.since)
        found = {side: np.zeros((1, 2), dtype=bool) for side in self.feet}
        for (side, column), stands in zip(self.spots, self.stands, strict=True):
            found[side][0, column] = stands
        return found

    def _measure_speed(self, points: Floats, seconds: float) -> None:
        """Update the exponential average of the speeds [leg lengths / s]."""
        if self._before is not None:
            speed = np.linalg.norm(points - self._before, axis=1) / (seconds * self.leg)
            known = np.where(np.isfinite(self.speed), self.speed, speed)
            self.speed = known + (1 - np.exp(-2 * seconds / CAUSAL_AVERAGE)) * (speed - known)
        self._before = points
