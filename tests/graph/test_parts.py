"""A part of a clip has the up axis, the map, the floor and the contacts of the whole."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shared_files import SHARED, needs_shared

from robot_retarget.graph.describe import describe
from robot_retarget.human.features import features_of
from robot_retarget.human.match import Match, match
from robot_retarget.human.motion import Motion
from robot_retarget.human.read import read_motion
from robot_retarget.robot import load_robot

FOLDER = SHARED / "motions" / "bvh"
CLIPS = (
    "lafan1_procedural/fall_getup_procedural",
    "lafan1_procedural/backflip_procedural",
    "mixamo/test_freebvh_walk",
    "makehuman_zup/mh_zombieWalk1",
    "fair1_zup/jumping",
)
share = st.floats(0, 1)


@cache
def clip_of(name: str) -> tuple[Motion, Match]:
    motion = read_motion(FOLDER / f"{name}.bvh")
    return motion, match(motion, load_robot("op3"))


@needs_shared
@pytest.mark.parametrize("name", CLIPS)
@settings(max_examples=6, deadline=None)
@given(begin=share, length=share)
def test_any_part_is_described_as_in_the_whole(name: str, begin: float, length: float) -> None:
    whole, matched = clip_of(name)
    first = round(begin * (len(whole) - 1))
    last = first + 1 + round(length * (len(whole) - 1 - first))
    part = whole.frames(first, last)
    assert match(part, load_robot("op3")).recognition == matched.recognition
    here, there = features_of(part, match(part, load_robot("op3"))), features_of(whole, matched).at(slice(first, last))
    assert here.positions == pytest.approx(there.positions, abs=1e-12)
    assert here.segments.keys() == there.segments.keys()
    assert all(here.segments[k] == pytest.approx(there.segments[k], abs=1e-12) for k in here.segments)
    assert (here.contacts.down == there.contacts.down).all() and (here.contacts.stands == there.contacts.stands).all()
    assert here.ankle_height == there.ankle_height


@needs_shared
@settings(max_examples=8, deadline=None)
@given(begin=share, fps=st.sampled_from([20.0, 24.0, 30.0, 60.0, 90.0]))
def test_a_part_at_another_rate_has_its_own_frames_and_stays_a_part(begin: float, fps: float) -> None:
    whole, _ = clip_of("fair1_zup/jumping")
    first = round(begin * (len(whole) - 60))
    part = whole.frames(first, first + 60)
    alone = replace(part, whole=None)
    here, there = part.resample(fps), alone.resample(fps)
    assert len(here) == len(there)
    assert here.positions[:-1] == pytest.approx(there.positions[:-1], abs=1e-9)
    assert len(here.clip) > len(here)


@needs_shared
def test_a_part_of_a_part_is_cut_from_the_whole_and_one_that_was_changed_is_none() -> None:
    whole, _ = clip_of(CLIPS[0])
    part = whole.frames(30, 90).frames(10, 20)
    assert part.clip is whole
    assert part.span == slice(40, 50)
    assert replace(part, positions=part.positions + 1.0).whole is None


@needs_shared
def test_a_jump_cut_from_its_flight_stays_off_the_floor() -> None:
    """The pelvis goes as high over the floor as in the whole clip, where feet were seen on it."""
    whole, robot = read_motion(FOLDER / "lafan1_procedural" / "backflip_procedural.bvh"), load_robot("op3")
    height = describe(whole, robot).pelvis[:, 2]
    top = int(np.argmax(height))
    part = describe(whole.frames(top - 3, top + 4), robot).pelvis[:, 2]
    assert part == pytest.approx(height[top - 3 : top + 4], abs=1e-9)
