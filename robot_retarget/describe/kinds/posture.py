"""Posture: distances between all keypoints, over the length of the path between them [Mucherino2017].

    δ_uv = τ_B ‖x_u − x_v‖ / τ_A

π falls with the distance: contacts and near passes are what distances tell best, limbs in the open follow directions.
"""

from dataclasses import dataclass

import casadi as ca
import numpy as np

from robot_retarget.describe.kinds.kind import Scene
from robot_retarget.describe.measured import Measured
from robot_retarget.describe.track import Track, exact
from robot_retarget.dgp.adapt import path_weights


@dataclass(frozen=True)
class Posture:
    """Every two keypoints that no bone joins."""

    name: str = "posture"

    def wish(self, scene: Scene) -> Track | None:
        """δ by the paths of both bodies."""
        match, w = scene.match, scene.weights
        i, j = np.triu_indices(len(match.keypoints), 1)
        tau = path_weights(match.parents, match.robot_bones)[i, j]
        bone = (match.parents[j] == i) | (match.parents[i] == j)
        keep = (tau > 1e-6) & ~bone
        i, j, tau = i[keep], j[keep], tau[keep]
        close = scene.human.closeness[:, i, j]
        share = len(match.keypoints) / max(len(i), 1)
        priority = share * (w.far + w.near * np.exp(-((close / w.reach) ** 2)))
        ends = [(match.keypoints[a], match.keypoints[b]) for a, b in zip(i, j, strict=True)]
        return exact(self, ends, tau * close, priority, tau, give=w.give)

    def measure(self, track: Track, body: Measured) -> ca.SX:
        """d_uv."""
        return distances(track, body)


def distances(track: Track, body: Measured) -> ca.SX:
    """(E,) between two keypoints each [m]; smooth where they meet."""
    apart = ca.horzcat(*(body.keypoint(a) - body.keypoint(b) for a, b in track.ends))
    return ca.sqrt(ca.sum1(apart**2).T + 1e-12)
