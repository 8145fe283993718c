"""Interaction edges slow links down that near each other, and leave all others alone."""

import numpy as np
import pytest
from shared_files import SHARED, needs_shared

from robot_retarget.arrays import Floats
from robot_retarget.collision.warn import surfaces
from robot_retarget.describe.edges import build_edges
from robot_retarget.describe.match import match
from robot_retarget.motion import read_motion
from robot_retarget.robot import load_robot
from robot_retarget.robot.clearance import Clearance
from robot_retarget.robot.kinematics import integrate
from robot_retarget.shipped import SAMPLES
from robot_retarget.solve.frame import Options
from robot_retarget.solve.problem import build_problem
from robot_retarget.solve.quadratic import Ahead, Landscape, Quadratic
from robot_retarget.transfer import retarget

K, WEIGHT = 6.0, 3.0


@pytest.fixture(scope="module")
def landscape() -> Landscape:
    motion, robot = read_motion(SAMPLES / "wave.bvh").frames(0, 5), load_robot("op3")
    matched = match(motion, robot)
    return Landscape(build_problem(robot, matched, build_edges(motion, matched)), True, 0.006, 0.05)


def model_of(landscape: Landscape, slope: Floats, room: Floats) -> Quadratic:
    """No cost, and links whose distances beyond the margin are `room` + `slope` v."""
    nv, soles, near = landscape.robot.model.nv, landscape.problem.soles, len(room)
    rows, least = np.zeros((landscape.rows, nv + 1)), np.full(landscape.rows, -np.inf)
    rows[soles : soles + near, :-1], rows[soles : soles + near, -1], least[soles : soles + near] = slope, 1.0, -room
    return Quadratic(0.0, np.zeros(nv), np.zeros((nv, nv)), rows, least, 0.0, False)


@pytest.mark.parametrize("seed", range(5))
def test_the_edges_cost_what_the_distance_in_k_frames_lacks(landscape: Landscape, seed: int) -> None:
    robot, draw = landscape.robot, np.random.default_rng(seed)
    step, slope = np.zeros(robot.model.nv), draw.normal(size=(9, robot.model.nv))
    step[robot.dof_index] = draw.normal(scale=0.02, size=len(robot.dof_index))
    room, q = draw.uniform(-0.01, 0.05, 9), robot.standing()
    found = landscape.foreseen(model_of(landscape, slope, room), q, Ahead(integrate(robot, q, -step), K, WEIGHT))

    def cost(v: Floats) -> float:
        now = room + slope @ v
        ahead = np.maximum(now, 0) + K * slope @ (step + v)
        return WEIGHT / landscape.leg**2 * float((np.minimum(ahead, 0) ** 2).sum())

    assert found.cost == pytest.approx(cost(np.zeros_like(step))) and found.cost > 0
    v = 1e-7 * draw.normal(size=len(step))
    assert 2 * found.gradient @ v + v @ found.normal @ v == pytest.approx(cost(v) - found.cost, rel=1e-5)


def test_the_way_apart_and_standing_still_cost_nothing(landscape: Landscape) -> None:
    robot = landscape.robot
    slope, q, step = np.zeros((1, robot.model.nv)), robot.standing(), np.zeros(robot.model.nv)
    slope[0, robot.dof_index[0]], step[robot.dof_index[0]] = 1.0, 0.1
    for way, cost in ((0.0, 0.0), (1.0, 0.0), (-1.0, WEIGHT * (0.1 * K - 0.01) ** 2 / landscape.leg**2)):
        before = integrate(robot, q, -way * step)
        found = landscape.foreseen(model_of(landscape, slope, np.array([0.01])), q, Ahead(before, K, WEIGHT))
        assert found.cost == pytest.approx(cost)


@needs_shared
def test_legs_that_would_cross_part_earlier_than_by_separation_alone() -> None:
    robot = load_robot(SHARED / "robots/unitree_g1/unitree_g1.xml")
    motion = read_motion(SHARED / "motions/bvh/cmu_cgspeed_motionbuilder/02_01_walk.bvh").frames(0, 240)
    known = surfaces(robot)
    clearance = Clearance(robot, known.pairs)
    near = []
    for weight in (0.0, 3.0):
        found = retarget(motion, robot, fps=30, options=Options(interaction=weight)).trajectory
        distance = clearance.all(found.qpos, 0.05)
        assert distance.min() > -1e-3
        near.append(np.sort(distance.min(axis=1)))
    assert near[1][: len(near[1]) // 4].mean() > near[0][: len(near[0]) // 4].mean()
