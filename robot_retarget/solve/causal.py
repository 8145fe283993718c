"""Frame by frame, as they come: each from where the last two lead to."""

import numpy as np

from robot_retarget.arrays import Floats
from robot_retarget.describe.edges import Edges
from robot_retarget.robot import Robot
from robot_retarget.robot.kinematics import difference, integrate
from robot_retarget.solve.crossing import Crossing
from robot_retarget.solve.frame import Box, FrameSolver, Pose
from robot_retarget.solve.problem import frame_parameters
from robot_retarget.solve.progress import Count
from robot_retarget.solve.solution import Status
from robot_retarget.solve.starts import lying, ways
from robot_retarget.solve.stepping import Stepping, reckoned_soles

ALIKE = 0.05
"""Of ways that cost so little more [-] a stream begins with the first: a nearly straight arm costs as much bent either way,
and the one that comes from the reference pose has its elbow bent as it will go on."""
CLOSING = 1 / 6
"""Links that leading on draws together by more than this share of their margin may go one way or another."""


def causal_pass(solver: FrameSolver, edges: Edges, held: np.ndarray, fps: float, count: Count) -> list[Pose]:
    """Each frame from the ones before; a foot that begins to stand stays where it was led to.

    Where leading on would draw links together, a frame sets out from the one before, where they were apart, or from both.
    A robot's own motion is sought from where its wishes alone lead as well.
    When a much cheaper way is found, the robot goes over to it (`Crossing`): no jump, and no staying where the first frame
    happened to begin.
    """
    robot, crossing, poses = solver.robot, Crossing(solver, fps), []
    stepping = Stepping(held, *reckoned_soles(solver.problem, edges), fps)
    own = solver.problem.match.itself
    before = ways(solver, lying(solver, edges, held, 0), edges, 0, ALIKE)[0].qpos
    for t in range(len(edges)):
        wished = (*frame_parameters(edges, t), *solver.grip.land(*stepping.at(t, solver.corners(before))))
        box = solver.reachable([before] if t else [], 1 / fps)
        leads_on = t > 2 and crossing.aim is None
        starts = _set_out(solver, _onward(robot, poses, box), before, wished) if leads_on else [before]
        pull = crossing.pull(wished)
        if own:
            starts.append(solver.unhindered.descend(before, wished, pull=pull, box=box, learning=True).qpos)
        ends = [solver.descend(start, wished, pull=pull, box=box, learning=True) for start in starts]
        pose = min(ends, key=lambda end: end.cost)
        if pose.missing > 0:
            pose = solver.held_back(before, pose, wished)
        poses.append(solver.lifted(pose))
        before = poses[-1].qpos
        crossing.look(poses[-1], wished)
        count.one()
    return poses


def _set_out(solver: FrameSolver, onward: Floats, before: Floats, wished: tuple[Floats, ...]) -> list[Pose | Floats]:
    """From where to descend: where leading on has come to, and what is known there; the configuration before, if links have
    come to touch on the way, for they may then go around each other on the wrong side.

    Where they have only come within their margin, from both: as links slide along each other, their nearest places leap,
    and a hair decides in which of two hollows one descent ends.
    """
    here, margin = solver.landscape.around(onward, wished), solver.options.margin
    led = Pose(onward, Status.OUT_OF_ITERATIONS, here.cost, 0, here, here.missing)
    if here.missing > margin:
        return [before]
    return [led, before] if here.missing > CLOSING * margin else [led]


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
