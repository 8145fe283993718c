"""Orientation: rotations of pelvis, chest, head, hands and feet, which joint centres do not determine.

Each segment has two markers, one ahead of it and one above: their directions  R e  equal the human segment's, r.
"""

from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from robot_retarget.base.arrays import Floats
from robot_retarget.graph.kind import AXES, FrameEdges, Kind, Phase, RetargetContext, Track
from robot_retarget.graph.phase import StandPhase
from robot_retarget.graph.symbolic_robot import SymbolicRobot
from robot_retarget.human.features import HumanFeatures

MARKERS = ("forward", "up")
_COLUMNS = slice(0, 3, 2)


@dataclass(frozen=True, eq=False, kw_only=True)
class _Markers(FrameEdges):
    """The markers of segments, three edges each."""

    priority: Floats

    def targets(self, human: HumanFeatures) -> tuple[Floats, Floats]:
        """Return coordinates of unit vectors, and π."""
        return human.axes[..., _COLUMNS].swapaxes(2, 3).reshape(len(human), -1), self.priority


class OrientationKind(Kind):
    """Forward and up of segments."""

    name = "orientation"

    def edges(self, context: RetargetContext) -> _Markers | None:
        """Return the markers of segments that both bodies have, with the human's directions."""
        segments, w = tuple(context.human.segments), context.weights
        if not segments:
            return None
        weight = [w.foot if segment.endswith("foot") else w.orientation for segment in segments]
        ends = [(segment, marker) for segment in segments for marker in MARKERS for _ in AXES]
        axes, priority = AXES * (len(MARKERS) * len(segments)), np.repeat(weight, len(MARKERS) * len(AXES))
        return _Markers(ends=ends, axes=axes, priority=priority)

    def renewed(self, track: Track, measured: Floats | None, phase: Phase) -> Track:
        """Return in a stand the rotation of the pelvis in the standing pose."""
        if measured is None or not isinstance(phase, StandPhase):
            return phase.of(track)
        weight = np.where([a == "pelvis" for a, _ in track.ends], phase.upright, 0.0)
        return replace(track, lower=measured, upper=measured, priority=weight[None])

    def measure(self, track: Track, body: SymbolicRobot) -> ca.SX:
        """R e, x y z of one marker after the other."""
        frames = body.match.anatomy.frames
        found = []
        for segment, marker in track.ends[:: len(AXES)]:
            own, axes = frames[segment]
            found.append(body.axis(own, axes[:, _COLUMNS][:, MARKERS.index(marker)]))
        return ca.vertcat(*found)
