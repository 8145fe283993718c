"""The shipped sample clips: what the script makes, and each the motion its name says."""

import os
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from shared_files import ROOT

from robot_retarget.base.files import SAMPLES
from robot_retarget.base.keypoints import KEYPOINTS
from robot_retarget.human.motion import Motion
from robot_retarget.human.read import read_motion
from robot_retarget.human.recognition import recognise
from robot_retarget.human.skeleton import backward
from robot_retarget.papers.skeletal import table_one_body

CLIPS = ("wave", "clap", "hips_and_bow", "squat", "walk")
STANDING_CLIPS = CLIPS[:-1]
SIDES = ("Left", "Right")
BALL_HEIGHT = 0.02
"""Of the toe joint above the sole [m]."""
HALF_A_STRIDE = 18
"""Of the walk [frames]."""
STEADY = slice(round(1.5 * 30), round(4.2 * 30))
"""Frames of the walk at its full pace, half a stride before its end."""


@pytest.fixture(scope="module")
def clips() -> dict[str, Motion]:
    return {name: read_motion(SAMPLES / f"{name}.bvh") for name in CLIPS}


@pytest.fixture(scope="module")
def made(tmp_path_factory) -> list[Path]:
    folders = [tmp_path_factory.mktemp("made"), tmp_path_factory.mktemp("again")]
    for folder in folders:
        script = [sys.executable, str(ROOT / "scripts" / "tools" / "make_samples.py"), "--out", str(folder)]
        subprocess.run(script, check=True, capture_output=True, cwd=ROOT, env=os.environ | {"PYTHONPATH": str(ROOT)})
    return folders


def at(motion: Motion, joint: str) -> np.ndarray:
    """The joint's positions (T, 3)."""
    return motion.positions[:, motion.skeleton.names.index(joint)]


def gap(motion: Motion, one: str, other: str) -> np.ndarray:
    return np.linalg.norm(at(motion, one) - at(motion, other), axis=1)


def bend(motion: Motion, above: str, joint: str, below: str) -> np.ndarray:
    """How far a limb is from straight at a joint, (T,) [deg]."""
    upper, lower = at(motion, joint) - at(motion, above), at(motion, below) - at(motion, joint)
    cosine = np.sum(upper * lower, axis=1) / np.linalg.norm(upper, axis=1) / np.linalg.norm(lower, axis=1)
    return np.degrees(np.arccos(np.clip(cosine, -1, 1)))


def speed(motion: Motion, joint: str) -> np.ndarray:
    return np.linalg.norm(np.diff(at(motion, joint), axis=0), axis=1) * motion.fps


def mirrored(motion: Motion) -> np.ndarray:
    """The positions (T, J, 3) of the same motion seen in a mirror through x and z."""
    names = motion.skeleton.names
    swap = {"Left": "Right", "Right": "Left"}
    other = [names.index(next((swap[s] + n[len(s) :] for s in SIDES if n.startswith(s)), n)) for n in names]
    return motion.positions[:, other] * (1, -1, 1)


def test_the_script_makes_the_same_bytes_twice(made):
    once, again = ({path.name: path.read_bytes() for path in folder.iterdir()} for folder in made)
    assert once == again
    assert sorted(once) == sorted(f"{name}.bvh" for name in CLIPS)


@pytest.mark.parametrize("name", CLIPS)
def test_the_shipped_clip_is_what_the_script_makes(made, name):
    # As numbers: with the processor's own sine and cosine the last printed digit may turn, and half a turn its sign.
    (head, rows), (made_head, made_rows) = (
        (SAMPLES / f"{name}.bvh").read_text().split("Frame Time"),
        (made[0] / f"{name}.bvh").read_text().split("Frame Time"),
    )
    assert head == made_head
    values, made_values = (np.array(text.replace(":", "0").split(), dtype=float) for text in (rows, made_rows))
    turned = np.abs(values - made_values)
    assert np.minimum(turned, np.abs(turned - 360)).max() <= 2e-6


def test_samples_are_small(clips):
    assert {path.stem for path in SAMPLES.glob("*.bvh")} >= set(clips)
    assert all((SAMPLES / f"{name}.bvh").stat().st_size <= 300_000 for name in clips)


@pytest.mark.parametrize("name", CLIPS)
def test_clips_last_four_to_ten_seconds(clips, name):
    assert 4 <= clips[name].duration <= 10
    assert clips[name].fps == pytest.approx(30)


@pytest.mark.parametrize("name", CLIPS)
def test_bones_are_those_of_table_one_throughout(clips, name):
    motion, table = clips[name], table_one_body()
    lengths = np.linalg.norm(motion.positions[:, 1:] - motion.positions[:, motion.skeleton.parents[1:]], axis=2)
    assert np.ptp(lengths, axis=0).max() < 1e-6
    bones = [not joint.endswith("_end") for joint in motion.skeleton.names[1:]]
    np.testing.assert_allclose(np.sort(lengths[0, bones]), np.sort(table.lengths[1:]), atol=1e-5)


@pytest.mark.parametrize("name", CLIPS)
def test_every_keypoint_is_recognised(clips, name):
    found = recognise(clips[name].skeleton, clips[name].positions)
    assert set(found.keypoints) == set(KEYPOINTS)
    assert clips[name].skeleton.names[found.marks["l_hand"].joints[0]] == "LeftWrist"


@pytest.mark.parametrize("name", CLIPS)
def test_the_lowest_point_is_on_the_ground(clips, name):
    lowest = clips[name].positions[..., 2].min(axis=1)
    assert lowest.min() > -0.001
    assert lowest.max() < BALL_HEIGHT + 0.001


@pytest.mark.parametrize("name", CLIPS)
def test_clips_start_and_end_standing_still(clips, name):
    motion = clips[name]
    for end in (slice(0, 5), slice(-5, None)):
        assert np.ptp(motion.positions[end], axis=0).max() < 1e-3
    hips = at(motion, "Hips")
    assert hips[0, 2] == pytest.approx(hips[-1, 2], abs=1e-3)
    assert all(bend(motion, f"{side}Hip", f"{side}Knee", f"{side}Ankle")[[0, -1]].max() < 12 for side in SIDES)


@pytest.mark.parametrize("name", CLIPS)
def test_joints_turn_no_faster_than_people_turn_them(clips, name):
    motion = clips[name]
    assert motion.rotations is not None
    _, local = backward(motion.skeleton.parents, motion.positions, motion.rotations)
    for joint, quaternions in zip(motion.skeleton.names, np.swapaxes(local, 0, 1), strict=True):
        turns = Rotation.from_quat(quaternions, scalar_first=True)
        assert (turns[:-1].inv() * turns[1:]).magnitude().max() * motion.fps < 9, joint
    assert max(speed(motion, joint).max() for joint in motion.skeleton.names) < 5


@pytest.mark.parametrize("name", CLIPS)
def test_arms_stay_out_of_the_trunk(clips, name):
    motion = clips[name]
    hips, chest = at(motion, "Hips"), at(motion, "Chest3")
    axis = chest - hips
    for joint in ("LeftElbow", "RightElbow", "LeftWrist", "RightWrist", "LeftWrist_end", "RightWrist_end"):
        along = np.clip(np.sum((at(motion, joint) - hips) * axis, axis=1) / np.sum(axis**2, axis=1), 0, 1)
        assert np.linalg.norm(at(motion, joint) - hips - along[:, None] * axis, axis=1).min() > 0.15, joint


@pytest.mark.parametrize("name", STANDING_CLIPS)
def test_planted_feet_do_not_move(clips, name):
    for joint in ("Ankle", "Toe", "Toe_end"):
        for side in SIDES:
            assert np.ptp(at(clips[name], side + joint), axis=0).max() < 0.001


@pytest.mark.parametrize("name", ("clap", "hips_and_bow", "squat"))
def test_both_sides_do_the_same(clips, name):
    np.testing.assert_allclose(clips[name].positions, mirrored(clips[name]), atol=1e-5)


def test_the_wave_raises_the_right_hand_beside_the_head_and_swings_it(clips):
    motion = clips["wave"]
    raised = at(motion, "RightWrist_end")[:, 2] > at(motion, "Head")[:, 2]
    assert 2 < raised.sum() / motion.fps < 4
    sideways = at(motion, "RightWrist_end")[raised, 1]
    turns = np.flatnonzero(np.diff(np.sign(np.diff(sideways))))
    assert len(turns) >= 7
    assert np.ptp(sideways) > 0.2
    assert np.ptp(at(motion, "LeftWrist") - at(motion, "Chest3"), axis=0).max() < 0.05


def test_the_hands_meet_six_times_in_front_of_the_chest(clips):
    motion = clips["clap"]
    knuckles = gap(motion, "LeftWrist_end", "RightWrist_end")
    meets = np.flatnonzero(
        (knuckles[1:-1] <= knuckles[:-2]) & (knuckles[1:-1] < knuckles[2:]) & (knuckles[1:-1] < 0.05)
    )
    assert len(meets) == 6
    middle = (at(motion, "LeftWrist") + at(motion, "RightWrist"))[meets + 1] / 2 - at(motion, "Chest3")[meets + 1]
    assert (middle[:, 0] > 0.2).all() and (np.abs(middle[:, 1]) < 0.01).all()
    assert knuckles.min() > 0.02
    assert all(knuckles[one:other].max() > 0.2 for one, other in pairwise(meets))


def test_the_palms_face_each_other_when_they_meet(clips):
    motion = clips["clap"]
    assert motion.rotations is not None
    frame = int(gap(motion, "LeftWrist_end", "RightWrist_end").argmin())
    palms = [
        Rotation.from_quat(
            motion.rotations[frame, motion.skeleton.names.index(f"{side}Wrist")], scalar_first=True
        ).apply([0, 0, -1])
        for side in SIDES
    ]
    assert palms[0] @ palms[1] < -0.95
    assert palms[0][1] < -0.95


def test_hands_stay_on_the_hips_through_the_bow(clips):
    motion = clips["hips_and_bow"]
    lean = at(motion, "Chest3") - at(motion, "Hips")
    tilt = np.degrees(np.arctan2(lean[:, 0], lean[:, 2]))
    assert tilt.max() > 40
    bowed = tilt > 5
    for side in SIDES:
        assert gap(motion, f"{side}Wrist_end", "Hips")[bowed].max() < 0.2
        assert np.ptp(gap(motion, f"{side}Wrist", "Hips")[bowed]) < 1e-3
        assert bend(motion, f"{side}Shoulder", f"{side}Elbow", f"{side}Wrist")[bowed].min() > 60


def test_the_squat_bends_the_knees_twice_and_keeps_its_balance(clips):
    motion = clips["squat"]
    knees = bend(motion, "LeftHip", "LeftKnee", "LeftAnkle")
    low = knees > 90
    assert np.count_nonzero(np.diff(low.astype(int)) == 1) == 2
    assert 100 < knees.max() < 130
    deepest = int(knees.argmax())
    reach = at(motion, "LeftWrist")[deepest] - at(motion, "LeftShoulder")[deepest]
    assert reach[0] > 0.45 and abs(reach[2]) < 0.12


def test_the_walk_goes_straight_ahead(clips):
    hips = at(clips["walk"], "Hips")
    travel = hips[-1] - hips[0]
    assert travel[0] > 3.5
    assert abs(travel[1]) < 1e-3
    assert np.diff(hips[:, 0]).min() * 30 > -0.1
    assert np.abs(hips[:, 1]).max() < 0.04


def test_a_foot_that_stands_does_not_slide(clips):
    """While its ball is down, the toe joint of a foot rests; feet slide or hover in no frame."""
    motion, planted_frames = clips["walk"], 0
    for side in SIDES:
        ball, ankle = at(motion, f"{side}Toe"), at(motion, f"{side}Ankle")
        down = (ball[:, 2] < BALL_HEIGHT + 2e-4) & (ankle[:, 2] < 0.11)
        for stand in np.split(np.flatnonzero(down), np.flatnonzero(np.diff(np.flatnonzero(down)) > 1) + 1):
            if len(stand) > 5:
                planted_frames += len(stand)
                assert np.ptp(ball[stand], axis=0).max() < 0.001
    assert planted_frames > len(motion)


def test_one_foot_is_always_down(clips):
    motion = clips["walk"]
    heels_and_balls = [at(motion, f"{side}Toe")[:, 2] - BALL_HEIGHT for side in SIDES]
    assert np.min(heels_and_balls, axis=0).max() < 0.001


def test_the_right_side_does_what_the_left_does_half_a_stride_later(clips):
    motion = clips["walk"]
    own, other = (positions - positions[:, :1] * (1, 0, 0) for positions in (motion.positions, mirrored(motion)))
    later = slice(STEADY.start + HALF_A_STRIDE, STEADY.stop + HALF_A_STRIDE)
    np.testing.assert_allclose(other[later], own[STEADY], atol=1e-4)
    assert np.abs(other[STEADY] - own[STEADY]).max() > 0.5


def test_the_walk_bends_its_knees_as_tabulated(clips):
    """Peaks of [Winter1991]: 65° in swing, about 20° after heel strike; nearly straight between."""
    motion = clips["walk"]
    for side in SIDES:
        knee = bend(motion, f"{side}Hip", f"{side}Knee", f"{side}Ankle")[STEADY]
        assert 60 < knee.max() < 70
        assert 4 < knee.min() < 10
