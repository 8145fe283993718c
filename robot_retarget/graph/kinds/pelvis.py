"""Path: the pelvis follows the human's path, scaled by the leg: three far landmarks, their linear limit."""

from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from robot_retarget.base.arrays import Floats
from robot_retarget.graph.kind import AXES, FrameEdges, Kind, Phase, RetargetContext, Track
from robot_retarget.graph.path import RootScaling, root_scaling_of
from robot_retarget.graph.phase import PlaybackPhase, StandPhase
from robot_retarget.graph.symbolic_robot import SymbolicRobot
from robot_retarget.human.features import HumanFeatures


@dataclass(frozen=True, eq=False, kw_only=True)
class _Carried(FrameEdges):
    """The pelvis, three edges."""

    root_scaling: RootScaling
    priority: float

    def targets(self, human: HumanFeatures) -> tuple[Floats, float]:
        """Where it should be [m], and π."""
        return self.root_scaling.path(human), self.priority


class PathKind(Kind):
    """The pelvis, or the first keypoint of a body without one."""

    name = "path"

    def edges(self, context: RetargetContext) -> _Carried:
        """Return the coordinates of the pelvis, with the scaled path."""
        keypoint = "pelvis" if "pelvis" in context.match.keypoints else context.match.keypoints[0]
        return _Carried(
            ends=[(keypoint, "path")] * len(AXES),
            axes=AXES,
            scale=context.leg,
            root_scaling=root_scaling_of(context.human, context.match),
            priority=context.weights.path,
        )

    def renewed(self, track: Track, measured: Floats | None, phase: Phase) -> Track:
        """Return the height alone: balance moves the pelvis over the floor.

        In a stand it is that of the standing pose, in a playback no higher than in its stands.
        """
        if measured is None or not isinstance(phase, PlaybackPhase):
            return phase.of(track)
        if isinstance(phase, StandPhase):
            height, weight = measured, phase.upright if track.ends[0][0] == "pelvis" else 0.0
        else:
            height = phase.share * np.minimum(track.lower, measured) + (1 - phase.share) * measured
            weight = phase.height
        priority = np.where([axis == "z" for axis in track.axes], weight, 0.0)
        return replace(track, lower=height, upper=height, priority=np.broadcast_to(priority, height.shape))

    def measure(self, track: Track, body: SymbolicRobot) -> ca.SX:
        """Where the pelvis is [m]."""
        return body.keypoint(track.ends[0][0])
