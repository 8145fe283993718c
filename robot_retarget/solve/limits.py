"""Joint bounds of a graph: ranges, and speeds between frames."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from robot_retarget.arrays import Floats
from robot_retarget.graph.role import FRAME, Role
from robot_retarget.graph.track import Track
from robot_retarget.robot import Robot

UNBOUNDED = 1e6
"""Speed of a joint without a speed edge [rad/s]."""


@dataclass(frozen=True, eq=False)
class JointBounds:
    """(n,) each."""

    lower: Floats
    upper: Floats
    """Angles [rad]."""
    speed: Floats
    """Largest speed between frames [rad/s]."""


def joint_bounds(robot: Robot, tracks: Sequence[Track]) -> JointBounds:
    """Return the bounds of each hinge: the intersection of its range and of all its bound edges.

    Args:
        robot: gives the ranges.
        tracks: tracks of all roles; those of other roles are ignored.
    """
    lower, upper = np.array(robot.lower), np.array(robot.upper)
    speed = np.full(len(robot.joint_names), UNBOUNDED)
    for track in tracks:
        if track.role is not Role.BOUND:
            continue
        hinges = [robot.joint_names.index(name) for name, _ in track.ends]
        low, high = track.lower[0], track.upper[0]
        if track.stencil == FRAME:
            lower[hinges], upper[hinges] = np.maximum(lower[hinges], low), np.minimum(upper[hinges], high)
        else:
            speed[hinges] = np.minimum(speed[hinges], np.minimum(-low, high))
    return JointBounds(lower, upper, speed)


def difference_weights(robot: Robot, tracks: Sequence[Track], stencil: tuple[int, ...]) -> tuple[Floats, Floats]:
    """Weights of the temporal costs of a stencil.

    Returns:
        (nv,) their sum of π/scale² per tangent direction, constant over time, and (nv,) 1/scale² of the last of them, the
        weight of a direction against that of a hinge; 1 without such costs.
    """
    weight, inertia = np.zeros(robot.model.nv), np.ones(robot.model.nv)
    for track in tracks:
        if track.role is Role.COST and track.stencil == stencil:
            inertia = 1 / track.scale**2
            weight += track.priority[0] * inertia
    return weight, inertia
