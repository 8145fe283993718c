"""Path: the pelvis follows the human's path, scaled by the leg: three far landmarks, their linear limit."""

from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from robot_retarget.arrays import Floats
from robot_retarget.describe.kinds.kind import AXES, FRAME, Playback, Role, Scene, coordinates
from robot_retarget.describe.measured import Measured
from robot_retarget.describe.path import Carriage, carriage_of
from robot_retarget.describe.track import Track
from robot_retarget.human.features import HumanFeatures


@dataclass(frozen=True, eq=False)
class _Carried:
    """The pelvis, three edges."""

    ends: list[tuple[str, str]]
    carriage: Carriage
    priority: float

    def asked(self, human: HumanFeatures) -> tuple[Floats, float]:
        """Return the target position [m], and π."""
        return self.carriage.path(human), self.priority


@dataclass(frozen=True)
class Path:
    """The pelvis, or the first keypoint of a body without one."""

    name: str = "path"
    role: Role = Role.COST
    stencil: tuple[int, ...] = FRAME

    def wish(self, scene: Scene) -> Track | None:
        """The scaled path."""
        return coordinates(self, self.edges(scene), scene.human, scene.leg)

    def edges(self, scene: Scene) -> "_Carried":
        """Return the map of places from the human to the robot."""
        keypoint = "pelvis" if "pelvis" in scene.match.keypoints else scene.match.keypoints[0]
        return _Carried([(keypoint, "path")] * len(AXES), carriage_of(scene.human, scene.match), scene.weights.path)

    def played(self, track: Track, stand: Floats, playback: Playback) -> Track:
        """The height alone, no higher than in the stand: balance moves the pelvis over the floor."""
        share, vertical = playback.share, [axis == "z" for axis in track.axes]
        height = share * np.minimum(track.lower, stand) + (1 - share) * stand
        weight = np.where(vertical, playback.height, 0.0)
        return replace(track, lower=height, upper=height, priority=np.broadcast_to(weight, height.shape))

    def stood(self, track: Track, measured: Floats, playback: Playback) -> Track:
        """The pelvis at the height of the standing pose."""
        weight = np.where(
            [a == "pelvis" and axis == "z" for (a, _), axis in zip(track.ends, track.axes, strict=True)],
            playback.upright,
            0.0,
        )
        return replace(track, lower=measured, upper=measured, priority=weight[None])

    def measure(self, track: Track, body: Measured) -> ca.SX:
        """Return the position of the pelvis [m]."""
        return body.keypoint(track.ends[0][0])
