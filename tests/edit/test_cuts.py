"""Cuts leave the kept frames unchanged, and mirrors are reflections."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made_trajectories import wander

from robot_retarget.base.errors import TrajectoryError, UsageError
from robot_retarget.base.keypoints import mirrored as other_side
from robot_retarget.edit.cuts import mirrored, trimmed
from robot_retarget.robot import load_robot, recognise, world_points
from robot_retarget.robot.kinematics import difference

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
