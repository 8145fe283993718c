"""Metres and z up come from the body, whatever the file's unit and axes."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from clip_joints import CALIBRATED, CLIPS, STRANGERS
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from shared_files import SHARED, needs_shared

from robot_retarget.base.errors import MotionError, UsageError
from robot_retarget.human.capture import Capture
from robot_retarget.human.motion import Motion
from robot_retarget.human.read import read_motion
from robot_retarget.human.readers.bvh import read_bvh
from robot_retarget.human.recognition import recognise
from robot_retarget.human.recognition.recognise import leg_length, stature
from robot_retarget.human.upright import AXES, UNITS, turn_to_z, upright

VARIED = (
    "cmu_cgspeed_motionbuilder/05_06_dance",
    "lafan1_procedural/fall_getup_procedural",
    "lafan1_procedural/backflip_procedural",
    "soma30_derived/soma30_pick_up_from_ground",
    "makehuman_zup/mh_dance1_1frame",
)


@cache
def capture_of(clip: str) -> Capture:
    return read_bvh(SHARED / "motions" / "bvh" / f"{clip}.bvh")


@cache
def motion_of(clip: str) -> Motion:
    return read_motion(SHARED / "motions" / "bvh" / f"{clip}.bvh")


def metres_per_unit(clip: str) -> float:
    """How much larger a bone is in the file than in the motion."""
    capture, motion = capture_of(clip), motion_of(clip)
    sizes = [np.linalg.norm(offsets, axis=1).max() for offsets in (motion.skeleton.offsets, capture.skeleton.offsets)]
    return float(sizes[0] / sizes[1])


@needs_shared
@pytest.mark.parametrize("clip", CLIPS)
def test_the_unit_is_the_known_one_and_the_stature_that_of_a_person(clip):
    motion, unit = motion_of(clip), CLIPS[clip][3]
    if unit is not None:
        assert metres_per_unit(clip) == pytest.approx(unit, rel=2e-3)
    assert 1.4 < stature(recognise(motion.skeleton, motion.positions), motion.positions) < 2.0


@needs_shared
@pytest.mark.parametrize("clip", CLIPS)
def test_the_body_stands_on_z_and_the_world_is_only_turned(clip):
    """The turn is read off the points: a proper rotation that sends the clip's up axis to z."""
    capture, motion = capture_of(clip), upright(capture_of(clip), repair=False)
    first = len(capture.positions) - len(motion)
    scale = metres_per_unit(clip)
    up = np.eye(3)["xyz".index(CLIPS[clip][4][1])]
    turn = {"+y": np.array([[0, 0, 1], [1, 0, 0], [0, 1, 0]]), "+z": np.eye(3)}[CLIPS[clip][4]]
    assert turn @ up == pytest.approx([0, 0, 1])
    assert motion.positions == pytest.approx(scale * capture.positions[first:] @ turn.T, abs=1e-9)


@needs_shared
@pytest.mark.parametrize("clip", CLIPS)
def test_calibration_frames_are_dropped_and_no_others(clip):
    dropped = len(capture_of(clip).positions) - len(motion_of(clip))
    said = any("calibration" in note for note in motion_of(clip).notes)
    assert (dropped, said) == ((1, True) if clip in CALIBRATED else (0, False))


@needs_shared
@settings(max_examples=15, deadline=None)
@given(
    clip=st.sampled_from(VARIED),
    axis=st.sampled_from(AXES),
    unit=st.sampled_from(list(UNITS.values())),
    quarter=st.integers(0, 3),
)
def test_any_axis_and_unit_give_the_same_body(clip, axis, unit, quarter):
    motion = motion_of(clip)
    undo = np.linalg.inv(turn_to_z(axis)) @ Rotation.from_euler("z", 90 * quarter, degrees=True).as_matrix()
    assert motion.rotations is not None
    skeleton = replace(motion.skeleton, offsets=motion.skeleton.offsets @ undo.T / unit)
    turned = replace(
        capture_of(clip),
        skeleton=skeleton,
        positions=motion.positions @ undo.T / unit,
        rotations=motion.rotations,
        notes=(),
        fps=motion.fps,
    )
    again = upright(turned)
    heights = [m.positions[..., 2] for m in (again, motion)]
    assert heights[0] == pytest.approx(heights[1], abs=1e-9)


@pytest.mark.parametrize("axis", AXES)
def test_every_turn_is_proper_and_lifts_its_axis_to_z(axis):
    turn = turn_to_z(axis)
    signed = np.eye(3)["xyz".index(axis[1])] * (1 if axis[0] == "+" else -1)
    assert turn @ signed == pytest.approx([0, 0, 1])
    assert np.linalg.det(turn) == pytest.approx(1)
    if axis == "+y":
        assert turn @ [1, 2, 3] == pytest.approx([3, 1, 2])


@needs_shared
@pytest.mark.parametrize("clip", ["mixamo/test_freebvh_walk", "fair1_zup/dab", "xsens_mvn/BVH2SMPL_Sit54"])
def test_rotations_turn_along_with_the_bones(clip):
    """x_child = x_parent + R_parent offset still holds in metres and z up."""
    motion = motion_of(clip)
    assert motion.rotations is not None
    for joint, parent in enumerate(motion.skeleton.parents):
        if parent >= 0:
            turn = Rotation.from_quat(motion.rotations[:, parent], scalar_first=True)
            expected = motion.positions[:, parent] + turn.apply(motion.skeleton.offsets[joint].copy())
            assert motion.positions[:, joint] == pytest.approx(expected, abs=1e-6)


@needs_shared
def test_a_body_of_no_known_unit_is_scaled_to_an_adult_leg():
    motion = motion_of("fair1_zup/dab")
    assert leg_length(recognise(motion.skeleton, motion.positions), motion.positions) == pytest.approx(0.83)
    assert any("No known unit" in note for note in motion.notes)


@needs_shared
@pytest.mark.parametrize("clip", STRANGERS)
def test_what_is_not_human_is_still_a_motion_that_says_so(clip):
    motion = motion_of(clip)
    assert motion.notes[-1].startswith("Not a human body")
    assert "y is used as up axis" in motion.notes[-1]


@needs_shared
def test_the_same_take_in_two_frame_counts_starts_alike():
    """A still start, however long, is no calibration."""
    clip = "biovision_classic/mocapbank_sit"
    capture = capture_of(clip)
    still = np.repeat(capture.positions[:1], 20, axis=0)
    longer = replace(capture, positions=np.concatenate([still, capture.positions]), rotations=None)
    assert len(upright(longer)) == len(capture.positions) + 20


@needs_shared
@pytest.mark.parametrize("count", [1, 2, 5])
def test_several_calibration_frames_are_dropped_together(count):
    clip = "lafan1_procedural/walk_procedural"
    capture = capture_of(clip)
    away = np.repeat(capture.positions[:1] + np.array([300, 0, 300]), count, axis=0)
    motion = upright(replace(capture, positions=np.concatenate([away, capture.positions]), rotations=None))
    assert len(motion) == len(capture.positions)


@needs_shared
def test_the_frame_rate_may_be_told():
    path = SHARED / "motions" / "bvh" / "lafan1_procedural" / "walk_procedural.bvh"
    motion = read_motion(path, fps=120)
    assert motion.fps == 120
    assert any("the file says 30" in note for note in motion.notes)
    with pytest.raises(UsageError, match="must be positive"):
        read_motion(path, fps=0)
    with pytest.raises(UsageError, match="joint names come from the file"):
        read_motion(path, names=["a"])


def test_a_file_that_may_not_be_read_is_refused(tmp_path):
    loop = tmp_path / "loop.bvh"
    loop.symlink_to(loop)
    with pytest.raises(MotionError, match="loop"):
        read_motion(loop)
