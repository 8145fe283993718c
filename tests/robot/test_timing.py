"""Between frames a trajectory runs straight, and on the shortest turn."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made_trajectories import hold, swing, wander
from scipy.spatial.transform import Rotation

from robot_retarget.base.errors import UsageError
from robot_retarget.robot import load_robot
from robot_retarget.robot.timing import joint_velocities, resample, sample

OP3 = load_robot("op3")


@settings(max_examples=30, deadline=None)
@given(st.floats(-1.0, 3.0))
def test_hinges_are_interpolated_as_numpy_does(time):
    trajectory = wander(OP3)
    frames = np.arange(len(trajectory)) / trajectory.fps
    got = sample(trajectory, OP3, np.array([time]))[0]
    wanted = [np.interp(time, frames, column) for column in trajectory.qpos.T]
    np.testing.assert_allclose(got[7:], wanted[7:], atol=1e-12)
    np.testing.assert_allclose(got[:3], wanted[:3], atol=1e-12)


def test_the_root_turns_at_constant_speed_between_frames():
    qpos = np.tile(OP3.standing(), (2, 1))
    qpos[1, 3:7] = [np.cos(0.6), 0, 0, np.sin(0.6)]
    trajectory = hold(OP3, qpos=qpos[0])
    trajectory = type(trajectory)(qpos, 1.0, OP3.joint_names, OP3.name)
    turned = Rotation.from_quat(sample(trajectory, OP3, np.linspace(0, 1, 5))[:, 3:7], scalar_first=True)
    np.testing.assert_allclose(turned.as_rotvec()[:, 2], np.linspace(0, 1.2, 5), atol=1e-12)


def test_its_own_rate_changes_nothing():
    trajectory = wander(OP3)
    np.testing.assert_allclose(resample(trajectory, OP3, trajectory.fps).qpos, trajectory.qpos, atol=1e-12)


def test_up_and_down_again_is_the_identity_at_common_frames():
    trajectory = wander(OP3, fps=25)
    up = resample(trajectory, OP3, 100)
    assert len(up) == 4 * (len(trajectory) - 1) + 1
    np.testing.assert_allclose(resample(up, OP3, 25).qpos, trajectory.qpos, atol=1e-12)


def test_a_single_frame_stays_one():
    still = hold(OP3, seconds=0)
    assert len(still) == 1
    np.testing.assert_allclose(resample(still, OP3, 30).qpos, still.qpos, atol=1e-15)


def test_velocity_is_the_derivative_of_the_sine():
    amplitude, hertz = 0.3, 0.5
    trajectory = swing(OP3, "l_el", amplitude, hertz, 2.0, fps=500)
    speed = joint_velocities(trajectory, OP3)[:, OP3.joint_names.index("l_el")]
    middle = (np.arange(len(speed)) + 0.5) / 500
    np.testing.assert_allclose(speed, amplitude * 2 * np.pi * hertz * np.cos(2 * np.pi * hertz * middle), atol=1e-4)


@pytest.mark.parametrize("fps", [0.0, -3.0, np.nan, np.inf])
def test_a_rate_that_is_not_positive_is_refused(fps):
    with pytest.raises(UsageError, match="positive"):
        resample(hold(OP3), OP3, fps)
