"""The quadratic model is what its docstring says: gradients by finite differences, edges by plain arithmetic."""

import numpy as np
import pytest

from robot_retarget.describe.edges import Edges, build_edges
from robot_retarget.describe.match import Match, match
from robot_retarget.motion import read_motion
from robot_retarget.robot import load_robot, world_points
from robot_retarget.robot.kinematics import integrate
from robot_retarget.shipped import SAMPLES
from robot_retarget.solve.problem import Problem, build_problem, frame_parameters


@pytest.fixture(scope="module")
def case() -> tuple[Match, Edges, Problem]:
    motion, robot = read_motion(SAMPLES / "wave.bvh").frames(0, 40), load_robot("op3")
    matched = match(motion, robot)
    edges = build_edges(motion, matched)
    return matched, edges, build_problem(robot, matched, edges)


def wishes(edges: Edges, frame: int) -> tuple[np.ndarray, ...]:
    """All parameters of a frame, with every corner held somewhere."""
    draw = np.random.default_rng(frame)
    return (*frame_parameters(edges, frame), draw.uniform(1, 9, 24), draw.normal(size=24))


def somewhere(problem: Problem, seed: int) -> np.ndarray:
    robot = problem.robot
    return integrate(robot, robot.standing(), np.random.default_rng(seed).normal(scale=0.3, size=robot.model.nv))


@pytest.mark.parametrize("seed", range(3))
def test_gradient_is_half_the_slope_of_the_cost(case: tuple[Match, Edges, Problem], seed: int) -> None:
    _, edges, problem = case
    q, parameters, step = somewhere(problem, seed), wishes(edges, 7), 1e-6
    gradient = problem.model(q, *parameters)[1]
    for column, direction in enumerate(np.eye(problem.robot.model.nv)):
        ahead, behind = (
            problem.model(integrate(problem.robot, q, s * step * direction), *parameters)[0][0] for s in (1, -1)
        )
        assert gradient[column] == pytest.approx((ahead - behind) / (4 * step), rel=1e-5, abs=1e-5)


def test_normal_matrix_is_symmetric_and_bounded_below_by_nothing_negative(case: tuple[Match, Edges, Problem]) -> None:
    _, edges, problem = case
    normal = problem.model(somewhere(problem, 1), *wishes(edges, 3))[2]
    assert np.allclose(normal, normal.T, atol=1e-12)
    assert np.linalg.eigvalsh(normal).min() > -1e-10


def test_stress_is_the_relative_error_of_every_pair(case: tuple[Match, Edges, Problem]) -> None:
    matched, edges, problem = case
    q = somewhere(problem, 2)
    x = world_points(problem.robot, matched.points, q[None])[0]
    x[matched.index("pelvis")] = (x[matched.index("l_hip")] + x[matched.index("r_hip")]) / 2
    i, j = edges.pairs.T
    expected = (np.linalg.norm(x[i] - x[j], axis=1) - edges.distance[5]) / edges.path_length
    assert np.allclose(problem.stress(q, edges.distance[5])[0], expected, atol=1e-9)


def test_floor_heights_are_those_of_the_sole_points(case: tuple[Match, Edges, Problem]) -> None:
    matched, _, problem = case
    q = somewhere(problem, 4)
    soles = [world_points(problem.robot, sole, q[None])[0, :, 2] for sole in matched.anatomy.soles.values()]
    assert np.allclose(problem.heights(q)[0], np.concatenate(soles), atol=1e-12)
