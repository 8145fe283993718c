"""The targets of one frame of a stream, edge by edge, in the order of the graph."""

from collections.abc import Callable

import numpy as np

from robot_retarget.arrays import Floats
from robot_retarget.graph.causal.footholds import CausalFootholds
from robot_retarget.graph.describe import RobotGraph
from robot_retarget.graph.footholds import placed_feet
from robot_retarget.graph.kinds.foothold import FootholdKind
from robot_retarget.graph.kinds.kind import CausalKind, InstantTargets, RetargetContext
from robot_retarget.graph.kinds.touch import TouchKind
from robot_retarget.graph.track import Track
from robot_retarget.human.features import HumanFeatures

Targets = tuple[Floats, Floats | float]


class CausalTargets:
    """Targets of a graph, frame by frame. Edges that do not depend on the human keep the targets of the first frame."""

    lower: Floats
    upper: Floats
    priority: Floats
    feet: tuple[str, ...]
    sources: list[tuple[slice, Callable[[HumanFeatures, Floats, float], Targets]]]

    def __init__(self, graph: RobotGraph):
        self.lower = np.concatenate([track.lower[0] for track in graph.costs])
        self.upper = np.concatenate([track.upper[0] for track in graph.costs])
        self.priority = np.concatenate([track.priority[0] for track in graph.costs])
        self.feet = placed_feet(graph.match, graph.robot)
        context = RetargetContext(graph.human, graph.match, graph.robot, graph.weights)
        firsts = np.cumsum([0, *(len(track) for track in graph.costs)])
        self.sources = [
            (slice(int(first), int(first) + len(track)), source)
            for first, track in zip(firsts, graph.costs, strict=False)
            if (source := self._source(track, context, graph)) is not None
        ]

    def at(self, human: HumanFeatures, corners: Floats, seconds: float) -> tuple[Floats, Floats, Floats]:
        """Return lower, upper and π (E,) for the human of a frame, `seconds` after the one before.

        Args:
            corners: (F, 4, 3) positions of the robot's sole corners [m].
        """
        for edges, source in self.sources:
            target, priority = source(human, corners, seconds)
            self.lower[edges] = self.upper[edges] = target
            self.priority[edges] = priority
        return self.lower, self.upper, self.priority

    def _source(
        self, track: Track, context: RetargetContext, graph: RobotGraph
    ) -> Callable[[HumanFeatures, Floats, float], Targets] | None:
        kind = track.kind
        if isinstance(kind, FootholdKind):
            return CausalFootholds(graph, self.feet, kind).at
        edges = kind.edges(context) if isinstance(kind, CausalKind) else None
        if edges is None:
            return None
        if isinstance(kind, TouchKind):
            return _Gently(edges, kind.lead, context.weights.touch).at
        return lambda human, corners, seconds: _first(edges.targets(human))


def _first(targets: Targets) -> Targets:
    target, priority = targets
    return target[0], priority[0] if isinstance(priority, np.ndarray) and priority.ndim > 1 else priority


class _Gently:
    """Targets of touches whose strength changes gradually."""

    def __init__(self, edges: InstantTargets, lead: float, priority: float):
        self.edges, self.lead, self.priority = edges, lead, priority
        self.strength: Floats | float = 0.0

    def at(self, human: HumanFeatures, corners: Floats, seconds: float) -> Targets:
        """Return δ and π."""
        target, strength = _first(self.edges.targets(human))
        reach = seconds / self.lead
        self.strength = np.clip(strength, self.strength - reach, self.strength + reach)
        return target, self.priority * self.strength
