"""The quadratic model is what its docstring says: gradients by finite differences, edges by plain arithmetic."""

import numpy as np
import pytest
from shared_files import SHARED, needs_shared

from robot_retarget.base.files import SAMPLES
from robot_retarget.graph.describe import RobotGraph, describe
from robot_retarget.graph.track import FRAME, SECOND_DIFFERENCE, Role, ordered
from robot_retarget.human.read import read_motion
from robot_retarget.robot import load_robot, world_points
from robot_retarget.robot.kinematics import integrate
from robot_retarget.solver.limits import UNBOUNDED, Targets, targets_of
from robot_retarget.solver.problem import Problem, build_problem

Case = tuple[RobotGraph, Problem]


def made(name: str) -> Case:
    """A wave with every kind of edge, those with an interval and those between frames of the user's too."""
    graph = describe(read_motion(SAMPLES / "wave.bvh").frames(0, 40), load_robot(name))
    graph = graph.with_edge("l_knee", "r_knee", (0.01, 0.02)).with_edge("r_ankle", np.array([0.1, 0.0, 0.2]), at=0.0)
    return graph, build_problem(graph.robot, graph.match, graph.tracks)


@pytest.fixture(scope="module")
def case() -> Case:
    return made("op3")


def targets(graph: RobotGraph, frame: int) -> Targets:
    """The targets of a frame with redrawn weights, so that no kind hides behind another."""
    asked = targets_of(graph.tracks).at(frame)
    return Targets(asked.lower, asked.upper, np.random.default_rng(frame).uniform(1, 9, len(asked.lower)), asked.data)


def somewhere(problem: Problem, seed: int) -> np.ndarray:
    robot = problem.robot
    return integrate(robot, robot.standing(), np.random.default_rng(seed).normal(scale=0.3, size=robot.model.nv))


def check_gradient(case: Case, seed: int) -> None:
    graph, problem = case
    q, asked, step = somewhere(problem, seed), targets(graph, 7), 1e-6
    gradient = problem.model(q, asked)[1]
    for column, direction in enumerate(np.eye(problem.robot.model.nv)):
        ahead, behind = (problem.cost(integrate(problem.robot, q, s * step * direction), asked) for s in (1, -1))
        assert gradient[column] == pytest.approx((ahead - behind) / (4 * step), rel=1e-5, abs=1e-4)


@pytest.mark.parametrize("seed", range(3))
def test_gradient_is_half_the_slope_of_the_cost(case: Case, seed: int) -> None:
    check_gradient(case, seed)


@pytest.mark.parametrize("seed", range(3))
def test_a_joint_keeps_the_narrowest_of_its_own_range_and_all_its_bounds(case: Case, seed: int) -> None:
    graph, problem = case
    draw, robot = np.random.default_rng(seed), graph.robot
    middle, half = draw.normal(size=(2, len(targets(graph, 7))))
    asked = Targets(middle - np.abs(half), middle + np.abs(half), np.ones_like(half), np.zeros(0))
    lower, upper, speed = robot.lower.copy(), robot.upper.copy(), np.full(len(robot.lower), UNBOUNDED)
    edges = ((track, end) for track in ordered(graph.tracks) for end, _ in track.ends)
    for (track, end), low, high in zip(edges, asked.lower, asked.upper, strict=True):
        if track.role is Role.BOUND:
            k = robot.joint_names.index(end)
            if track.stencil == FRAME:
                lower[k], upper[k] = max(lower[k], low), min(upper[k], high)
            else:
                speed[k] = min(speed[k], -low, high)
    found = problem.limits.bounds(asked)
    for mine, theirs in ((lower, found.lower), (upper, found.upper), (speed, found.speed)):
        np.testing.assert_array_equal(mine, theirs)
    assert (lower > robot.lower).any() and (upper < robot.upper).any() and (speed < 0).any()


def test_the_target_of_a_second_difference_is_the_mean_of_those_of_its_edges_by_their_weights(case: Case) -> None:
    graph, problem = case
    draw, at, robot = np.random.default_rng(0), 0, graph.robot
    lower = draw.normal(size=len(targets(graph, 7)))
    asked = Targets(lower, lower, draw.uniform(1, 9, len(lower)), np.zeros(0))
    pull, weight = np.zeros(robot.model.nv), np.zeros(robot.model.nv)
    for track in ordered(graph.tracks):
        if track.stencil == SECOND_DIFFERENCE and track.role is Role.COST:
            assert len(track) == robot.model.nv
            own = asked.priority[at : at + len(track)] / track.scale**2
            weight, pull = weight + own, pull + own * lower[at : at + len(track)]
        at += len(track)
    found = problem.limits.differences(asked, SECOND_DIFFERENCE)
    np.testing.assert_allclose(found.weight, weight)
    np.testing.assert_allclose(found.bend, pull / weight)


@needs_shared
@pytest.mark.parametrize("name", ["toddlerbot_2xc", "unitree_h1", "berkeley_humanoid"])
def test_so_it_is_on_other_robots(name: str) -> None:
    robot = load_robot(SHARED / f"robots/{name}/{name}.xml")
    graph = describe(read_motion(SAMPLES / "wave.bvh").frames(0, 8), robot)
    check_gradient((graph, build_problem(robot, graph.match, graph.tracks)), 0)


def test_normal_matrix_is_that_of_reweighted_least_squares(case: Case) -> None:
    """J by central differences of what is measured, W = π/scale² · ϱ'(e)/2e; nothing within an open interval."""
    graph, problem = case
    q, every, step = somewhere(problem, 1), targets(graph, 3), 1e-6
    edges = len(problem.values(q))
    asked = Targets(every.lower[:edges], every.upper[:edges], every.priority[:edges], every.data)
    jacobian = np.empty((len(asked.lower), problem.robot.model.nv))
    for column, direction in enumerate(np.eye(problem.robot.model.nv)):
        ahead, behind = (problem.values(integrate(problem.robot, q, s * step * direction)) for s in (1, -1))
        jacobian[:, column] = (ahead - behind) / (2 * step)
    scale = np.concatenate([track.scale for track in graph.costs])
    huber_delta = np.concatenate([np.full(len(track), track.huber_delta) for track in graph.costs])
    d = problem.values(q)
    error = (d - np.clip(d, asked.lower, asked.upper)) / scale
    inside = (asked.lower < d) & (d < asked.upper)
    weight = asked.priority / scale**2 / np.sqrt(1 + (error / huber_delta) ** 2) * ~inside
    cost, _, normal = problem.model(q, asked)
    assert cost == pytest.approx(problem.cost(q, asked), rel=1e-12)
    assert np.allclose(normal, jacobian.T @ (weight[:, None] * jacobian), rtol=1e-6, atol=1e-6 * np.abs(normal).max())
    assert (normal == normal.T).all() and np.linalg.eigvalsh(normal).min() > -1e-12 * np.abs(normal).max()


def test_floor_heights_are_those_of_the_sole_points(case: Case) -> None:
    graph, problem = case
    q = somewhere(problem, 4)
    soles = [world_points(problem.robot, sole, q[None])[0, :, 2] for sole in graph.match.anatomy.soles.values()]
    assert np.allclose(
        -problem.inequalities.rows(q, targets_of(graph.tracks).at(0))[1], np.concatenate(soles), atol=1e-12
    )
    assert len(problem.inequalities) == len(np.concatenate(soles))
