"""Going over to a much cheaper way that was found, as fast as the joints may, around what stands between.

The other way is solved along beside the robot, and draws it; where links stand between, a stop does first.
"""

import numpy as np

from robot_retarget.arrays import Floats
from robot_retarget.solve.detour import detour
from robot_retarget.solve.frame import FrameSolver, Pose
from robot_retarget.solve.lookout import Lookout
from robot_retarget.solve.quadratic import Pull

TOWARDS = 100.0
"""Weight that carries a robot over to another way [1/rad²]."""
ARRIVED = 0.1
"""It is there when no hinge is further from it [rad] ..."""
PASSED = 0.3
"""... and past a stop on the way there [rad]."""
PATIENCE = 2.0
"""It gives up a way that it has not come to by then [s]."""


class Crossing:
    """What a stream goes over to while it does: the other way's pose of the moment, and a stop on the way there."""

    def __init__(self, solver: FrameSolver, fps: float):
        self.solver, self.lookout = solver, Lookout(solver, fps)
        self.aim: Pose | None = None
        self.via: Floats | None = None
        self.patience = round(PATIENCE * fps)
        self.left = 0
        """Frames in which it is still to get there."""

    def pull(self, wished: tuple[Floats, ...]) -> Pull | None:
        """Draws the hinges to the stop or the other way, which is solved along; the root follows from what it should do."""
        if self.aim is None:
            return None
        self.aim, robot = self.solver.descend(self.aim.qpos, wished, learning=True), self.solver.robot
        weight = np.zeros(robot.model.nv)
        weight[robot.dof_index] = TOWARDS
        return Pull(self.aim.qpos if self.via is None else self.via, np.zeros(robot.model.nv), weight)

    def look(self, pose: Pose, wished: tuple[Floats, ...]) -> None:
        """Set out for a way that was found; see whether the robot is past the stop, or there, or will not get there."""
        if self.aim is None:
            self.aim, self.left = self.lookout.better(pose, wished), self.patience
            self.via = detour(self.solver, pose.qpos, self.aim.qpos) if self.aim else None
            return
        self.left -= 1
        if self.via is not None and self._far(self.via, pose) <= PASSED:
            self.via = None
        elif self.left <= 0 or (self.via is None and self._far(self.aim.qpos, pose) < ARRIVED):
            self.aim = self.via = None

    def _far(self, goal: Floats, pose: Pose) -> float:
        return float(np.abs(goal - pose.qpos)[self.solver.robot.qpos_index].max())
