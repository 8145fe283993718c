"""Points of a robot as a CasADi function, for tests of kinematics and of machine code."""

import casadi as ca

from robot_retarget.robot import Points, Robot
from robot_retarget.robot.kinematics import Bodies, carrying


def point_function(robot: Robot, points: Points) -> ca.Function:
    """q ↦ positions (3P) and their Jacobian by v (3P, nv), of the expressions that kinds of edges use."""
    bodies = Bodies(robot)
    x = bodies.places(points)
    return bodies.function("points", [ca.vec(x), bodies.travel(x, carrying(robot.model)[points.bodies])])
