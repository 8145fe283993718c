"""Features of a stream: the causal version of `features.features_of`."""

from math import hypot

import numpy as np

from robot_retarget.base.arrays import Floats
from robot_retarget.contact.feet import CausalContacts, on_soles
from robot_retarget.contact.rule import WINDOW
from robot_retarget.human.causal_touches import CausalSurroundings
from robot_retarget.human.features import HumanFeatures
from robot_retarget.human.ground import DRIFT
from robot_retarget.scene.scene import Scene

LEAP = 12.0
"""A faster body was moved by the tracker, not by its legs: the leap is removed from its path [m/s]."""
FOLLOWED = 0.5
"""Speed at which a drift of the floor is followed [m/s]."""
_NOT = np.zeros(1, dtype=bool)


class CausalFeatures:
    """Features of one performer."""

    known: HumanFeatures
    around: CausalSurroundings | None
    contacts: CausalContacts
    leg: float

    def __init__(self, known: HumanFeatures, around: CausalSurroundings | None = None):
        """Start with the features of calibration frames, and with the bodies around if there are any."""
        match, x = known.calibration.match, known.positions
        level = x if known.around is None else known.around.levelled(x, match)
        self.known, self.leg = known, match.human_leg
        self.contacts = CausalContacts(match.keypoints, self.leg, level)
        self.around = around
        self.moved: Floats = np.array([0.0, 0.0, -known.calibration.floor])
        """From the source's places to places over level ground: the floor and its drift, and leaps taken back [m]."""
        self.leaps: int = 0
        """Number of leaps taken back."""
        self._middle: tuple[float, float] | None = None
        """The body's place over the floor at the frame before [m]."""
        self._lowest = [0.0, 0.0]
        """Lowest height of the body in the last `WINDOW` and in the present one [m]."""
        self._since = 0.0

    def step(
        self, positions: Floats, rotations: Floats | None, seconds: float, scene: Scene | None = None
    ) -> HumanFeatures:
        """Return the features of the next frame.

        Args:
            positions: (J, 3) of the joints [m].
            rotations: (J, 4) of the joints, w x y z, or None.
            seconds: since the frame before [s].
            scene: the bodies around with their poses of this frame. They keep the performer's place: leaps and a drift of
                the floor are not taken back.
        """
        known, calibration = self.known, self.known.calibration
        x = calibration.weights @ positions + self.moved
        near, level = None, x
        if self.around is None or scene is None:
            self._take_leap_back(x, seconds)
            x[:, 2] -= self._drift(float(x[:, 2].min()), seconds)
        else:
            near = self.around.step(x, positions, scene, seconds)
            level = near.levelled(x[None], calibration.match)[0]
        axes = calibration.axes(x[None], None if rotations is None else rotations[None])
        contacts = on_soles(self.contacts.step(level, seconds), calibration.named(axes))
        free = near and near.without_stances(contacts)
        return HumanFeatures(x[None], axes, contacts, _NOT, _NOT, calibration, known.fps, known.ankle_height, free)

    def _take_leap_back(self, x: Floats, seconds: float) -> None:
        """Shift keypoints (K, 3) along the floor, from this frame on, where a leap of the body begins."""
        ahead, left, _ = (x.sum(axis=0) / len(x)).tolist()
        before = self._middle or (ahead, left)
        if hypot(ahead - before[0], left - before[1]) > LEAP * max(seconds, 1 / 30):
            back = np.array([before[0] - ahead, before[1] - left, 0.0])
            x += back
            self.moved, self.leaps = self.moved + back, self.leaps + 1
            ahead, left = before
        self._middle = ahead, left

    def _drift(self, lowest: float, seconds: float) -> float:
        """Return how far the floor moved in this frame [m]; a drift within `DRIFT` legs counts as level."""
        self._since += seconds
        self._lowest[1] = min(self._lowest[1], lowest)
        height = min(self._lowest)
        if self._since > WINDOW:
            self._since, self._lowest = 0.0, [self._lowest[1], lowest]
        if abs(height) < DRIFT * self.leg:
            return 0.0
        step = min(max(height, -FOLLOWED * seconds), FOLLOWED * seconds)
        self.moved[2] -= step
        self._lowest = [self._lowest[0] - step, self._lowest[1] - step]
        return step
