"""Ways from and into the robot's stand: smooth, never back, with links apart."""

import mujoco
import numpy as np
import pytest
from scipy.constants import g

from robot_retarget.base.errors import UsageError
from robot_retarget.base.files import SAMPLES
from robot_retarget.edit.stands import between_stands
from robot_retarget.human.read import read_motion
from robot_retarget.robot import load_robot, recognise, world_points
from robot_retarget.solver.pipeline import retarget
from robot_retarget.trajectory import Trajectory

OP3 = load_robot("op3")


@pytest.fixture(scope="module")
def squat() -> Trajectory:
    return retarget(read_motion(SAMPLES / "squat.bvh").frames(10, 50), OP3, legs="follow", balance="off").trajectory


@pytest.mark.parametrize("seconds", [0.3, 1.0])
def test_a_trajectory_between_stands_is_itself_between_smooth_ways_from_the_standing_pose(
    squat: Trajectory, seconds: float
) -> None:
    whole = between_stands(squat, OP3, seconds)
    begin = int(np.searchsorted(whole.source_time, squat.source_time[1])) - 1
    inner = slice(begin, begin + len(squat))
    np.testing.assert_array_equal(whole.qpos[inner], squat.qpos)
    np.testing.assert_array_equal(whole.source_time[inner], squat.source_time)
    assert min(begin, len(whole) - inner.stop) >= round(seconds * squat.fps)
    stand = OP3.standing()[OP3.qpos_index]
    for end in (0, -1):
        np.testing.assert_allclose(whole.qpos[end, OP3.qpos_index], stand, atol=1e-12)
    speed = np.diff(whole.qpos[:, OP3.qpos_index], axis=0) * whole.fps
    assert (np.abs(speed) <= OP3.max_speed + 1e-9).all()
    bend = np.abs(np.diff(speed, axis=0)).max(axis=1)
    assert max(bend[begin - 2 : begin + 1].max(), bend[inner.stop - 2 : inner.stop + 1].max()) <= bend.max()
    assert max(np.abs(speed[0]).max(), np.abs(speed[-1]).max()) < 0.1 * np.abs(speed).max()
    soles = np.concatenate([world_points(OP3, tread, whole.qpos) for tread in recognise(OP3).treads.values()], axis=1)
    ends = [*range(begin + 1), *range(inner.stop - 1, len(whole))]
    assert np.abs(soles[ends, :, 2].min(axis=1)).max() < 0.003


def test_ways_that_take_no_time_change_nothing_and_negative_times_are_refused(squat: Trajectory) -> None:
    assert between_stands(squat, OP3, 0) is squat
    with pytest.raises(UsageError, match="got -1"):
        between_stands(squat, OP3, -1)


def held(qpos: np.ndarray, frames: int = 8) -> Trajectory:
    """A configuration for some frames."""
    return Trajectory(np.tile(qpos, (frames, 1)), 30.0, OP3.joint_names, "op3", "held")


def test_a_way_to_a_fast_trajectory_never_leads_the_root_back_nor_slips_and_lasts_longer_the_faster_it_is() -> None:
    """At 0.6 g, the friction of the most slippery floor that is drawn."""
    lasted = []
    for speed in (0.5, 2.0, 4.0):
        ahead = np.array([0.6, 0.8])
        still = held(OP3.standing())
        qpos = still.qpos.copy()
        qpos[:, :2] += np.arange(len(qpos))[:, None] / 30 * speed * ahead
        whole = between_stands(still.altered(qpos=qpos), OP3, 0.4)
        way = whole.qpos[:, :2] @ ahead
        steps = np.diff(way)
        assert steps.min() > -1e-9 and np.abs(np.diff(steps)).max() * 900 < 0.6 * g * 1.05
        assert abs(steps[0]) * 30 < 0.2 * speed
        lasted.append(len(whole))
    assert lasted[0] < lasted[1] < lasted[2]


def test_links_are_apart_on_a_way_whose_joints_would_drive_one_into_another() -> None:
    """By MuJoCo's contacts: straight on, the forearm would be 15 mm inside the hip."""
    pose, arm = OP3.standing(), ["l_sho_pitch", "l_sho_roll", "l_el"]
    pose[OP3.qpos_index[[OP3.joint_names.index(joint) for joint in arm]]] = 0.62, 1.32, -1.46
    whole = between_stands(held(pose), OP3, 0.6)
    straight = OP3.standing() + np.linspace(0, 1, 21)[:, None] * (pose - OP3.standing())
    assert deepest(straight) > 0.01
    assert deepest(whole.qpos) < 1e-3


def deepest(path: np.ndarray) -> float:
    """How deep the left forearm is inside another link [m]."""
    data, most = mujoco.MjData(OP3.model), 0.0
    own = OP3.model.body("l_el_link").id
    for qpos in path:
        data.qpos[:] = qpos
        mujoco.mj_forward(OP3.model, data)
        for contact in data.contact:
            bodies = OP3.model.geom_bodyid[contact.geom]
            if own in bodies and OP3.model.body_parentid[own] not in bodies:
                most = max(most, -float(contact.dist))
    return most
