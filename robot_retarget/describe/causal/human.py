"""The human of a stream, frame by frame."""

import numpy as np

from robot_retarget.arrays import Floats
from robot_retarget.describe.causal.calibration import Calibration
from robot_retarget.describe.causal.contacts import CausalContacts
from robot_retarget.describe.human import Human
from robot_retarget.describe.reading.ground import DRIFT, WINDOW
from robot_retarget.describe.reading.segments import facing
from robot_retarget.dgp.adapt import path_weights

LEAP = 12.0
"""A body that moves faster has been put elsewhere: the path goes on from where it was [m/s]."""
FOLLOWED = 0.5
"""A floor that has drifted is followed at this speed [m/s]."""


class CausalHuman:
    """One performer, as `describe.human.human_of` reads a clip, of the frames so far."""

    def __init__(self, calibration: Calibration):
        self.calibration, match = calibration, calibration.graph.match
        self.contacts, self.leg = CausalContacts(calibration.graph), match.human_leg
        tau = path_weights(match.parents, match.human_bones)
        self.per_tau = np.divide(1.0, tau, out=np.zeros_like(tau), where=tau > 0)
        self.moved = np.zeros(3)
        """What is added to every place: leaps taken back, and the floor's drift [m]."""
        self.leaps = 0
        """How often the body was put elsewhere."""
        self._middle: Floats | None = None
        self._lowest = [0.0, 0.0]
        """Of the body over the floor, in the `WINDOW` before and in this one [m]."""
        self._since = 0.0

    def at(self, positions: Floats, rotations: Floats | None, seconds: float) -> Human:
        """The human of one frame, so long after the one before.

        Args:
            positions: (J, 3) of the joints [m].
            rotations: (J, 4) of the joints, w x y z, or None.
        """
        x = self.calibration.keypoints(positions) + self.moved
        x += self._taken_back(x, seconds)
        x[:, 2] -= self._drift(float(x[:, 2].min()), seconds)
        segments = self.calibration.segments(x, rotations)
        apart = x[:, None] - x[None]
        distance = np.sqrt(np.einsum("uvk,uvk->uv", apart, apart))
        contacts, human = self.contacts.at(x, seconds), self.calibration.graph.human
        return Human(
            x[None],
            segments,
            facing(segments),
            contacts,
            (distance * self.per_tau)[None],
            human.fps,
            human.ankle_height,
        )

    def _taken_back(self, x: Floats, seconds: float) -> Floats:
        """(3,) what puts a body that has leapt back along the floor."""
        middle, back = x.mean(axis=0), np.zeros(3)
        if self._middle is not None:
            way = (middle - self._middle) * [1.0, 1.0, 0.0]
            if np.sqrt(way @ way) > LEAP * max(seconds, 1 / 30):
                back, self.leaps = -way, self.leaps + 1
        self.moved, self._middle = self.moved + back, middle + back
        return back

    def _drift(self, lowest: float, seconds: float) -> float:
        """How far the floor has moved by this frame [m]; within `DRIFT` it is level."""
        self._since += seconds
        self._lowest[1] = min(self._lowest[1], lowest)
        seen = min(self._lowest)
        if self._since > WINDOW:
            self._since, self._lowest = 0.0, [self._lowest[1], lowest]
        if abs(seen) < DRIFT * self.leg:
            return 0.0
        step = float(np.clip(seen, -FOLLOWED * seconds, FOLLOWED * seconds))
        self.moved[2] -= step
        self._lowest = [self._lowest[0] - step, self._lowest[1] - step]
        return step
