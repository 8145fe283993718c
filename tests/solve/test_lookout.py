"""Frame by frame: a much cheaper way is found and gone over to, and never by a jump."""

import numpy as np
import pytest

from robot_retarget.describe.edges import Edges, build_edges
from robot_retarget.describe.match import match
from robot_retarget.motion import read_motion
from robot_retarget.robot import load_robot
from robot_retarget.shipped import SAMPLES
from robot_retarget.solve.clip import Smoothing
from robot_retarget.solve.footing import CORNERS
from robot_retarget.solve.frame import FrameSolver, Options
from robot_retarget.solve.lookout import CHEAPER, Lookout
from robot_retarget.solve.problem import build_problem, frame_parameters
from robot_retarget.solve.starts import ways
from robot_retarget.transfer import retarget

FPS = 30.0


@pytest.fixture(scope="module")
def case() -> tuple[FrameSolver, Edges]:
    motion, robot = read_motion(SAMPLES / "wave.bvh").resample(FPS).frames(40, 60), load_robot("op3")
    matched = match(motion, robot)
    edges = build_edges(motion, matched)
    return FrameSolver(build_problem(robot, matched, edges), Options(footholds=False)), edges


def test_an_arm_on_the_wrong_way_is_found_out_within_a_round(case: tuple[FrameSolver, Edges]) -> None:
    solver, edges = case
    free = np.zeros(3 * CORNERS * len(solver.problem.feet))
    wished = (*frame_parameters(edges, 0), free, free)
    found = ways(solver, wished, edges, 0)
    best, worst = found[0], found[-1]
    assert best.cost < CHEAPER * worst.cost
    watch = Lookout(solver, FPS)
    assert watch.better(best, wished) is None  # so it knows what a good pose costs
    better = [pose for _ in range(watch.frames) if (pose := watch.better(worst, wished)) is not None]
    assert len(better) == 1 and better[0].cost < CHEAPER * worst.cost
    assert all(Lookout.better(watch, best, wished) is None for _ in range(watch.frames))


def test_going_over_keeps_to_the_joints_speeds() -> None:
    robot = load_robot("op3")
    motion = read_motion(SAMPLES / "wave.bvh").resample(FPS)
    trajectory = retarget(motion, robot, smoothing=Smoothing(passes=0)).trajectory
    steps = np.abs(np.diff(trajectory.qpos[:, robot.qpos_index], axis=0))
    assert (steps <= robot.max_speed / FPS + 1e-6).all()
