"""The sketch: the cheapest path through the ways is the cheapest of all, and it finds a raised arm."""

import itertools
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from robot_retarget.motion import read_motion
from robot_retarget.retarget.clip import Smoothing
from robot_retarget.retarget.edges import build_edges
from robot_retarget.retarget.footing import held_corners
from robot_retarget.retarget.frame import FrameSolver, Options, Pose
from robot_retarget.retarget.match import match
from robot_retarget.retarget.problem import build_problem
from robot_retarget.retarget.sketch import Sketching, _Pool
from robot_retarget.retarget.solution import Status
from robot_retarget.retarget.transfer import retarget
from robot_retarget.robot import load_robot, world_points
from robot_retarget.robot.kinematics import difference
from robot_retarget.shipped import SAMPLES


@pytest.mark.parametrize("seed", range(5))
def test_the_chosen_path_is_the_cheapest_of_all(seed: int) -> None:
    robot, draw = load_robot("op3"), np.random.default_rng(seed)
    solver, none = cast(Any, SimpleNamespace(robot=robot)), cast(Any, None)
    pool = _Pool(solver, none, np.zeros(0), np.arange(5), 10.0, Sketching())
    for moment in range(5):
        for _ in range(1 + moment % 3):
            pose = robot.standing()
            pose[robot.qpos_index] += draw.normal(size=20)
            pool.poses[moment].append(Pose(pose, Status.CONVERGED, float(draw.uniform(0, 20)), 1))

    def total(path: tuple[Pose, ...]) -> float:
        steps = [float((difference(robot, a.qpos, b.qpos) ** 2).sum()) for a, b in itertools.pairwise(path)]
        return sum(p.cost for p in path) + pool.sketching.change * sum(steps)

    assert total(tuple(pool.cheapest())) == pytest.approx(min(total(p) for p in itertools.product(*pool.poses)))


def hand_over_shoulder(smoothing: Smoothing | None) -> np.ndarray:
    """(T,) how high the waving hand is over its shoulder [m], where the human's is."""
    robot = load_robot("op3")
    result = retarget(read_motion(SAMPLES / "wave.bvh").resample(15), robot, smoothing=smoothing)
    x = world_points(robot, result.match.points, result.trajectory.qpos)
    human = result.match.human_positions(result.motion)
    hand, shoulder = result.match.index("r_hand"), result.match.index("r_shoulder")
    raised = human[:, hand, 2] > human[:, shoulder, 2] + 0.15
    return (x[:, hand, 2] - x[:, shoulder, 2])[raised]


def test_a_waving_hand_is_raised_by_an_arm_that_cannot_bend_forward() -> None:
    assert hand_over_shoulder(None).min() > 0.02


def test_a_way_that_is_followed_turns_no_faster_than_the_joints() -> None:
    robot, wave = load_robot("op3"), read_motion(SAMPLES / "wave.bvh").resample(10)
    leaping = replace(wave, positions=wave.positions[(np.arange(8) % 2) * (len(wave) // 2)], rotations=None)
    matched = match(leaping, robot)
    edges = build_edges(leaping, matched)
    solver = FrameSolver(build_problem(robot, matched, edges), Options())
    held = held_corners(edges.stances, solver.problem.feet, len(edges))
    pool = _Pool(solver, edges, held, np.arange(8), 10.0, Sketching())
    pool.set_out(robot.standing(), 7)
    way = np.array([poses[0].qpos[robot.qpos_index] for poses in pool.poses if poses])
    assert len(way) > 3 and (np.abs(np.diff(way, axis=0)) <= robot.max_speed / 10 + 1e-9).all()
