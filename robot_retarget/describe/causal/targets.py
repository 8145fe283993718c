"""The targets of one frame of a stream, edge by edge, in the order of the graph."""

from collections.abc import Callable

import numpy as np

from robot_retarget.arrays import Floats
from robot_retarget.describe.causal.footholds import CausalFootholds
from robot_retarget.describe.footholds import placed_feet
from robot_retarget.describe.graph import Graph
from robot_retarget.describe.kinds.foothold import Foothold
from robot_retarget.describe.kinds.kind import CausalKind, InstantTargets, RetargetContext
from robot_retarget.describe.kinds.touch import Touch
from robot_retarget.describe.track import Track
from robot_retarget.human.features import HumanFeatures

Asked = tuple[Floats, Floats | float]


class CausalTargets:
    """The edges of a graph, asked frame by frame; those that no human asks for stay as they are in its first frame."""

    def __init__(self, graph: Graph):
        self.lower = np.concatenate([track.lower[0] for track in graph.costs])
        self.upper = np.concatenate([track.upper[0] for track in graph.costs])
        self.priority = np.concatenate([track.priority[0] for track in graph.costs])
        self.feet = placed_feet(graph.match, graph.robot)
        context = RetargetContext(graph.human, graph.match, graph.robot, graph.weights)
        firsts = np.cumsum([0, *(len(track) for track in graph.costs)])
        self.askers = [
            (slice(int(first), int(first) + len(track)), asker)
            for first, track in zip(firsts, graph.costs, strict=False)
            if (asker := self._asker(track, context, graph)) is not None
        ]

    def at(self, human: HumanFeatures, corners: Floats, seconds: float) -> tuple[Floats, Floats, Floats]:
        """Return lower, upper and π (E,) for the human of a frame, `seconds` after the one before.

        Args:
            corners: (F, 4, 3) positions of the robot's sole corners [m].
        """
        for edges, asker in self.askers:
            wished, priority = asker(human, corners, seconds)
            self.lower[edges] = self.upper[edges] = wished
            self.priority[edges] = priority
        return self.lower, self.upper, self.priority

    def _asker(
        self, track: Track, context: RetargetContext, graph: Graph
    ) -> Callable[[HumanFeatures, Floats, float], Asked] | None:
        kind = track.kind
        if isinstance(kind, Foothold):
            return CausalFootholds(graph, self.feet, kind).at
        edges = kind.edges(context) if isinstance(kind, CausalKind) else None
        if edges is None:
            return None
        if isinstance(kind, Touch):
            return _Gently(edges, kind.lead, context.weights.touch).at
        return lambda human, corners, seconds: _first(edges.asked(human))


def _first(asked: Asked) -> Asked:
    wished, priority = asked
    return wished[0], priority[0] if isinstance(priority, np.ndarray) and priority.ndim > 1 else priority


class _Gently:
    """Targets of touches whose strength changes gradually."""

    def __init__(self, edges: InstantTargets, lead: float, priority: float):
        self.edges, self.lead, self.priority = edges, lead, priority
        self.strength: Floats | float = 0.0

    def at(self, human: HumanFeatures, corners: Floats, seconds: float) -> Asked:
        """Return δ and π."""
        wished, strength = _first(self.edges.asked(human))
        reach = seconds / self.lead
        self.strength = np.clip(strength, self.strength - reach, self.strength + reach)
        return wished, self.priority * self.strength
