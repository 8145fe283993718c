"""The contact schedule of a stream: heel and toe stand by their speed and height so far, in units of the leg."""

import numpy as np

from robot_retarget.arrays import Floats
from robot_retarget.describe.graph import Graph
from robot_retarget.describe.reading.contacts import StanceRule

PARTS = ("toe", "ankle")
"""The ankle speaks for the heel."""
AVERAGED = 0.06
"""Speeds are averaged over about so long [s]."""


class CausalContacts:
    """As `describe.reading.contacts.contact_schedule`, without what comes after; a change is kept for half of the shortest stance."""

    def __init__(self, graph: Graph, rule: StanceRule | None = None):
        match, x = graph.match, graph.human.positions
        self.rule, self.leg = rule or StanceRule(), match.human_leg
        named = [(side, column, f"{side}_{part}") for column, part in enumerate(PARTS) for side in "lr"]
        self.spots = [(side, column) for side, column, keypoint in named if keypoint in match.keypoints]
        self.points = [match.index(keypoint) for *_, keypoint in named if keypoint in match.keypoints]
        self.feet = tuple(dict.fromkeys(side for side, _ in self.spots))
        low = {part: [match.index(k) for k in match.keypoints if k[2:] == part] for part in PARTS}
        self.floor = np.array([np.quantile(x[:, low[PARTS[column]], 2], 0.02) for _, column in self.spots])
        self.stands = np.zeros(len(self.points), dtype=bool)
        self.speed, self.since = np.full(len(self.points), np.inf), np.full(len(self.points), np.inf)
        self._before: Floats | None = None

    def at(self, x: Floats, seconds: float) -> dict[str, np.ndarray]:
        """Per foot (1, 2) whether toe and heel stand, of keypoints (K, 3) over level ground [m]."""
        points, rule = x[self.points], self.rule
        if self._before is not None:
            speed = np.linalg.norm(points - self._before, axis=1) / (seconds * self.leg)
            known = np.where(np.isfinite(self.speed), self.speed, speed)
            self.speed = known + (1 - np.exp(-2 * seconds / AVERAGED)) * (speed - known)
        height = (points[:, 2] - self.floor) / self.leg
        enter = (self.speed < rule.enter_speed) & (height < rule.enter_height)
        stay = (self.speed < rule.leave_speed) & (height < rule.leave_height)
        wanted = np.where(self.stands, stay, enter)
        self.since += seconds
        changed = (wanted != self.stands) & (self.since >= rule.shortest / 2)
        self.stands, self.since = self.stands ^ changed, np.where(changed, 0.0, self.since)
        self._before = points
        found = {side: np.zeros((1, 2), dtype=bool) for side in self.feet}
        for (side, column), stands in zip(self.spots, self.stands, strict=True):
            found[side][0, column] = stands
        return found
