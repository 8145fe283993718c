"""Posture: distances between all keypoints, over the length of the path between them [Mucherino2017].

    δ_uv = τ_B ‖x_u − x_v‖ / τ_A

π falls with the distance: distances describe contacts and near passes best, and directions describe free limbs.
"""

from dataclasses import dataclass

import casadi as ca
import numpy as np

from robot_retarget.arrays import Floats, Ints
from robot_retarget.graph.kinds.kind import FRAME, SHORTEST, RetargetContext, Role
from robot_retarget.graph.symbolic_robot import SymbolicRobot
from robot_retarget.graph.track import Track, exact
from robot_retarget.graph.weights import Weights
from robot_retarget.human.features import HumanFeatures
from robot_retarget.human.normalisation import path_weights


@dataclass(frozen=True, eq=False)
class _Pairs:
    """E pairs of keypoints."""

    ends: list[tuple[str, str]]
    i: Ints
    j: Ints
    tau: Floats
    """(E,) length of the robot's path between each pair [m]."""
    weights: Weights
    share: float

    def targets(self, human: HumanFeatures) -> tuple[Floats, Floats]:
        """δ [m] and π."""
        close, w = human.closeness[:, self.i, self.j], self.weights
        return self.tau * close, self.share * (w.far + w.near * np.exp(-((close / w.reach) ** 2)))


@dataclass(frozen=True)
class PostureKind:
    """Every two keypoints that no bone joins."""

    name: str = "posture"
    role: Role = Role.COST
    stencil: tuple[int, ...] = FRAME

    def targets(self, context: RetargetContext) -> Track | None:
        """δ by the paths of both bodies."""
        edges = self.edges(context)
        target, priority = edges.targets(context.human)
        return exact(self, edges.ends, target, priority, edges.tau, huber_delta=context.weights.huber_delta)

    def edges(self, context: RetargetContext) -> "_Pairs":
        """The pairs."""
        match = context.match
        i, j = np.triu_indices(len(match.keypoints), 1)
        tau = path_weights(match.parents, match.robot_bones)[i, j]
        bone = (match.parents[j] == i) | (match.parents[i] == j)
        keep = (tau > SHORTEST) & ~bone
        i, j, tau = i[keep], j[keep], tau[keep]
        ends = [(match.keypoints[a], match.keypoints[b]) for a, b in zip(i, j, strict=True)]
        return _Pairs(ends, i, j, tau, context.weights, len(match.keypoints) / max(len(i), 1))

    def measure(self, track: Track, body: SymbolicRobot) -> ca.SX:
        """d_uv."""
        return distances(track, body)


def distances(track: Track, body: SymbolicRobot) -> ca.SX:
    """Return d = √(‖x_a − x_b‖² + 10⁻¹²) (E,) between the ends of every edge [m], which is smooth at 0."""
    apart = ca.horzcat(*(body.keypoint(a) - body.keypoint(b) for a, b in track.ends))
    return ca.sqrt(ca.sum1(apart**2).T + 1e-12)
