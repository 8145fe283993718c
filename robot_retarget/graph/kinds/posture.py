"""Posture: distances between all keypoints, over the length of the path between them [Mucherino2017].

    δ_uv = τ_B ‖x_u − x_v‖ / τ_A

π falls with the distance: distances describe contacts and near passes best, and directions describe free limbs.
"""

from dataclasses import dataclass

import casadi as ca
import numpy as np

from robot_retarget.base.arrays import Floats, Ints, lengths
from robot_retarget.graph.kind import SHORTEST, FrameEdges, Kind, RetargetContext, Track
from robot_retarget.graph.symbolic_robot import SymbolicRobot
from robot_retarget.graph.weights import Weights
from robot_retarget.human.features import HumanFeatures
from robot_retarget.human.match import path_weights


@dataclass(frozen=True, eq=False, kw_only=True)
class KeypointPairs(FrameEdges):
    """E pairs of keypoints; their scale is the length of the robot's path between them [m]."""

    i: Ints
    j: Ints
    path: Floats
    """(E,) length of the human's path between them [m]."""

    def closeness(self, human: HumanFeatures) -> Floats:
        """Return (T, E) distances of the human over the length of the path between."""
        x = human.positions
        return lengths(x.take(self.i, axis=1) - x.take(self.j, axis=1)) / self.path


@dataclass(frozen=True, eq=False, kw_only=True)
class _Posture(KeypointPairs):
    """Pairs whose π falls with the distance."""

    weights: Weights
    share: float

    def targets(self, human: HumanFeatures) -> tuple[Floats, Floats]:
        """δ [m] and π."""
        close, w = self.closeness(human), self.weights
        near = close / w.reach
        return self.scale * close, self.share * (w.far + w.near * np.exp(-near * near))


class PostureKind(Kind):
    """Every two keypoints that no bone joins."""

    name = "posture"

    def edges(self, context: RetargetContext) -> _Posture:
        """Return the pairs, with δ by the paths of both bodies."""
        match, weights = context.match, context.weights
        i, j = np.triu_indices(len(match.keypoints), 1)
        tau = path_weights(match.parents, match.robot_bones)[i, j]
        bone = (match.parents[j] == i) | (match.parents[i] == j)
        keep = (tau > SHORTEST) & ~bone
        i, j, tau = i[keep], j[keep], tau[keep]
        ends = [(match.keypoints[a], match.keypoints[b]) for a, b in zip(i, j, strict=True)]
        share = len(match.keypoints) / max(len(i), 1)
        pairs = {"i": i, "j": j, "path": match.human_paths[i, j]}
        return _Posture(ends=ends, scale=tau, huber_delta=weights.huber_delta, **pairs, weights=weights, share=share)

    def measure(self, track: Track, body: SymbolicRobot) -> ca.SX:
        """d_uv."""
        return distances(track, body)


def distances(track: Track, body: SymbolicRobot) -> ca.SX:
    """Return d = √(‖x_a − x_b‖² + 10⁻¹²) (E,) between the ends of every edge [m], which is smooth at 0."""
    apart = ca.horzcat(*(body.keypoint(a) - body.keypoint(b) for a, b in track.ends))
    return ca.sqrt(ca.sum1(apart**2).T + 1e-12)
