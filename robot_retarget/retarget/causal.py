"""Frame by frame, as they come: each from where the last two lead to."""

import numpy as np

from robot_retarget.arrays import Floats
from robot_retarget.retarget.edges import Edges
from robot_retarget.retarget.footing import Stepping
from robot_retarget.retarget.frame import Box, FrameSolver, Pose
from robot_retarget.retarget.problem import frame_parameters
from robot_retarget.retarget.progress import Count
from robot_retarget.retarget.starts import ways
from robot_retarget.robot import Robot
from robot_retarget.robot.kinematics import difference, integrate


def causal_pass(solver: FrameSolver, edges: Edges, held: np.ndarray, fps: float, count: Count) -> list[Pose]:
    """Each frame from the ones before; a foot that begins to stand stays where it was."""
    robot, stepping, poses = solver.robot, Stepping(held), []
    before = ways(solver, (*frame_parameters(edges, 0), *solver.grip.lay_down(held[0])), edges, 0)[0].qpos
    for t in range(len(edges)):
        holds = solver.grip.hold(*stepping.at(t, solver.corners(before)))
        neighbours = [before[robot.qpos_index]] if t else []
        box = solver.ranges.around(neighbours, robot.max_speed / fps)
        start = _onward(robot, poses, box) if t > 1 else before
        poses.append(solver.lifted(solver.descend(start, (*frame_parameters(edges, t), *holds), box=box)))
        before = poses[-1].qpos
        count.one()
    return poses


def _onward(robot: Robot, poses: list[Pose], box: Box) -> Floats:
    """Where the last two poses lead to by the next frame, as far as the box allows."""
    before, last = poses[-2].qpos, poses[-1].qpos
    start = integrate(robot, last, difference(robot, before, last))
    start[robot.qpos_index] = np.clip(start[robot.qpos_index], box.lower, box.upper)
    return start
