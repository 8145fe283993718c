"""Mass: the centre of mass over a spot of the support polygon; a kind that balance adds to a graph."""

import casadi as ca

from robot_retarget.base.arrays import Floats
from robot_retarget.graph.kind import Kind, Track, exact
from robot_retarget.graph.symbolic_robot import SymbolicRobot

OVER = 3e3
"""π of the centre of mass along the floor, over the squared leg: feet come first, all else after [-]."""


class MassKind(Kind):
    """The centre of mass along the floor."""

    name = "mass"
    follows_human = False

    def track(self, spots: Floats, leg: float, priority: float = OVER) -> Track:
        """Edges to spots (T, 2) on the floor [m].

        Args:
            spots: (T, 2) [m].
            leg: length of the robot's leg [m].
            priority: π over the squared leg [-].
        """
        return exact(self, [("centre of mass", "support")] * 2, spots, priority, leg, axes=("x", "y"))

    def measure(self, track: Track, body: SymbolicRobot) -> ca.SX:
        """Where the centre of mass is along the floor [m]."""
        return body.mass()[:2]
