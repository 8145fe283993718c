"""Solve frame by frame, each to its end from the prediction of the frames before."""

import numpy as np

from robot_retarget.base.arrays import Floats
from robot_retarget.base.progress import Count
from robot_retarget.graph.describe import RobotGraph
from robot_retarget.robot import Robot
from robot_retarget.robot.kinematics import difference, integrate
from robot_retarget.solver.descent import Box, FrameSolution
from robot_retarget.solver.options import Search
from robot_retarget.solver.problem import targets_of
from robot_retarget.solver.sqp import FrameSolver
from robot_retarget.solver.starts import multistart


def causal_poses(solver: FrameSolver, graph: RobotGraph, search: Search, count: Count) -> list[FrameSolution]:
    """Solve the frames of a graph in order, each within reach of the joints from the frame before.

    Args:
        solver: solves single frames.
        graph: T frames.
        search: starts of the first frame.
        count: receives one step per frame.

    Returns:
        T solved frames.
    """
    all_targets, poses = targets_of(graph.tracks), []
    before = multistart(solver, graph, all_targets, [0], search)[0][0].qpos
    for t in range(len(graph)):
        targets = all_targets.at(t)
        box = solver.reachable(before, targets, 1 / graph.fps) if t else solver.ranges(targets)
        start = predicted(solver.robot, poses, box) if t > 2 else before
        known = solver.neighbours([pose.qpos for pose in poses], all_targets, np.array([t]), 1 / graph.fps)
        around = known and known.at(0)
        pose = solver.solve_frame(start, targets, around=around, box=box)
        if t > 2 and pose.clearance_deficit > 0:  # links may have gone around each other on the wrong side
            again = solver.solve_frame(before, targets, around=around, box=box)
            pose = min(pose, again, key=lambda end: end.cost)
        poses.append(solver.repaired(before, pose, targets))
        before = poses[-1].qpos
        count.advance()
    return poses


def predicted(robot: Robot, poses: list[FrameSolution], box: Box) -> Floats:
    """Predict the next frame from the last three poses, as far as the box allows.

    Each direction continues by the smaller of the last two steps if both have the same sign, else it stays: the
    distance of a pose from its optimum alternates in sign, and extrapolation would amplify it from frame to frame.
    """
    first, before, last = (pose.qpos for pose in poses[-3:])
    earlier, later = difference(robot, first, before), difference(robot, before, last)
    agreed = np.where(earlier * later > 0, np.sign(later) * np.minimum(np.abs(earlier), np.abs(later)), 0.0)
    start = integrate(robot, last, agreed)
    start[robot.qpos_index] = np.clip(start[robot.qpos_index], box.lower, box.upper)
    return start
