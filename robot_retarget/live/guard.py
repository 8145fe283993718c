"""Self-collision guard for streams: moves a goal back towards the last one until no two links overlap.

With the last goal q₀, the goal q₁ and a share s of the step per joint, the guard returns

    q₀ + s (q₁ − q₀),    s ∈ {1, ½, ¼, …, 0} per joint.

All shares start at 1. Links that overlap halve the shares of the joints between them, which alone move one against the
other. The guard goes back, not around: a limb whose path leads through another waits until its goal is on its side again.
"""

import numpy as np
from numpy.typing import NDArray

from robot_retarget.base.arrays import Floats, Ints
from robot_retarget.robot import Robot
from robot_retarget.robot.distances import Separation
from robot_retarget.robot.kinematics import carrying
from robot_retarget.solver.options import SolveOptions

OVERLAP = SolveOptions.overlap
"""Largest overlap of two links that is accepted [m]: that of the solver, whose poses pass unchanged."""
LEAST = 0.5**3
"""A share that is halved below it becomes 0 [-]."""


class SelfCollisionGuard:
    """Guards the goals of one robot; the root does not matter."""

    def __init__(self, robot: Robot):
        """Compile the robot's collision model."""
        self.robot: Robot = robot
        self.separation: Separation = Separation(robot, reach=OVERLAP)
        carried = carrying(robot.model)[:, robot.dof_index]
        self.between: NDArray[np.bool_] = carried[:, None] ^ carried[None]
        """(B, B, n) whether a joint moves one body against another."""
        self.changed: int = 0
        """Number of goals that were moved back."""

    def admit(self, last: Floats, goal: Floats) -> Floats:
        """Return the goal, or the nearest configuration found on the way to it that keeps links apart.

        Args:
            last: (nq,) last goal; where links overlap in it already, the overlap may shrink but not grow.
            goal: (nq,) next goal.
        """
        pairs = self._overlapping(goal, OVERLAP)
        if not len(pairs):
            return goal
        self.changed += 1
        allowed = max(OVERLAP, self.separation.depth(last))
        columns = self.robot.qpos_index
        step, share = goal[columns] - last[columns], np.ones(len(columns))
        trial = goal.copy()
        while len(pairs := self._overlapping(trial, allowed)):
            slower = self.between[pairs[:, 0], pairs[:, 1]].any(axis=0) & (share > 0)
            if not slower.any():
                return last.copy()
            share[slower] = np.where(share[slower] > LEAST, share[slower] / 2, 0.0)
            trial[columns] = last[columns] + share * step
        return trial

    def _overlapping(self, qpos: Floats, allowed: float) -> Ints:
        """Return the pairs of bodies (N, 2) that overlap by more than `allowed` [m]."""
        depth, geoms = self.separation.overlaps(qpos)
        return self.separation.bodies[geoms[depth > allowed]]
