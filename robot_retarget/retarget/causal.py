"""Frame by frame, as they come: each from where the last two lead to."""

import numpy as np

from robot_retarget.arrays import Floats
from robot_retarget.retarget.detour import detour
from robot_retarget.retarget.edges import Edges
from robot_retarget.retarget.frame import Box, FrameSolver, Pose
from robot_retarget.retarget.lookout import Lookout
from robot_retarget.retarget.problem import frame_parameters
from robot_retarget.retarget.progress import Count
from robot_retarget.retarget.quadratic import Pull
from robot_retarget.retarget.solution import Status
from robot_retarget.retarget.starts import ways
from robot_retarget.retarget.stepping import Stepping, reckoned_soles
from robot_retarget.robot import Robot
from robot_retarget.robot.kinematics import difference, integrate

TOWARDS = 100.0
"""Weight that carries a robot over to another way [1/rad²]."""
ARRIVED = 0.1
"""It is there when no hinge is further from it [rad] ..."""
PASSED = 0.3
"""... and past a stop on the way there [rad]."""


def causal_pass(solver: FrameSolver, edges: Edges, held: np.ndarray, fps: float, count: Count) -> list[Pose]:
    """Each frame from the ones before; a foot that begins to stand stays where it was led to.

    Where leading on would draw links together, a frame sets out from the one before, where they were apart.
    When a much cheaper way is found (`Lookout`), it is solved along beside the robot, and the robot goes over to it, or
    around to it (`detour`), as fast as its joints may: no jump, and no staying where the first frame happened to begin.
    """
    robot, crossing, poses = solver.robot, _Crossing(solver, fps), []
    stepping = Stepping(held, *reckoned_soles(solver.problem, edges), fps)
    before = ways(solver, (*frame_parameters(edges, 0), *solver.grip.lay_down(held[0])), edges, 0)[0].qpos
    for t in range(len(edges)):
        wished = (*frame_parameters(edges, t), *solver.grip.land(*stepping.at(t, solver.corners(before))))
        neighbours = [before[robot.qpos_index]] if t else []
        box = solver.ranges.around(neighbours, robot.max_speed / fps)
        leads_on = t > 2 and crossing.aim is None
        start = _clear(solver, _onward(robot, poses, box), before, wished) if leads_on else before
        pose = solver.descend(start, wished, pull=crossing.pull(wished), box=box)
        if pose.missing > 0:
            pose = solver.held_back(before, pose, wished)
        poses.append(solver.lifted(pose))
        before = poses[-1].qpos
        crossing.look(poses[-1], wished)
        count.one()
    return poses


class _Crossing:
    """Going over to another way, as long as it takes: its pose of the moment, and a stop on the way there."""

    def __init__(self, solver: FrameSolver, fps: float):
        self.solver, self.lookout = solver, Lookout(solver, fps)
        self.aim: Pose | None = None
        self.via: Floats | None = None

    def pull(self, wished: tuple[Floats, ...]) -> Pull | None:
        """Draws the hinges to the stop or the other way, which is solved along; the root follows from what it should do."""
        if self.aim is None:
            return None
        self.aim, robot = self.solver.descend(self.aim.qpos, wished), self.solver.robot
        weight = np.zeros(robot.model.nv)
        weight[robot.dof_index] = TOWARDS
        return Pull(self.aim.qpos if self.via is None else self.via, np.zeros(robot.model.nv), weight)

    def look(self, pose: Pose, wished: tuple[Floats, ...]) -> None:
        """Set out for a way that was found; see whether the robot is past the stop, or there."""
        if self.aim is None:
            self.aim = self.lookout.better(pose, wished)
            self.via = detour(self.solver, pose.qpos, self.aim.qpos) if self.aim else None
        elif self.via is not None:
            self.via = self.via if self._far(self.via, pose) > PASSED else None
        elif self._far(self.aim.qpos, pose) < ARRIVED:
            self.aim = None

    def _far(self, goal: Floats, pose: Pose) -> float:
        return float(np.abs(goal - pose.qpos)[self.solver.robot.qpos_index].max())


def _clear(solver: FrameSolver, start: Floats, before: Floats, wished: tuple[Floats, ...]) -> Pose | Floats:
    """A start and what is known about it; the pose before, if links have come within half the margin on the way, for they
    may then go around each other on the wrong side.
    """
    here = solver.landscape.around(start, wished)
    if here.missing > solver.options.margin / 2:
        return before
    return Pose(start, Status.OUT_OF_ITERATIONS, here.cost, 0, here, here.missing)


def _onward(robot: Robot, poses: list[Pose], box: Box) -> Floats:
    """Where the last three poses lead to by the next frame, as far as the box allows.

    By the smaller of the last two steps where they agree in their sense, else not at all: what a pose is off its optimum
    goes to and fro, and would grow from frame to frame.
    """
    first, before, last = (pose.qpos for pose in poses[-3:])
    earlier, later = difference(robot, first, before), difference(robot, before, last)
    agreed = np.where(earlier * later > 0, np.sign(later) * np.minimum(np.abs(earlier), np.abs(later)), 0.0)
    start = integrate(robot, last, agreed)
    start[robot.qpos_index] = np.clip(start[robot.qpos_index], box.lower, box.upper)
    return start
