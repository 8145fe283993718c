"""Fixed-lag smoothing: a pose is returned some frames late, moved to the smooth path through the frames after it."""

from collections import deque
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from robot_retarget.base.arrays import Floats
from robot_retarget.graph.track import SECOND_DIFFERENCE
from robot_retarget.robot import Robot
from robot_retarget.robot.kinematics import difference, integrate
from robot_retarget.solver.descent import FrameSolution
from robot_retarget.solver.options import RealTime
from robot_retarget.solver.problem import EdgeTargets
from robot_retarget.solver.quadratic import Proximal
from robot_retarget.solver.smooth import smooth_offsets
from robot_retarget.solver.sqp import FrameSolver
from robot_retarget.solver.stencils import Neighbours

GIVEN = 2
"""Number of returned poses that fix the start of the path: second differences span no more."""


@dataclass(frozen=True, eq=False)
class SolvedFrame:
    """A frame of a stream after the real-time iteration."""

    pose: FrameSolution
    targets: EdgeTargets
    time: float
    seconds: float
    """Time since the frame before [s]."""


class FixedLag:
    """Return poses `lag` frames late."""

    solver: FrameSolver
    lag: int
    robot: Robot
    proximal: float

    def __init__(self, solver: FrameSolver, lag: int, options: RealTime):
        """Set the lag in frames; the solver's tracks define the second differences to be smoothed."""
        self.solver, self.lag, self.robot, self.proximal = solver, lag, solver.robot, options.drawn
        self.waiting: deque[SolvedFrame] = deque()
        self.given: deque[Floats] = deque(maxlen=GIVEN)

    def smoothed(self, newest: SolvedFrame) -> tuple[FrameSolution, float]:
        """Return the oldest waiting pose, smoothed with the newest, and the time of its frame [s].

        Until `lag` frames wait, the first pose is returned repeatedly.
        """
        self.waiting.append(newest)
        first = self.waiting[0]
        if not self.given:
            self.given.append(first.pose.qpos)
        if len(self.waiting) <= self.lag:
            return first.pose, first.time
        self.waiting.popleft()
        pose = self._drawn(first, [solved.pose.qpos for solved in self.waiting])
        self.given.append(pose.qpos)
        return pose, first.time

    def _drawn(self, first: SolvedFrame, after: list[Floats]) -> FrameSolution:
        before = self.given[-1]
        path = [*self.given, first.pose.qpos, *after]
        speed = np.array([difference(self.robot, a, b) for a, b in pairwise(path)])
        smooth = self.solver.problem.limits.differences(first.targets, SECOND_DIFFERENCE)
        weight, known = self.proximal * smooth.inertia, len(self.given)
        offset = smooth_offsets(speed, smooth.weight / weight, known, smooth.bend)[known]
        box = self.solver.reachable(before, first.targets, first.seconds)
        start, columns = integrate(self.robot, first.pose.qpos, offset), self.robot.qpos_index
        start[columns] = np.clip(start[columns], box.lower, box.upper)
        proximal = Proximal(start, np.zeros(len(offset)), weight)
        around = Neighbours({-1 - k: q for k, q in enumerate(reversed(self.given))}, {0: first.targets}, first.seconds)
        pose = self.solver.real_time_step(start, first.targets, proximal, box, 1, around)
        return self.solver.repaired(before, pose, first.targets)
