"""What is measured in one call is what MuJoCo says pair by pair, and points are where the kinematics puts them."""

import mujoco
import numpy as np
import pytest
from made_trajectories import wander

from robot_retarget.robot import Points, Robot, clearance, load_robot, world_points
from robot_retarget.robot.capsules import fit_capsules
from robot_retarget.robot.clearance import Clearance, Marks, Pairs
from robot_retarget.robot.collidable import collidable


@pytest.fixture(scope="module")
def op3() -> Robot:
    return load_robot("op3")


@pytest.fixture(scope="module")
def pairs(op3: Robot) -> Pairs:
    return collidable(op3)


def one_by_one(robot: Robot, pairs: Pairs, qpos: np.ndarray, reach: float) -> list[float]:
    """Of every pair of links, the least over its pairs of geoms."""
    model, data = robot.model, mujoco.MjData(robot.model)
    data.qpos[:] = qpos
    mujoco.mj_kinematics(model, data)
    return [min(mujoco.mj_geomDistance(model, data, a, b, reach, None) for a, b in geoms) for geoms in pairs.geoms]


def test_distances_are_those_of_the_geoms_asked_one_by_one(op3: Robot, pairs: Pairs) -> None:
    path = wander(op3, 8, 5.0).qpos
    found = Clearance(op3, pairs).all(path, 0.1)
    assert found == pytest.approx(np.array([one_by_one(op3, pairs, q, 0.1) for q in path]), abs=1e-12)
    assert found.min() < -0.005 and found.max() == 0.1


def test_pairs_asked_later_are_not_mixed_with_those_before(
    op3: Robot, pairs: Pairs, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, whole = wander(op3, 3, 5.0).qpos, Clearance(op3, pairs)
    every = whole.all(path, 0.1)
    monkeypatch.setattr(clearance, "SENSORS", 64)  # far fewer than there are pairs of geoms
    some, draw = Clearance(op3, pairs), np.random.default_rng(0)
    for count in (40, 3, 0, 120, 1):
        chosen = draw.choice(len(pairs), count, replace=False)
        reach = draw.uniform(0.01, 0.1)
        assert some.along(path, chosen, reach) == pytest.approx(np.minimum(every[:, chosen], reach), abs=1e-12)


def test_marks_are_where_the_kinematics_puts_them(op3: Robot) -> None:
    points, path = fit_capsules(op3).points, wander(op3, 5, 5.0).qpos
    assert Marks(op3, points).along(path) == pytest.approx(world_points(op3, points, path), abs=1e-12)
    assert Marks(op3, Points(np.zeros(0, int), np.zeros((0, 3)))).along(path).shape == (5, 0, 3)
