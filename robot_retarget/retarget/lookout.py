"""A watch for a cheaper way that a pose cannot slide into: the arm that bends the other way round.

Frame by frame nobody sketches a path ahead. So a few drawn limbs are tried on every pose; once a round the cheapest is
followed downhill, and where it ends well below the pose at hand, that is where the robot should go.
"""

from robot_retarget.arrays import Floats
from robot_retarget.retarget.frame import FrameSolver, Pose
from robot_retarget.retarget.starts import ROUGHLY, drawn_limbs

ROUND = 0.5
"""A watch lasts this long [s]: so long may a robot be on the wrong way unseen."""
TRIED = 30
"""Draws of each limb in one round."""
CHEAPER = 0.8
"""Another way is taken when it costs less than this share of the present one."""
ITERATIONS = 6
"""Downhill, from the cheapest drawn limb."""


class Lookout:
    """Tries drawn limbs on the poses of a stream."""

    def __init__(self, solver: FrameSolver, fps: float):
        self.solver, self.frames = solver, max(1, round(ROUND * fps))
        robot = solver.robot
        self.limbs = [
            (robot.qpos_index[list(limb)], t) for limb, t in drawn_limbs(solver.problem, solver.options).items()
        ]
        self.each = -(-TRIED // self.frames)
        self.frame, self.best = 0, (float("inf"), 0, 0)

    def better(self, pose: Pose, wished: tuple[Floats, ...]) -> Pose | None:
        """A way that costs much less than a pose does with the same wishes, if one was found at this frame."""
        for _ in range(self.each):
            for limb, (_, table) in enumerate(self.limbs):
                row = self.frame % len(table)
                cost = float(self.solver.problem.cost(self._with(pose, limb, row), *wished)[0][0])
                self.best = min(self.best, (cost, limb, row))
            self.frame += 1
        if self.frame % (self.each * self.frames) or not self.limbs:
            return None
        _, limb, row = self.best
        self.best = (float("inf"), 0, 0)
        found = self.solver.descend(self._with(pose, limb, row), wished, iterations=ITERATIONS, tolerance=ROUGHLY)
        return found if found.cost < CHEAPER * pose.cost else None

    def _with(self, pose: Pose, limb: int, row: int) -> Floats:
        columns, table = self.limbs[limb]
        q = pose.qpos.copy()
        q[columns] = table[row]
        return q
