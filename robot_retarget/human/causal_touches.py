"""Where a performer of a stream touches the bodies around it: the causal version of `touches.surroundings_of`."""

import numpy as np

from robot_retarget.base.arrays import Bools, Floats, lengths, unit
from robot_retarget.contact.touch import CausalBodyTouches
from robot_retarget.human.match import Match
from robot_retarget.human.skeleton import Skeleton
from robot_retarget.human.touches import SLIDES, SMOOTH, Nearness, Surroundings, Touches, TouchProbe
from robot_retarget.scene.scene import Scene


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
        free, share = (began | ~self._contact.held)[:, None], 1 - np.exp(-seconds / SMOOTH)
        self._places = np.where(free, place, self._places + share * slides[:, None] * (place - self._places))
        self._normals = np.where(free, normal, self._normals)
