"""Floor: the points of the soles stay above the floor."""

import casadi as ca
import numpy as np

from robot_retarget.graph.kind import Kind, RetargetContext, Role, Track
from robot_retarget.graph.symbolic_robot import SymbolicRobot
from robot_retarget.graph.track import limit


class FloorKind(Kind):
    """The height of every sole point [m], at least 0."""

    name = "floor"
    role = Role.INEQUALITY
    follows_human = False
    raises_root = True

    def targets(self, context: RetargetContext) -> Track | None:
        """Return an edge from every sole point to the floor, its height within [0, ∞); None for a robot with a fixed root."""
        soles = context.match.anatomy.soles if context.robot.root_joints.size else {}
        ends = [(f"{foot} sole point {k}", "floor") for foot, sole in soles.items() for k in range(len(sole))]
        return limit(self, ends, 0.0, np.inf, len(context.human)) if ends else None

    def measure(self, track: Track, body: SymbolicRobot) -> ca.SX:
        """Heights [m]."""
        found = []
        for name, _ in track.ends:
            foot, point = name.split(" sole point ")
            sole = body.match.anatomy.soles[foot]
            found.append(body.point(int(sole.bodies[int(point)]), sole.offsets[int(point)])[2])
        return ca.vertcat(*found)
