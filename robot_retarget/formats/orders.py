"""Orders of joints and bodies: depth first as in an MJCF file, breadth first as Isaac Lab has them."""

import numpy as np

from robot_retarget.base.arrays import Ints
from robot_retarget.robot.model import Robot


def robot_bodies(robot: Robot) -> Ints:
    """(B,) ids of the robot's bodies without the world, depth first; its root stands first."""
    model, root = robot.model, robot.root_body
    return np.flatnonzero(model.body_rootid == model.body_rootid[root]).astype(np.int64)


def body_names(robot: Robot, bodies: Ints) -> tuple[str, ...]:
    """Their names."""
    return tuple(robot.model.body(int(body)).name for body in bodies)


def breadth_first_bodies(robot: Robot) -> Ints:
    """(B,) the same ids level by level, each level in the order of its parents."""
    bodies, ordered = robot_bodies(robot), list[int]()
    level = [int(bodies[0])]
    while level:
        ordered += level
        level = [int(body) for parent in level for body in bodies[1:] if robot.model.body_parentid[body] == parent]
    return np.array(ordered, dtype=np.int64)


def breadth_first_hinges(robot: Robot) -> Ints:
    """(n,) which of the robot's hinges stands where when bodies go breadth first."""
    rank = {int(body): k for k, body in enumerate(breadth_first_bodies(robot))}
    return np.argsort([rank[int(robot.model.jnt_bodyid[j])] for j in robot.joint_ids], kind="stable")
