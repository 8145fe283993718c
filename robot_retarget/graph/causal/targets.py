"""The targets of one frame of a stream, edge by edge, in the order of the solver."""

from typing import Any

import numpy as np

from robot_retarget.base.arrays import Floats
from robot_retarget.graph.context import RetargetContext, StreamFrame
from robot_retarget.graph.describe import RobotGraph
from robot_retarget.graph.kind import Kind
from robot_retarget.graph.placed_scene import PlacedScene
from robot_retarget.graph.track import columns_of, ordered
from robot_retarget.human.features import HumanFeatures


class CausalTargets:
    """Targets of a graph, frame by frame. Edges that do not follow the human keep the targets of the first frame."""

    lower: Floats
    upper: Floats
    priority: Floats
    scene: PlacedScene | None
    """The bodies around the robot at the latest frame."""

    def __init__(self, graph: RobotGraph):
        tracks = ordered(graph.tracks)
        sides = zip(*((*track.intervals, track.priority) for track in tracks), strict=True)
        self.lower, self.upper, self.priority = (np.concatenate([each[0] for each in side]) for side in sides)
        self.context = RetargetContext(graph.human, graph.match, graph.robot, graph.weights)
        self.scene = self.context.scene
        columns = columns_of(tracks)
        self.following: list[tuple[Kind, slice, dict[str, Any]]] = [
            (t.kind, columns[t.name], {}) for t in tracks if t.kind.follows_human
        ]

    def at(self, human: HumanFeatures, corners: Floats, seconds: float) -> tuple[Floats, Floats, Floats]:
        """Return lower, upper and π (E,) for the human of a frame, `seconds` after the one before.

        Args:
            corners: (F, 4, 3) positions of the robot's sole corners [m].
        """
        own = self.context
        frame = StreamFrame(human, own.match, own.robot, own.weights, own, corners, seconds)
        self.scene = frame.scene
        for kind, edges, memory in self.following:
            found = kind.step(frame, memory)
            if found is not None:
                self.lower[edges], self.upper[edges], self.priority[edges] = found
        return self.lower, self.upper, self.priority
