"""Path: the pelvis follows the human's path, scaled by the leg: three far landmarks, their linear limit."""

from dataclasses import dataclass

import casadi as ca

from robot_retarget.describe.kinds.compass import AXES
from robot_retarget.describe.kinds.kind import Scene
from robot_retarget.describe.measured import Measured
from robot_retarget.describe.path import pelvis_path
from robot_retarget.describe.track import Track, exact


@dataclass(frozen=True)
class Path:
    """The pelvis, or the first keypoint of a body without one."""

    name: str = "path"

    def wish(self, scene: Scene) -> Track | None:
        """The scaled path."""
        keypoint = "pelvis" if "pelvis" in scene.match.keypoints else scene.match.keypoints[0]
        ends = [(keypoint, "path")] * len(AXES)
        return exact(self, ends, pelvis_path(scene.human, scene.match), scene.weights.path, scene.leg, axes=AXES)

    def measure(self, track: Track, body: Measured) -> ca.SX:
        """Where the pelvis is [m]."""
        return body.keypoint(track.ends[0][0])
