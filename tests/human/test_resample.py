"""Another frame rate is the same motion."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from test_bvh_write import random_motion

from robot_retarget.base.errors import UsageError
from robot_retarget.contact.record import labelled
from robot_retarget.human.motion import Motion, at_frames
from robot_retarget.human.skeleton import Skeleton


def swing(frames: int, fps: float) -> Motion:
    """A pendulum of 1 m that turns by 90° per second about y, its pivot moving by 2 m/s along x."""
    times = np.arange(frames) / fps
    turn = Rotation.from_euler("y", 90 * times[:, None], degrees=True)
    pivot = np.stack([2 * times, 0 * times, 0 * times], axis=1)
    positions = np.stack([pivot, pivot + turn.apply([0, 0, -1])], axis=1)
    rotations = np.repeat(turn.as_quat(scalar_first=True)[:, None], 2, axis=1)
    return Motion(
        Skeleton(("pivot", "bob"), np.array([-1, 0]), np.array([[0, 0, 0], [0, 0, -1.0]])), positions, rotations, fps
    )


@pytest.mark.parametrize(("old", "new"), [(10, 30), (30, 240), (120, 30), (30, 29.97), (60, 24)])
def test_constant_turning_and_travelling_are_met_exactly(old, new):
    motion = swing(int(3 * old) + 1, old).resample(new)
    times = np.minimum(np.arange(len(motion)) / new, 3.0)
    angle = np.radians(90 * times)
    expected = np.stack([2 * times - np.sin(angle), 0 * times, -np.cos(angle)], axis=1)
    assert motion.positions[:, 1] == pytest.approx(expected, abs=1e-9)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 9), st.integers(1, 20), st.floats(10, 240))
def test_bones_keep_their_lengths_and_the_clip_its_duration(seed, joints, frames, fps):
    motion = random_motion(seed, joints, frames, False)
    again = motion.resample(fps)
    assert again.fps == fps
    assert abs(again.duration - motion.duration) <= (0.5 if len(again) > 2 else 1) / fps
    below = motion.skeleton.parents >= 0
    bones = again.positions - again.positions[:, motion.skeleton.parents]
    wanted = np.linalg.norm(motion.skeleton.offsets, axis=1)[None, below]
    assert np.linalg.norm(bones, axis=2)[:, below] == pytest.approx(np.repeat(wanted, len(again), axis=0), abs=1e-9)
    assert again.positions[0] == pytest.approx(motion.positions[0], abs=1e-9)


def test_positions_alone_are_interpolated_on_straight_lines():
    positions = np.array([[[0, 0, 0]], [[1, 2, 3]], [[1, 0, 0]]], dtype=float)
    motion = Motion(Skeleton(("a",), np.array([-1]), np.zeros((1, 3))), positions, None, 10.0)
    assert motion.resample(20).positions[:, 0] == pytest.approx(
        np.array([[0, 0, 0], [0.5, 1, 1.5], [1, 2, 3], [1, 1, 1.5], [1, 0, 0]])
    )


def test_the_same_rate_changes_nothing_and_one_frame_stays_one():
    motion = random_motion(3, 5, 8, True)
    assert np.array_equal(motion.resample(motion.fps).positions, motion.positions)
    assert len(random_motion(3, 5, 1, True).resample(120)) == 1


@pytest.mark.parametrize("fps", [0, -30, float("nan"), float("inf"), 1e6])
def test_a_rate_that_makes_no_sense_is_refused(fps):
    with pytest.raises(UsageError, match="frames per second must be from 1 to 1000"):
        random_motion(0, 2, 3, False).resample(fps)


def test_contacts_between_frames_are_those_of_the_nearest() -> None:
    motion = replace(swing(4, 10), contacts=labelled(np.array([0, 1, 0, 1], dtype=bool)[:, None].repeat(4, axis=1)))
    at = np.array([-3.0, 0.4, 0.6, 1.4, 1.6, 2.4, 2.6, 9.0])
    found = at_frames(motion, at, 10).contacts
    assert found is not None and found.down[:, 0].tolist() == [False, False, True, True, False, False, True, True]
