"""Edges that hold exactly, as tables show them; the solver keeps them as bounds and rows of its quadratic program.

ground      a sole point and the floor         [0, ∞)
separation  two links that may touch           [margin, ∞)
range       a joint and its zero               [lower, upper]
speed       a joint at t − 1 and at t          [−v/fps, v/fps]
"""

from dataclasses import dataclass

import casadi as ca
import numpy as np

from robot_retarget.arrays import Floats
from robot_retarget.describe.kinds.kind import Scene
from robot_retarget.describe.measured import Measured
from robot_retarget.describe.track import Track
from robot_retarget.human.match import Match
from robot_retarget.robot import Robot
from robot_retarget.robot.collidable import allowed


@dataclass(frozen=True)
class Limit:
    """A kind that no human asks for."""

    name: str

    def wish(self, scene: Scene) -> Track | None:
        """Nothing: limits are the robot's own (`limit_tracks`)."""
        return None

    def measure(self, track: Track, body: Measured) -> ca.SX:
        """Limits are bounds and rows of the quadratic program, not terms of its cost."""
        raise NotImplementedError


def limit_tracks(robot: Robot, match: Match, frames: int, fps: float, margin: float = 0.006) -> tuple[Track, ...]:
    """The limits of a robot over some frames.

    Args:
        margin: between links, as a share of the leg (`solve.options.Options.margin`).
    """
    joints = robot.joint_names
    soles = [(f"{foot} sole {k}", "floor") for foot, sole in match.anatomy.soles.items() for k in range(len(sole))]
    links = [tuple(robot.model.body(b).name for b in pair) for pair in sorted(allowed(robot))]
    apart, step = margin * match.robot_leg, robot.max_speed / fps
    given = [
        ("ground", soles if robot.root_joints.size else [], 0.0, np.inf),
        ("separation", links, apart, np.inf),
        ("range", [(name, "zero") for name in joints], robot.lower, robot.upper),
        ("speed", [(name, f"{name} before") for name in joints], -step, step),
    ]
    return tuple(_track(name, ends, lower, upper, frames) for name, ends, lower, upper in given if ends)


def _track(name: str, ends: list, lower: Floats | float, upper: Floats | float, frames: int) -> Track:
    shape = (frames, len(ends))
    least, most = np.broadcast_to(lower, shape), np.broadcast_to(upper, shape)
    return Track(Limit(name), tuple(ends), least, most, np.full(shape, np.inf), np.ones(len(ends)))
