"""Cuts leave the kept frames unchanged, and mirrors are reflections."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made_trajectories import wander

from robot_retarget.base.errors import TrajectoryError, UsageError
from robot_retarget.base.files import SAMPLES
from robot_retarget.base.keypoints import mirrored as other_side
from robot_retarget.edit.cuts import between_stands, mirrored, trimmed
from robot_retarget.human.read import read_motion
from robot_retarget.robot import load_robot, recognise, world_points
from robot_retarget.robot.kinematics import difference
from robot_retarget.solver.pipeline import retarget
from robot_retarget.trajectory import Trajectory

OP3 = load_robot("op3")
WANDER = wander(OP3, frames=60)


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 59), st.integers(0, 59))
def test_a_trimmed_trajectory_is_its_frames(first: int, last: int) -> None:
    first, last = min(first, last), max(first, last)
    kept = trimmed(WANDER, first / 50, last / 50)
    np.testing.assert_array_equal(kept.qpos, WANDER.qpos[first : last + 1])
    np.testing.assert_array_equal(kept.source_time, WANDER.source_time[first : last + 1])


@pytest.mark.parametrize("span", [(1.0, 0.5), (-0.1, 0.5), (0.0, 99.0)])
def test_times_beyond_the_trajectory_are_refused(span: tuple[float, float]) -> None:
    with pytest.raises(UsageError, match="not within"):
        trimmed(WANDER, *span)


def test_keypoints_of_the_mirrored_robot_are_reflected_and_swap_sides() -> None:
    """By forward kinematics: the reflection goes through the first root place, across its left."""
    anatomy = recognise(OP3)
    names = anatomy.names
    here = world_points(OP3, anatomy.points, WANDER.qpos)
    there = world_points(OP3, anatomy.points, mirrored(WANDER, OP3).qpos)
    swapped = there[:, [names.index(other_side(name)) for name in names]]
    root, left = WANDER.qpos[0, :3], np.array([0.0, 1.0, 0.0])  # it begins facing x
    expected = here - 2 * ((here - root) @ left)[..., None] * left
    np.testing.assert_allclose(swapped, expected, atol=2e-3)


def test_the_mirror_image_of_the_mirror_image_is_the_trajectory() -> None:
    twice = mirrored(mirrored(WANDER, OP3), OP3)
    assert np.abs([difference(OP3, b, a) for a, b in zip(twice.qpos, WANDER.qpos, strict=True)]).max() < 1e-6


def test_a_trajectory_of_another_robot_is_not_mirrored() -> None:
    other = type(WANDER)(WANDER.qpos, 50, tuple(f"x{n}" for n in WANDER.joint_names), "x")
    with pytest.raises(TrajectoryError, match="joint 0"):
        mirrored(other, OP3)


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
