"""Compass: directions of bones and of the hip and shoulder lines.

An edge joins a keypoint to a beacon at distance R along an axis; as R grows, the difference of two such distances becomes
the coordinate of the difference vector. With its length d it is the bone's direction  u = (x_a − x_b)/d,  three edges a bone.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import casadi as ca
import numpy as np

from robot_retarget.base.arrays import Floats, Ints, unit
from robot_retarget.graph.kind import AXES, SHORTEST, FrameEdges, Kind, RetargetContext, Track
from robot_retarget.graph.symbolic_robot import SymbolicRobot
from robot_retarget.human.features import HumanFeatures


@dataclass(frozen=True, eq=False, kw_only=True)
class _Lines(FrameEdges):
    """Lines between keypoints, three edges each."""

    one: Ints
    other: Ints
    priority: Floats

    def targets(self, human: HumanFeatures) -> tuple[Floats, Floats]:
        """Return coordinates of unit vectors, and π."""
        x = human.positions
        return unit(x.take(self.one, axis=1) - x.take(self.other, axis=1)).reshape(len(x), -1), self.priority


class CompassKind(Kind):
    """Directions of bones, as the human's."""

    name = "compass"

    def edges(self, context: RetargetContext) -> _Lines | None:
        """Return the lines, with the human's directions."""
        match, lines = context.match, list(self._lines(context))
        if not lines:
            return None
        one, other = np.array([[match.index(a), match.index(b)] for a, b, _ in lines]).T
        ends, priority = [(a, b) for a, b, _ in lines for _ in AXES], np.repeat([line[2] for line in lines], len(AXES))
        return _Lines(ends=ends, axes=AXES * len(lines), one=one, other=other, priority=priority)

    def measure(self, track: Track, body: SymbolicRobot) -> ca.SX:
        """The coordinates of unit vectors, x y z of one line after the other."""
        apart = [body.keypoint(a) - body.keypoint(b) for a, b in track.ends[:: len(AXES)]]
        return ca.vertcat(*(line / ca.sqrt(ca.sumsqr(line) + 1e-12) for line in apart))

    def _lines(self, context: RetargetContext) -> Iterator[tuple[str, str, float]]:
        """Yield two keypoints and the weight of the direction from the second to the first."""
        match, w = context.match, context.weights
        for k, keypoint in enumerate(match.keypoints):
            weight = w.bones.get(keypoint.split("_")[-1], 0.0)
            if match.parents[k] >= 0 and weight and match.robot_bones[k] > SHORTEST:
                yield keypoint, match.keypoints[int(match.parents[k])], weight
        for part, weight in (("hip", w.hips), ("shoulder", w.shoulders)):
            if {f"l_{part}", f"r_{part}"} <= set(match.keypoints) and weight:
                yield f"l_{part}", f"r_{part}", weight
