"""Path: the pelvis follows the human's path, scaled by the leg: three far landmarks, their linear limit."""

from dataclasses import dataclass

import casadi as ca

from robot_retarget.arrays import Floats
from robot_retarget.describe.human import Human
from robot_retarget.describe.kinds.compass import AXES
from robot_retarget.describe.kinds.kind import Scene
from robot_retarget.describe.measured import Measured
from robot_retarget.describe.path import Carriage, carriage_of
from robot_retarget.describe.track import Track, exact


@dataclass(frozen=True, eq=False)
class _Carried:
    """The pelvis, three edges."""

    carriage: Carriage
    priority: float

    def asked(self, human: Human) -> tuple[Floats, float]:
        """Where it should be [m], and π."""
        return self.carriage.path(human), self.priority


@dataclass(frozen=True)
class Path:
    """The pelvis, or the first keypoint of a body without one."""

    name: str = "path"

    def wish(self, scene: Scene) -> Track | None:
        """The scaled path."""
        edges, keypoint = self.edges(scene), "pelvis" if "pelvis" in scene.match.keypoints else scene.match.keypoints[0]
        wished, priority = edges.asked(scene.human)
        return exact(self, [(keypoint, "path")] * len(AXES), wished, priority, scene.leg, axes=AXES)

    def edges(self, scene: Scene) -> "_Carried":
        """How places are carried over."""
        return _Carried(carriage_of(scene.human, scene.match), scene.weights.path)

    def measure(self, track: Track, body: Measured) -> ca.SX:
        """Where the pelvis is [m]."""
        return body.keypoint(track.ends[0][0])
