"""Path: the pelvis follows the human's path, scaled by the leg: three far landmarks, their linear limit."""

from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from robot_retarget.arrays import Floats
from robot_retarget.graph.kinds.kind import AXES, FRAME, PlaybackTargets, RetargetContext, Role, coordinates
from robot_retarget.graph.path import RootScaling, root_scaling_of
from robot_retarget.graph.symbolic_robot import SymbolicRobot
from robot_retarget.graph.track import Track
from robot_retarget.human.features import HumanFeatures


@dataclass(frozen=True, eq=False)
class _Carried:
    """The pelvis, three edges."""

    ends: list[tuple[str, str]]
    root_scaling: RootScaling
    priority: float

    def targets(self, human: HumanFeatures) -> tuple[Floats, float]:
        """Where it should be [m], and π."""
        return self.root_scaling.path(human), self.priority


@dataclass(frozen=True)
class PathKind:
    """The pelvis, or the first keypoint of a body without one."""

    name: str = "path"
    role: Role = Role.COST
    stencil: tuple[int, ...] = FRAME

    def targets(self, context: RetargetContext) -> Track | None:
        """The scaled path."""
        return coordinates(self, self.edges(context), context.human, context.leg)

    def edges(self, context: RetargetContext) -> "_Carried":
        """How places are carried over."""
        keypoint = "pelvis" if "pelvis" in context.match.keypoints else context.match.keypoints[0]
        return _Carried(
            [(keypoint, "path")] * len(AXES), root_scaling_of(context.human, context.match), context.weights.path
        )

    def played(self, track: Track, stand: Floats, playback: PlaybackTargets) -> Track:
        """The height alone, no higher than in the stand: balance moves the pelvis over the floor."""
        share, vertical = playback.share, [axis == "z" for axis in track.axes]
        height = share * np.minimum(track.lower, stand) + (1 - share) * stand
        weight = np.where(vertical, playback.height, 0.0)
        return replace(track, lower=height, upper=height, priority=np.broadcast_to(weight, height.shape))

    def stood(self, track: Track, measured: Floats, playback: PlaybackTargets) -> Track:
        """The pelvis at the height of the standing pose."""
        weight = np.where(
            [a == "pelvis" and axis == "z" for (a, _), axis in zip(track.ends, track.axes, strict=True)],
            playback.upright,
            0.0,
        )
        return replace(track, lower=measured, upper=measured, priority=weight[None])

    def measure(self, track: Track, body: SymbolicRobot) -> ca.SX:
        """Where the pelvis is [m]."""
        return body.keypoint(track.ends[0][0])
