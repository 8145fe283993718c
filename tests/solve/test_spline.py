"""The cubic spline is SciPy's, and rotations on it are those between its knots."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from robot_retarget.robot import load_robot
from robot_retarget.solve.candidates import interpolated
from robot_retarget.solve.spline import cubic_spline


@pytest.mark.parametrize("count", [2, 3, 4, 5, 40])
def test_the_spline_is_that_of_scipy(count: int) -> None:
    drawn = np.random.default_rng(count)
    knots = np.cumsum(drawn.integers(1, 5, count)) - 3
    values, wanted = drawn.normal(size=(count, 7)), np.arange(knots[0], knots[-1] + 1)
    np.testing.assert_allclose(cubic_spline(knots, values, wanted), CubicSpline(knots, values)(wanted), atol=1e-12)


def test_the_root_turns_along_the_rotations_between_its_poses() -> None:
    robot, times = load_robot("op3"), np.arange(0, 41, 10)
    turn = Rotation.from_rotvec(np.outer(np.arange(41) / 60, [0.3, 0.2, 1.5]))
    poses = np.repeat(robot.neutral()[None], 41, axis=0)
    poses[:, 3:7] = turn.as_quat(scalar_first=True)
    poses[10::20, 3:7] *= -1  # the same rotations
    found = np.array(interpolated(robot, times, list(poses[times]), []))
    away = turn.inv() * Rotation.from_quat(found[:, 3:7], scalar_first=True)
    assert away.magnitude().max() < 1e-3
    np.testing.assert_allclose(np.linalg.norm(found[:, 3:7], axis=1), 1.0)
