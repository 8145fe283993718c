"""Cuts leave the kept frames unchanged, mirrors are reflections, and seams are continuous in position and velocity."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made_trajectories import swing, wander

from robot_retarget.edit import joined, mirrored, repeated, trimmed
from robot_retarget.errors import TrajectoryError, UsageError
from robot_retarget.keypoints import mirrored as other_side
from robot_retarget.robot import load_robot, recognise, world_points
from robot_retarget.robot.kinematics import difference

OP3 = load_robot("op3")
WANDER = wander(OP3, frames=60)
SWING = swing(OP3, "l_sho_roll", 0.3, 1.0, 1.0, fps=50)


def steps(qpos: np.ndarray) -> np.ndarray:
    """(T − 1, nv) from frame to frame."""
    return np.array([difference(OP3, a, b) for a, b in itertools.pairwise(qpos)])


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


@settings(max_examples=10, deadline=None)
@given(st.floats(0.1, 1.0), st.integers(2, 50))
def test_a_seam_goes_on_in_place_and_speed(seam: float, cut: int) -> None:
    """The step over the seam is the step before it, whatever comes after."""
    first = trimmed(WANDER, 0, cut / 50)
    whole = joined([first, SWING], OP3, seam)
    assert len(whole) == len(first) + len(SWING)
    np.testing.assert_array_equal(whole.qpos[: len(first)], first.qpos)
    moves = steps(whole.qpos)
    at = len(first) - 1
    np.testing.assert_allclose(moves[at], moves[at - 1], atol=1e-9)


def test_what_follows_is_itself_after_the_seam_but_for_where_it_is() -> None:
    whole = joined([WANDER, SWING], OP3, 0.2)
    tail = slice(len(WANDER) + 11, None)
    np.testing.assert_allclose(whole.qpos[tail, OP3.qpos_index], SWING.qpos[11:, OP3.qpos_index], atol=1e-9)
    np.testing.assert_allclose(whole.qpos[tail, 2], SWING.qpos[11:, 2], atol=1e-9)


def test_a_walk_walks_on() -> None:
    """Its root goes on by the same way every time, along where it then faces."""
    ahead = WANDER.qpos.copy()
    ahead[:, 3:7] = [1, 0, 0, 0]
    ahead[:, :3] = [0, 0, 0.3]
    ahead[:, 0] = np.linspace(0, 0.59, 60)
    walk = repeated(type(WANDER)(ahead, 50, OP3.joint_names, OP3.name), OP3, 3)
    np.testing.assert_allclose(walk.qpos[:, 0], 0.01 * np.arange(180), atol=1e-6)


def test_joints_stay_within_their_ranges_at_a_seam() -> None:
    high, low = (swing(OP3, "l_sho_roll", a, 1.0, 0.5, fps=50) for a in (0.5, -0.5))
    made = joined([trimmed(high, 0, 0.25), low], OP3)
    hinges = made.qpos[:, OP3.qpos_index]
    bounds = (
        np.minimum(OP3.lower, low.qpos[:, OP3.qpos_index].min(0)),
        np.maximum(OP3.upper, high.qpos[:, OP3.qpos_index].max(0)),
    )
    assert (hinges >= bounds[0] - 1e-9).all() and (hinges <= bounds[1] + 1e-9).all()


def test_nothing_and_no_time_are_refused() -> None:
    with pytest.raises(UsageError, match="nothing to join"):
        joined([], OP3)
    with pytest.raises(UsageError, match="above 0 s"):
        joined([SWING, SWING], OP3, 0.0)
    with pytest.raises(UsageError, match="at least once"):
        repeated(SWING, OP3, 0)
    other = type(SWING)(SWING.qpos, 50, tuple(f"x{n}" for n in SWING.joint_names), "x")
    with pytest.raises(TrajectoryError, match="joint 0"):
        mirrored(other, OP3)
