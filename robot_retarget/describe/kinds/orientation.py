"""Orientation: how pelvis, chest, head, hands and feet are turned, which joint centres cannot tell.

Two markers on each segment, one ahead of it and one above: their directions  R e  are as the human segment's, r.
"""

from dataclasses import dataclass

import casadi as ca
import numpy as np

from robot_retarget.describe.kinds.compass import AXES
from robot_retarget.describe.kinds.kind import Scene
from robot_retarget.describe.measured import Measured
from robot_retarget.describe.track import Track, exact

MARKERS = ("forward", "up")
_COLUMNS = [0, 2]


@dataclass(frozen=True)
class Orientation:
    """Forward and up of segments."""

    name: str = "orientation"

    def wish(self, scene: Scene) -> Track | None:
        """The human's, of segments that both bodies have."""
        segments = tuple(scene.human.segments)
        if not segments:
            return None
        turns = np.stack([scene.human.segments[segment] for segment in segments], axis=1)
        wished = turns[..., _COLUMNS].swapaxes(2, 3).reshape(len(turns), -1)
        w = scene.weights
        weight = [w.foot if segment.endswith("foot") else w.orientation for segment in segments]
        ends = [(segment, marker) for segment in segments for marker in MARKERS for _ in AXES]
        return exact(
            self, ends, wished, np.repeat(weight, len(MARKERS) * len(AXES)), axes=AXES * (len(ends) // len(AXES))
        )

    def measure(self, track: Track, body: Measured) -> ca.SX:
        """R e, x y z of one marker after the other."""
        frames = body.match.anatomy.frames
        found = []
        for segment, marker in track.ends[:: len(AXES)]:
            own, axes = frames[segment]
            found.append(body.axis(own, axes[:, _COLUMNS[MARKERS.index(marker)]]))
        return ca.vertcat(*found)
