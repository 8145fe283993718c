"""The one forward kinematics against MuJoCo's own, and its Jacobian against MuJoCo and finite differences."""

from pathlib import Path

import mujoco
import numpy as np
import pytest
from point_functions import point_function
from shared_files import SHARED, needs_shared

from robot_retarget.robot import Points, Robot, load_robot, world_points
from robot_retarget.robot.kinematics import PlacedPoints, difference, integrate, mass_function

MODELS = sorted(SHARED.glob("robots/*/*.xml"))


def random_case(robot: Robot, seed: int, count: int = 12) -> tuple[Points, np.ndarray]:
    draw = np.random.default_rng(seed)
    points = Points(draw.integers(1, robot.model.nbody, count), draw.normal(scale=0.1, size=(count, 3)))
    return points, integrate(robot, np.array(robot.model.qpos0), draw.normal(size=robot.model.nv))


def mujoco_jacobian(robot: Robot, points: Points, qpos: np.ndarray) -> np.ndarray:
    data = mujoco.MjData(robot.model)
    data.qpos[:] = qpos
    mujoco.mj_kinematics(robot.model, data)
    mujoco.mj_comPos(robot.model, data)
    rows = []
    for body, place in zip(points.bodies, world_points(robot, points, qpos[None])[0], strict=True):
        jacobian = np.zeros((3, robot.model.nv))
        mujoco.mj_jac(robot.model, data, jacobian, None, place, int(body))
        rows.append(jacobian)
    return np.concatenate(rows)


@pytest.mark.parametrize("seed", range(5))
def test_points_and_jacobian_agree_with_mujoco(seed: int) -> None:
    robot = load_robot("op3")
    points, qpos = random_case(robot, seed)
    x, jacobian = point_function(robot, points)(qpos)
    assert np.allclose(x.full().reshape(-1, 3), world_points(robot, points, qpos[None])[0], atol=1e-12)
    assert np.allclose(jacobian.full(), mujoco_jacobian(robot, points, qpos), atol=1e-12)


def test_points_placed_at_one_configuration_after_the_other_follow_the_jacobian() -> None:
    robot, step = load_robot("op3"), 1e-6
    points, qpos = random_case(robot, 2)
    placed, (_, jacobian) = PlacedPoints(robot, points), point_function(robot, points)(qpos)
    for dof, way in enumerate(np.eye(robot.model.nv) * step):
        moved = placed.at(integrate(robot, qpos, way)) - placed.at(qpos)
        assert np.allclose(moved.ravel() / step, jacobian.full()[:, dof], atol=1e-5)


@needs_shared
@pytest.mark.parametrize("path", MODELS, ids=lambda path: path.stem)
def test_every_robot_moves_as_mujoco_moves_it(path) -> None:
    robot = load_robot(path)
    points, qpos = random_case(robot, 1)
    x, jacobian = point_function(robot, points)(qpos)
    assert np.allclose(x.full().reshape(-1, 3), world_points(robot, points, qpos[None])[0], atol=1e-12)
    assert np.allclose(jacobian.full(), mujoco_jacobian(robot, points, qpos), atol=1e-12)


MIXED = """<mujoco><worldbody><body pos="0.1 0 1" quat="0.9 0.1 0.3 0.2">
  <joint type="hinge" axis="1 2 0" pos="0.1 0.2 0" ref="0.3"/><joint type="slide" axis="0 1 1"/>
  <joint type="hinge" axis="0 0 1" pos="0 0 0.3"/><geom size="0.1"/>
  <body pos="0.3 0.1 0" euler="10 20 30"><joint type="slide" axis="1 0 0" ref="0.1"/>
    <joint type="hinge" axis="0 1 0" pos="0.2 0 0.1"/><geom size="0.1"/></body>
</body></worldbody></mujoco>"""


@pytest.mark.parametrize("seed", range(3))
def test_hinges_and_slides_in_any_order_on_one_body_move_as_in_mujoco(tmp_path: Path, seed: int) -> None:
    (tmp_path / "mixed.xml").write_text(MIXED)
    robot = load_robot(tmp_path / "mixed.xml")
    points, qpos = random_case(robot, seed)
    x, jacobian = point_function(robot, points)(qpos)
    assert np.allclose(x.full().reshape(-1, 3), world_points(robot, points, qpos[None])[0], atol=1e-12)
    assert np.allclose(jacobian.full(), mujoco_jacobian(robot, points, qpos), atol=1e-12)
    for ours, theirs in zip(mass_function(robot)(qpos), mujoco_mass(robot, qpos), strict=True):
        assert np.allclose(ours.full().squeeze(), theirs, atol=1e-12)


def mujoco_mass(robot: Robot, qpos: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The centre of mass of the robot's tree and its Jacobian, by MuJoCo."""
    data = mujoco.MjData(robot.model)
    data.qpos[:] = qpos
    mujoco.mj_kinematics(robot.model, data)
    mujoco.mj_comPos(robot.model, data)
    jacobian, tree = np.zeros((3, robot.model.nv)), int(robot.model.body_rootid[robot.root_body])
    mujoco.mj_jacSubtreeCom(robot.model, data, jacobian, tree)
    return data.subtree_com[tree], jacobian


@pytest.mark.parametrize("seed", range(3))
def test_the_centre_of_mass_agrees_with_mujoco(seed: int) -> None:
    robot = load_robot("op3")
    _, qpos = random_case(robot, seed)
    for ours, theirs in zip(mass_function(robot)(qpos), mujoco_mass(robot, qpos), strict=True):
        assert np.allclose(ours.full().squeeze(), theirs, atol=1e-9)


@needs_shared
@pytest.mark.parametrize("path", MODELS, ids=lambda path: path.stem)
def test_every_robots_centre_of_mass_agrees_with_mujoco(path) -> None:
    robot = load_robot(path)
    _, qpos = random_case(robot, 2)
    for ours, theirs in zip(mass_function(robot)(qpos), mujoco_mass(robot, qpos), strict=True):
        assert np.allclose(ours.full().squeeze(), theirs, atol=1e-9)


def test_jacobian_agrees_with_central_differences() -> None:
    robot = load_robot("op3")
    points, qpos = random_case(robot, 7)
    function, step = point_function(robot, points), 1e-6
    jacobian = function(qpos)[1].full()
    for column, direction in enumerate(np.eye(robot.model.nv)):
        ahead, behind = (function(integrate(robot, qpos, s * step * direction))[0] for s in (1, -1))
        slope = (ahead.full() - behind.full()).ravel() / (2 * step)
        assert np.allclose(jacobian[:, column], slope, atol=1e-8)


def test_difference_undoes_integrate() -> None:
    robot = load_robot("op3")
    velocity = np.random.default_rng(3).normal(scale=0.5, size=robot.model.nv)
    start = random_case(robot, 3)[1]
    assert np.allclose(difference(robot, start, integrate(robot, start, velocity)), velocity, atol=1e-12)


@pytest.mark.parametrize("path", ["op3", *MODELS])
@pytest.mark.parametrize("turn", [1e-17, 1e-9, 0.3, 3.1, 6.0])
def test_many_configurations_move_as_mujoco_moves_each(path, turn: float) -> None:
    robot, draw = load_robot(path), np.random.default_rng(3)
    start = np.array([random_case(robot, seed)[1] for seed in range(40)])
    step = turn * draw.normal(size=(40, robot.model.nv)) / 3**0.5
    end = integrate(robot, start, step)
    back = difference(robot, start, end)
    for before, after, way, found in zip(start, end, step, back, strict=True):
        moved, led = before.copy(), np.empty(robot.model.nv)
        mujoco.mj_integratePos(robot.model, moved, way, 1.0)
        mujoco.mj_differentiatePos(robot.model, led, 1.0, before, after)
        np.testing.assert_allclose(after, moved, atol=1e-14)
        np.testing.assert_allclose(found, led, atol=1e-12)
