"""Features of a stream: the causal version of `features.features_of`."""

from math import hypot

import numpy as np

from robot_retarget.base.arrays import Bools, Floats, lengths, unit
from robot_retarget.contact.rule import TOUCHES_FLOOR, CausalContacts, on_soles
from robot_retarget.contact.touch import CausalBodyTouches
from robot_retarget.human.features import DRIFT, HumanFeatures
from robot_retarget.human.match import Match
from robot_retarget.human.skeleton import Skeleton
from robot_retarget.human.touches import SLIDES, SMOOTH_PLACE, Nearness, Surroundings, Touches, TouchProbe
from robot_retarget.scene.scene import Scene

# Where a performer of a stream touches the bodies around it: the causal version of `touches.surroundings_of`.


class CausalSurroundings:
    """The bodies around one performer.

    The place of a touch is where it begins, and follows a part that slides.
    """

    def __init__(self, match: Match, skeleton: Skeleton, scene: Scene):
        """Compile the bodies of a scene, whose poses are those of any frame."""
        self._probe, self._leg = TouchProbe(match, skeleton, scene), match.human_leg
        count = len(self._probe.pairs)
        self._contact = CausalBodyTouches(count, self._leg)
        self._places, self._normals = np.zeros((2, count, 3))

    def step(self, keypoints: Floats, joints: Floats, scene: Scene, seconds: float) -> Surroundings:
        """Return the surroundings of the next frame.

        Args:
            keypoints: (K, 3) in the order of the match [m].
            joints: (J, 3) [m].
            scene: with the poses of this frame.
            seconds: since the frame before [s].
        """
        poses = scene.poses(1)
        near = self._probe.nearness(keypoints[None], joints[None], poses)
        began = self._contact.step(near.away[0], seconds)
        self._settle(near, began, seconds)
        touches = Touches(
            self._probe.pairs,
            self._contact.held[None].copy(),
            near.distance,
            self._places[None].copy(),
            near.offsets,
            unit(self._normals[None]),
        )
        return Surroundings(scene, touches, self._probe.ground(keypoints[None], poses))

    def _settle(self, near: Nearness, began: Bools, seconds: float) -> None:
        """Update places and normals: those of a touch stay where it began, until the part slides."""
        place, normal = near.places[0], near.outward[0]
        slides = lengths(place - self._places) > SLIDES * self._leg
        free, share = (began | ~self._contact.held)[:, None], 1 - np.exp(-seconds / SMOOTH_PLACE)
        self._places = np.where(free, place, self._places + share * slides[:, None] * (place - self._places))
        self._normals = np.where(free, normal, self._normals)


LEAP = 12.0
"""A faster body was moved by the tracker, not by its legs: the leap is removed from its path [m/s]. The fastest
sprinter reached 12.4 m/s."""
DRIFT_SPEED = 0.5
"""Speed at which a drift of the floor is followed [m/s]: half and double find the same contacts in streams of six
clips."""
_NOT = np.zeros(1, dtype=bool)


class CausalFeatures:
    """Features of one performer."""

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
        """Lowest height of the body in the last `TOUCHES_FLOOR` and in the present one [m]."""
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
        return HumanFeatures(
            x[None], axes, contacts, _NOT, _NOT, calibration, known.fps, known.ankle_height, around=free
        )

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
        if self._since > TOUCHES_FLOOR:
            self._since, self._lowest = 0.0, [self._lowest[1], lowest]
        if abs(height) < DRIFT * self.leg:
            return 0.0
        step = min(max(height, -DRIFT_SPEED * seconds), DRIFT_SPEED * seconds)
        self.moved[2] -= step
        self._lowest = [self._lowest[0] - step, self._lowest[1] - step]
        return step
