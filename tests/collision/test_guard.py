"""A guarded stream never collides with itself, and is left alone where it would not."""

import numpy as np
import pytest
from made_trajectories import swing, wander

from robot_retarget.collision.guard import Guard, GuardOptions
from robot_retarget.collision.warn import Surfaces, surfaces
from robot_retarget.errors import UsageError
from robot_retarget.robot import Robot, load_robot
from robot_retarget.simulate.contacts import replay_contacts
from robot_retarget.trajectory import Trajectory


@pytest.fixture(scope="module")
def op3() -> Robot:
    return load_robot("op3")


@pytest.fixture(scope="module")
def known(op3: Robot) -> Surfaces:
    return surfaces(op3)


def guarded(robot: Robot, known: Surfaces, wanted: Trajectory) -> np.ndarray:
    guard = Guard(robot, wanted.fps, known=known)
    return np.array([guard.update(q).qpos for q in wanted.qpos])


@pytest.mark.parametrize("seed", range(4))
def test_no_frame_of_a_guarded_stream_collides(op3: Robot, known: Surfaces, seed: int) -> None:
    wanted = wander(op3, 60, 30.0, seed)
    assert (replay_contacts(op3, wanted.qpos).depth > 0.001).any()
    assert not (replay_contacts(op3, guarded(op3, known, wanted)).depth > 0.001).any()


def test_a_stream_that_stays_clear_is_left_alone(op3: Robot, known: Surfaces) -> None:
    wanted = swing(op3, "head_pan", 0.6, 0.5, 2.0, 30.0)
    assert guarded(op3, known, wanted) == pytest.approx(wanted.qpos, abs=1e-12)


def test_held_joints_are_let_go_again_and_catch_up_gently(op3: Robot, known: Surfaces) -> None:
    wanted = swing(op3, "l_sho_roll", 1.2, 0.25, 5.0, 30.0)
    stream = np.concatenate([wanted.qpos, np.tile(op3.standing(), (20, 1))])
    guard = Guard(op3, 30.0, known=known)
    frames = [guard.update(q) for q in stream]
    assert {joint for frame in frames for joint in frame.held} >= {"l_sho_roll"}
    assert not frames[-1].held and frames[-1].qpos == pytest.approx(stream[-1], abs=1e-12)
    speed = np.diff([frame.qpos[op3.qpos_index] for frame in frames], axis=0)
    gathered = np.diff(np.abs(speed), axis=0)
    most = op3.max_speed / (GuardOptions().release * 30**2)
    assert (gathered <= most + np.abs(np.diff(stream[:, op3.qpos_index], n=2, axis=0)) + 1e-9).all()


def test_options_out_of_range_are_refused() -> None:
    for options in ({"gain": 0.0}, {"gain": 1.5}, {"margin": -0.1}, {"margin": 0.2}, {"release": 0.0}):
        with pytest.raises(UsageError):
            GuardOptions(**options)
