"""The motion of a robot carried over to another robot, or to itself."""

import mujoco
import numpy as np
import pytest
from scipy.constants import g
from shared_files import ROOT

import robot_retarget as rr
from robot_retarget.base.errors import TrajectoryError
from robot_retarget.human.robot_performer import performed
from robot_retarget.robot import recognise

SAMPLES = ROOT / "samples"


@pytest.fixture(scope="module")
def walk() -> rr.Trajectory:
    """A walk of the G1-class robot."""
    return rr.retarget(SAMPLES / "walk.bvh", "g1_class").trajectory


@pytest.mark.parametrize(
    ("name", "clip", "most"), [("op3", "squat", 1e-3), ("g1_class", "wave", 1e-3), ("op3", "wave", 2e-3)]
)
def test_a_transfer_to_the_robot_itself_is_the_identity(name: str, clip: str, most: float) -> None:
    """Within 2e-4 rad in most frames; the shoulders of the OP3 are near a singular pose in a few."""
    robot = rr.load_robot(name)
    own = rr.retarget(rr.read_motion(SAMPLES / f"{clip}.bvh").frames(0, 75), robot, balance="off").trajectory
    carried = rr.transfer(own, robot, robot, balance="off").trajectory
    off = np.abs(carried.qpos[:, 7:] - own.qpos[:, 7:]).max(axis=1)
    assert np.median(off) < 3e-4 and off.max() < most


def test_a_walk_is_the_identity_but_at_the_edges_of_stances(walk: rr.Trajectory) -> None:
    robot = rr.load_robot("g1_class")
    off = np.abs(rr.transfer(walk, robot, robot).trajectory.qpos[:, 7:] - walk.qpos[:, 7:]).max(axis=1)
    assert np.median(off) < 2e-4 and off.max() < 2e-3


def test_flights_turns_and_slips_of_the_robot_are_kept() -> None:
    """A hop at 0.7 g, and soles that turn and slip while they stand."""
    robot = rr.load_robot("g1_class")
    times = np.arange(45) / 30
    own = np.tile(robot.standing(), (len(times), 1))
    slip, hop = np.clip(times, 0.2, 0.7) - 0.2, np.clip(times - 1.0, 0, 0.3)
    own[:, 1] += 0.04 * slip
    own[:, 2] += 0.7 * g * hop * (0.3 - hop) / 2
    own[:, 3], own[:, 6] = np.cos(0.08 * slip), np.sin(0.08 * slip)
    found = rr.transfer(rr.Trajectory(own, 30, robot.joint_names, robot.name), robot, robot).trajectory.qpos
    assert np.abs(found[:, 7:] - own[:, 7:]).max() < 2e-3
    np.testing.assert_allclose(found[:, :3] - found[0, :3], own[:, :3] - own[0, :3], atol=2e-3)
    np.testing.assert_allclose(found[:, 3:7], own[:, 3:7], atol=1e-3)


def test_keypoints_of_the_performer_are_where_mujoco_puts_them(walk: rr.Trajectory) -> None:
    robot = rr.load_robot("g1_class")
    motion, anatomy, data = performed(walk, robot), recognise(robot), mujoco.MjData(robot.model)
    for t in (0, 50, 150):
        data.qpos[:] = walk.qpos[t]
        mujoco.mj_forward(robot.model, data)
        for name, site in anatomy.sites.items():
            place = data.xpos[site.body] + data.xmat[site.body].reshape(3, 3) @ site.offset
            found = motion.positions[t, motion.skeleton.names.index(name)]
            assert found[:2] == pytest.approx(place[:2], abs=1e-9)
            assert found[2] == pytest.approx(place[2], abs=2e-3)  # over its lowest sole


def test_another_robot_looks_like_the_performer(walk: rr.Trajectory) -> None:
    result = rr.transfer(walk, rr.load_robot("g1_class"), rr.load_robot("op3"), balance="off")
    legs, arms = result.likeness.part("legs"), result.likeness.part("arms")
    assert legs is not None and arms is not None
    assert legs < np.radians(3) and arms < np.radians(16)
    assert np.linalg.norm(result.likeness.robot.path[-1]) > 0.8 * result.match.leg_ratio * np.linalg.norm(
        walk.qpos[-1, :2] - walk.qpos[0, :2]
    )


def test_a_trajectory_of_another_robot_is_refused(walk: rr.Trajectory) -> None:
    with pytest.raises(TrajectoryError, match="g1_class"):
        performed(walk, rr.load_robot("op3"))
