"""Ways into a stand: the motion comes to rest along its path, and a branch begins where the playback stands."""

import numpy as np
import pytest
from made_trajectories import hold, wander
from scipy.spatial.transform import Rotation

import robot_retarget as rr
from robot_retarget.base.errors import TrajectoryError
from robot_retarget.edit.cuts import TO_REST, coming_to_rest, placed_by_foot, ways_into_stand
from robot_retarget.robot import recognise, world_points

OP3 = rr.load_robot("op3")


@pytest.mark.parametrize("fps", [30.0, 100.0])
def test_the_motion_slows_down_evenly_from_its_own_pace_to_rest(fps: float) -> None:
    frames = coming_to_rest(40, 10, fps)
    np.testing.assert_allclose(frames[:11], np.arange(30, 41))
    steps = np.diff(frames[10:])
    assert steps[0] == pytest.approx(1, abs=1 / (TO_REST * fps)) and 0 < steps[-1] < 1.5 / (TO_REST * fps)
    np.testing.assert_allclose(np.diff(steps), np.diff(steps)[0], atol=1e-9)
    assert frames[-1] == pytest.approx(40 + TO_REST * fps / 2)


def test_a_branch_is_placed_by_the_lower_foot() -> None:
    """Turned and moved along the floor, it comes back, also where its trunk leans otherwise."""
    qpos = wander(OP3, frames=5).qpos.copy()
    qpos[:, OP3.qpos_index] = OP3.standing()[OP3.qpos_index]
    qpos[:, 3:7] = [1, 0, 0, 0]
    start, spin = qpos[0].copy(), Rotation.from_euler("z", 1.1)
    moved = qpos.copy()
    moved[:, :3] = qpos[:, :3] @ spin.as_matrix().T + [0.4, -0.2, 0.0]
    moved[:, 3:7] = spin.as_quat(scalar_first=True)
    np.testing.assert_allclose(placed_by_foot(moved, start, OP3), qpos, atol=1e-9)
    moved[:, OP3.qpos_index[OP3.joint_names.index("l_sho_pitch")]] += 0.3
    placed = placed_by_foot(moved, start, OP3)
    for sole in recognise(OP3).treads.values():
        there, here = world_points(OP3, sole, np.array([placed[0], start]))
        np.testing.assert_allclose(there, here, atol=1e-9)


def test_only_judged_playbacks_with_balance_have_ways() -> None:
    still = hold(OP3)
    with pytest.raises(TrajectoryError, match="was not planned with balance"):
        next(ways_into_stand(still, OP3))
    with pytest.raises(TrajectoryError, match="has no goals: simulate it first"):
        next(ways_into_stand(still.altered(balance="static"), OP3))
