"""A watch for a cheaper way that a pose cannot slide into: the arm that bends the other way round.

Frame by frame nobody sketches a path ahead. So when poses begin to cost more than they did, a few drawn limbs are tried
on each; after a round the cheapest few of every limb, unlike each other, are followed downhill, and where one ends well
below the pose at hand, that is where the robot should go.
"""

import numpy as np

from robot_retarget.arrays import Floats
from robot_retarget.solve.frame import FrameSolver, Pose
from robot_retarget.solve.starts import ROUGHLY, drawn_limbs, unlike

ROUND = 0.5
"""A watch lasts this long [s]."""
TRIED = 30
"""Draws of each limb in one round."""
WORRY = 1.2
"""A pose is watched when it costs this many times the least so far."""
CHEAPER = 0.8
"""Another way is taken when it costs less than this share of the present one."""
FOLLOWED = 3
"""Draws of each limb that are followed ..."""
ITERATIONS = 6
"""... so far downhill."""


class Lookout:
    """Tries drawn limbs on the poses of a stream."""

    def __init__(self, solver: FrameSolver, fps: float):
        self.solver, self.frames = solver, max(1, round(ROUND * fps))
        robot = solver.robot
        self.limbs = [(robot.qpos_index[list(limb)], t) for limb, t in drawn_limbs(solver).items()]
        self.each = -(-TRIED // self.frames)
        self.least, self.row = float("inf"), 0
        self._begin()

    def _begin(self) -> None:
        """A new round."""
        self.frame, self.tried = 0, [dict[int, float]() for _ in self.limbs]

    def better(self, pose: Pose, wished: tuple[Floats, ...]) -> Pose | None:
        """A way that costs much less than a pose does with the same wishes, if one was found at this frame."""
        self.least = min(self.least, pose.cost)
        if pose.cost <= WORRY * self.least:
            self._begin()
            return None
        self._try(pose, wished)
        if self.frame < self.frames:
            return None
        chosen = [self._with(pose, limb, row) for limb in range(len(self.limbs)) for row in self._cheapest(limb)]
        starts = [self.solver.symmetry.both_sides(pose.qpos, q) for q in chosen]
        self._begin()
        ends = [self.solver.descend(q, wished, iterations=ITERATIONS, tolerance=ROUGHLY) for q in starts]
        found = min(ends, key=lambda end: end.cost, default=pose)
        return found if found.cost < CHEAPER * pose.cost else None

    def _try(self, pose: Pose, wished: tuple[Floats, ...]) -> None:
        """Some draws of every limb."""
        for _ in range(self.each):
            for limb, (_, table) in enumerate(self.limbs):
                row = self.row % len(table)
                self.tried[limb][row] = float(self.solver.problem.cost(self._with(pose, limb, row), *wished)[0][0])
            self.row += 1
        self.frame += 1

    def _cheapest(self, limb: int) -> list[int]:
        """Rows of a limb's draws to follow."""
        rows, costs = np.array([*self.tried[limb]]), np.array([*self.tried[limb].values()])
        return rows[unlike(costs, self.limbs[limb][1][rows], FOLLOWED)].tolist()

    def _with(self, pose: Pose, limb: int, row: int) -> Floats:
        columns, table = self.limbs[limb]
        q = pose.qpos.copy()
        q[columns] = table[row]
        return q
