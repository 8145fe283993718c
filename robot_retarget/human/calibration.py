"""The constants of one performer: how joints become keypoints over a floor, and axes of segments.

A clip fits them to all its frames, a stream to its calibration frames; both then read frames by the same `Calibration`.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from robot_retarget.base.arrays import Bools, Floats, Ints
from robot_retarget.human.feet import FEET, untwisted
from robot_retarget.human.match import Match
from robot_retarget.human.motion import Motion
from robot_retarget.human.rotations import carrying_joint, matrices_of
from robot_retarget.human.segments import segment_constants, visible_segments


@dataclass(frozen=True, eq=False)
class Calibration:
    """Constants of one performer, matched with one robot."""

    match: Match
    weights: Floats
    """(K, J) shares of the joints in the keypoints."""
    floor: float
    """Height of the floor in the source [m]."""
    segment_names: tuple[str, ...]
    constants: Floats
    """(S, 3, 3) from the measured axes of each segment to its forward, left and up."""
    joints: Ints
    """(S,) joint that turns each segment; empty where the source has no rotations."""

    @cached_property
    def _legs(self) -> tuple[Ints, Ints]:
        """The columns of feet on whole legs among the segments, and of hip, knee and ankle (F, 3) among the keypoints."""
        known = self.match.keypoints
        if self.match.recognition.segments:
            return np.zeros(0, dtype=np.int64), np.zeros((0, 3), dtype=np.int64)
        legs = {name: [f"{name[0]}_{k}" for k in ("hip", "knee", "ankle")] for name in FEET}
        whole = [name for name in FEET if name in self.segment_names and set(legs[name]) <= set(known)]
        columns = [[known.index(k) for k in legs[name]] for name in whole]
        own = [self.segment_names.index(name) for name in whole]
        return np.array(own, dtype=np.int64), np.array(columns, dtype=np.int64)

    def named(self, axes: Floats) -> dict[str, Floats]:
        """Return axes (T, S, 3, 3) by the name of the segment."""
        return {name: axes[:, k] for k, name in enumerate(self.segment_names)}

    def axes(self, x: Floats, rotations: Floats | None) -> Floats:
        """Return the axes (T, S, 3, 3) of every segment.

        Args:
            x: (T, K, 3) keypoints [m].
            rotations: (T, J, 4) of the joints, w x y z, or None.
        """
        if not self.segment_names:
            return np.zeros((len(x), 0, 3, 3))
        if len(self.joints) and rotations is not None:
            measured = matrices_of(rotations.take(self.joints, axis=1))
        else:
            visible = visible_segments(self.match.named(x))
            measured = np.stack([visible[name] for name in self.segment_names], axis=1)
        axes = measured @ self.constants
        feet, legs = self._legs
        if len(feet):
            axes[:, feet] = untwisted(axes.take(feet, axis=1), x.take(legs, axis=1))
        return axes


def calibrate(motion: Motion, match: Match, x: Floats, floor: Floats, contacts: dict[str, Bools]) -> Calibration:
    """Fit the constants of a performer to a motion.

    Args:
        x: (T, K, 3) keypoints over level ground [m].
        floor: (T,) its height in the source [m].
    """
    constants = segment_constants(motion, match, x, floor, contacts)
    turning = () if motion.rotations is None else tuple(carrying_joint(motion, match, name) for name in constants)
    return Calibration(
        match,
        match.weights(len(motion.skeleton)),
        float(np.median(floor)),
        tuple(constants),
        np.array(list(constants.values())).reshape(-1, 3, 3),
        np.array(turning, dtype=np.int64),
    )
