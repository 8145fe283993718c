"""Own edges, E⁺: distances that a user sets between two points over some frames."""

from dataclasses import dataclass, replace

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from robot_retarget.graph.kind import Kind, Track
from robot_retarget.graph.symbolic_robot import SymbolicRobot

End = str | tuple[str, ArrayLike] | ArrayLike
"""A keypoint, a point (3,) [m] in the frame of a body, or a place (3,) in the world [m]."""


@dataclass(frozen=True, eq=False)
class OwnKind(Kind):
    """Distances between ends that the user names."""

    ends: tuple[tuple[End, End], ...] = ()
    name: str = "own"
    follows_human = False
    by_user = True

    def of(self, edges: np.ndarray) -> "OwnKind":
        """Return some of the edges."""
        return replace(self, ends=tuple(self.ends[k] for k in edges))

    def with_edges(self, other: "OwnKind") -> "OwnKind":
        """Return the edges of both."""
        return replace(self, ends=(*self.ends, *other.ends))

    def measure(self, track: Track, body: SymbolicRobot) -> ca.SX:
        """The distance of each pair of ends [m]."""
        apart = ca.horzcat(*(self._place(a, body) - self._place(b, body) for a, b in self.ends))
        return ca.sqrt(ca.sum1(apart**2).T + 1e-12)

    @staticmethod
    def _place(end: End, body: SymbolicRobot) -> ca.SX:
        if isinstance(end, str):
            return body.keypoint(end)
        if isinstance(end, tuple) and isinstance(end[0], str):
            return body.point(body.robot.model.body(end[0]).id, np.asarray(end[1], dtype=float))
        return ca.SX(np.asarray(end, dtype=float))
