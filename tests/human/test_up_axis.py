"""The up axis is inferred from all evidence, and an ambiguous one is reported."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from bodies import BODIES, body
from clip_joints import CLIPS
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from shared_files import SHARED, needs_shared

from robot_retarget.base.errors import MotionError, UsageError
from robot_retarget.human.capture import Capture
from robot_retarget.human.read import read_motion
from robot_retarget.human.readers.bvh import read_bvh
from robot_retarget.human.upright import signed_axis, upright

FALL = SHARED / "motions" / "bvh" / "lafan1_procedural" / "fall_getup_procedural.bvh"
AIRBORNE = 0.1
"""Above the floor of the whole clip [m]."""


@lru_cache(maxsize=1)
def whole_clip(clip: str) -> tuple[Capture, np.ndarray]:
    """A clip, and the heights of its joints (T, J) [m]."""
    capture = read_bvh(SHARED / "motions" / "bvh" / f"{clip}.bvh")
    return capture, upright(capture).positions[..., 2]


@needs_shared
@pytest.mark.parametrize("clip", CLIPS)
@settings(max_examples=3, deadline=None)
@given(share=st.floats(0, 1), seconds=st.floats(0.1, 2))
def test_a_window_on_the_floor_has_the_up_axis_of_the_whole_or_says_its_doubt(clip, share, seconds):
    """A body that tumbles in the air through the whole window shows neither a floor nor a posture: it may be taken wrong."""
    capture, whole = whole_clip(clip)
    first = len(capture.positions) - len(whole)
    count = min(max(1, round(seconds * capture.fps)), len(capture.positions) - first)
    start = first + round(share * (len(capture.positions) - first - count))
    assume(whole[start - first : start - first + count].min() < whole.min() + AIRBORNE)
    rotations = None if capture.rotations is None else capture.rotations[start : start + count]
    try:
        notes = upright(replace(capture, positions=capture.positions[start : start + count], rotations=rotations)).notes
    except MotionError as error:
        assert "--up" in str(error)
        return
    turned = any("has +y up" in note for note in notes)
    assert turned == (CLIPS[clip][4] == "+y") or any("not sure" in note for note in notes)


@needs_shared
@pytest.mark.parametrize("start", range(40, 130, 10))
def test_who_lies_through_the_whole_window_lies(start):
    """The head is no leg higher than the feet in any frame of it: nothing stands up."""
    capture = read_bvh(FALL)
    assert capture.rotations is not None
    lying = replace(
        capture, positions=capture.positions[start : start + 15], rotations=capture.rotations[start : start + 15]
    )
    whole, part = upright(capture), upright(lying)
    assert part.positions == pytest.approx(whole.positions[start : start + 15], abs=1e-9)


def leaning_capture(degrees: float) -> Capture:
    """A person far from the origin, by so much between y (0) and z (90) of the file; without a rest pose."""
    skeleton, pose, _ = body(*BODIES["plain"])
    lean = Rotation.from_euler("x", degrees - 90, degrees=True).as_matrix()
    return Capture(skeleton, pose @ lean.T + [9.0, 9.0, 9.0], None, 30.0, "leaning")


def test_a_small_lead_is_said_with_what_to_say():
    (note,) = [note for note in upright(leaning_capture(45)).notes if "not sure" in note]
    assert "+y points up" in note
    assert "say --up +z" in note


def test_no_lead_is_an_error():
    """Somewhere between a small lead of one axis and one of the other there is none."""
    with pytest.raises(MotionError, match=r"the poses do not decide whether .[yz] or .[yz] points up .*--up"):
        for degrees in np.arange(45, 60, 0.5):
            upright(leaning_capture(degrees))


@pytest.mark.parametrize(("told", "axis"), [("z", "+z"), ("-y", "-y"), ("+X", "+x")])
def test_what_a_user_says_of_the_up_axis_is_done(told, axis):
    capture = leaning_capture(0.0)
    signed = np.eye(3)["xyz".index(axis[1])] * (1 if axis[0] == "+" else -1)
    assert upright(capture, told).positions[0, :, 2] == pytest.approx(capture.positions[0] @ signed)


def test_no_axis_is_refused_with_the_known_ones():
    with pytest.raises(UsageError, match=r"no axis 'w'; known: \+x, \+y"):
        signed_axis("w")


@needs_shared
def test_reading_takes_the_axis_that_is_told():
    assert read_motion(FALL, up="y").positions == pytest.approx(read_motion(FALL).positions)
    assert read_motion(FALL, up="-y").positions[..., 2] == pytest.approx(-read_motion(FALL).positions[..., 2])
