"""Interaction edges: links that near each other part earlier, warnings are fewer, and all others are left alone."""

import numpy as np
import pytest
from shared_files import SHARED, needs_shared

from robot_retarget.base.arrays import Floats
from robot_retarget.base.files import SAMPLES
from robot_retarget.collision.warn import warnings_of
from robot_retarget.graph.describe import describe
from robot_retarget.graph.kinds.interaction import InteractionKind
from robot_retarget.graph.weights import Weights
from robot_retarget.human.read import read_motion
from robot_retarget.robot import load_robot
from robot_retarget.robot.distances import LinkDistances
from robot_retarget.robot.kinematics import integrate
from robot_retarget.solver.near_links import NearLinks
from robot_retarget.solver.options import SolveOptions
from robot_retarget.solver.problem import build_problem, targets_of
from robot_retarget.solver.quadratic import CostModel, Quadratic
from robot_retarget.solver.solve import solve_graph
from robot_retarget.solver.stencils import Neighbours

K, WEIGHT = 6.0, 3.0
HORIZON = InteractionKind().horizon


@pytest.fixture(scope="module")
def costs() -> CostModel:
    graph = describe(
        read_motion(SAMPLES / "wave.bvh").frames(0, 5), load_robot("op3"), weights=Weights(interaction=WEIGHT)
    )
    return CostModel(build_problem(graph.robot, graph.match, graph.tracks), SolveOptions())


def one_step(costs: CostModel, before: Floats, seconds: float) -> Neighbours:
    """A frame after a configuration."""
    return Neighbours({-1: before}, {0: targets_of(costs.problem.tracks).at(0)}, seconds)


def model_of(costs: CostModel, slope: Floats, room: Floats) -> Quadratic:
    """No cost, and links whose distances beyond the margin are `room` + `slope` v."""
    nv, soles, near = costs.robot.model.nv, len(costs.problem.inequalities), len(room)
    rows, least = np.zeros((costs.rows, nv + 1)), np.full(costs.rows, -np.inf)
    rows[soles : soles + near, :-1], rows[soles : soles + near, -1], least[soles : soles + near] = slope, 1.0, -room
    near_links = NearLinks(np.zeros((1, costs.robot.model.nq)), near, nv)
    zero, clear = np.zeros(1), np.zeros(1, dtype=bool)
    return Quadratic(zero, np.zeros((1, nv)), np.zeros((1, nv, nv)), rows[None], least[None], zero, clear, near_links)


@pytest.mark.parametrize("seed", range(5))
def test_the_edges_cost_what_the_least_distance_of_the_frames_ahead_lacks(costs: CostModel, seed: int) -> None:
    robot, draw = costs.robot, np.random.default_rng(seed)
    step, slope = np.zeros(robot.model.nv), draw.normal(size=(9, robot.model.nv))
    step[robot.dof_index] = draw.normal(scale=0.02, size=len(robot.dof_index))
    room, q = draw.uniform(-0.01, 0.05, 9), robot.standing()
    found = costs.with_neighbours(
        model_of(costs, slope, room), q[None], one_step(costs, integrate(robot, q, -step), HORIZON / K)
    )

    def cost(v: Floats) -> float:
        now, change = np.maximum(room + slope @ v, 0), slope @ (step + v)
        ahead = np.min([now + k * change for k in np.linspace(0, K, 7)], axis=0)  # D, least over α = 1 + k
        return WEIGHT / costs.leg**2 * float((np.minimum(ahead, 0) ** 2).sum())

    assert found.cost[0] == pytest.approx(cost(np.zeros_like(step))) and found.cost[0] > 0
    v = 1e-7 * draw.normal(size=len(step))
    assert 2 * found.gradient[0] @ v + v @ found.normal[0] @ v == pytest.approx(cost(v) - found.cost[0], rel=1e-5)


def test_the_way_apart_and_standing_still_cost_nothing(costs: CostModel) -> None:
    robot = costs.robot
    slope, q, step = np.zeros((1, robot.model.nv)), robot.standing(), np.zeros(robot.model.nv)
    slope[0, robot.dof_index[0]], step[robot.dof_index[0]] = 1.0, 0.1
    for way, cost in ((0.0, 0.0), (1.0, 0.0), (-1.0, WEIGHT * (0.1 * K - 0.01) ** 2 / costs.leg**2)):
        before = integrate(robot, q, -way * step)
        found = costs.with_neighbours(
            model_of(costs, slope, np.array([0.01])), q[None], one_step(costs, before, HORIZON / K)
        )
        assert found.cost[0] == pytest.approx(cost)


@needs_shared
def test_warnings_are_fewer_for_a_twentieth_of_the_stress_at_most_and_legs_pass_farther_apart() -> None:
    """Nothing touches either way, so that every warning is a false alarm."""
    robot = load_robot(SHARED / "robots/unitree_g1/unitree_g1.xml")
    motion = read_motion(SHARED / "motions/bvh/cmu_cgspeed_motionbuilder/02_01_walk.bvh").frames(0, 240)
    links, near, alarms, stress = LinkDistances(robot, 0.05), [], [], []
    for weight in (0.0, 1.0):
        solution = solve_graph(describe(motion, robot, fps=30, weights=Weights(interaction=weight)))
        distance = links.along(solution.trajectory.qpos)
        assert distance.min() > -1e-3
        near.append(np.sort(distance.min(axis=1))[: len(distance) // 4].mean())
        alarms.append(int(warnings_of(solution.trajectory, robot).flagged.sum()))
        stress.append(float(solution.cost.sum()))
        assert (solution.stress.get("interaction", np.zeros(1)).max() > 0) == (weight > 0)
    assert near[1] > near[0] and alarms[1] < 0.9 * alarms[0]
    assert stress[1] < 1.05 * stress[0]
