"""Defects of a capture are found with their frames, repaired where that is safe, and reported."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from shared_files import ROOT, SHARED, needs_shared

from robot_retarget.base.errors import MotionError
from robot_retarget.human.capture import Capture
from robot_retarget.human.defects import NoiseRule, ScrambleRule, clean_part, gaps, noise_of, smoothed
from robot_retarget.human.features import features_of
from robot_retarget.human.match import match
from robot_retarget.human.motion import at_frames
from robot_retarget.human.read import read_motion
from robot_retarget.human.readers.bvh import read_bvh
from robot_retarget.human.recognition import recognise
from robot_retarget.human.recognition.recognise import leg_length
from robot_retarget.human.upright import upright
from robot_retarget.robot import load_robot

pytestmark = needs_shared
FOLDER = SHARED / "motions" / "bvh"
CLEAN = (
    "lafan1_procedural/walk_procedural",
    "xsens_mvn/BVH2SMPL_Sit54",
    "lafan1_procedural/backflip_procedural",
    "fair1_zup/jumping",
)


def capture_of(clip: str) -> Capture:
    return read_bvh(FOLDER / f"{clip}.bvh")


def walk() -> tuple[Capture, float]:
    capture = capture_of(CLEAN[0])
    return capture, leg_length(recognise(capture.skeleton, capture.positions), capture.positions)


def walk_with_a_flying_hand(first: int, stop: int, far: float = 0.7) -> tuple[Capture, np.ndarray]:
    """The walk, and its positions with a forearm 0.7 of a leg off in some frames."""
    capture, leg = walk()
    names, x = capture.skeleton.names, capture.positions.copy()
    hand = [k for k in range(len(names)) if names.index("LeftForeArm") in capture.skeleton.above(k)]
    x[first:stop, hand] += far * leg * np.array([0.0, 1.0, 0.0])
    return capture, x


@pytest.mark.parametrize("clip", CLEAN)
def test_a_clean_clip_is_left_as_it_is(clip):
    capture = capture_of(clip)
    assert upright(capture).positions == pytest.approx(upright(capture, repair=False).positions, abs=1e-12)


@pytest.mark.parametrize("frames", [1, 5, 1000])
def test_a_jump_of_the_root_is_bridged_and_said_with_its_frame(frames):
    capture, leg = walk()
    x = capture.positions.copy()
    x[100 : 100 + frames] += leg * np.array([1.0, 0.3, -0.5])
    mended, whole = upright(replace(capture, positions=x)), upright(capture)
    steps = [np.linalg.norm(np.diff(m.positions, axis=0), axis=2).max() for m in (mended, whole)]
    assert steps[0] < 1.5 * steps[1]
    assert any("The body jumps" in n and "frame 100 (3.33 s)" in n and "bridged" in n for n in mended.notes)


@given(st.floats(0.05, 6.0), st.integers(1, 20), st.integers(1, 20))
def test_a_gap_ends_where_a_jump_half_to_twice_as_large_goes_back_no_later_than_the_longest(
    back: float, frames: int, longest: int
) -> None:
    assume(min(abs(back - 0.5), abs(back - 2.0)) > 1e-6)
    jumps, there = np.zeros((60, 3)), 10 + frames
    jumps[10, 0], jumps[there, 0] = 1.0, -back
    points = np.random.default_rng(0).normal(size=(61, 2, 3))  # a limb that never stands still
    closed = 0.5 < back < 2.0 and frames <= longest
    expected = (
        [(11, there, max(1.0, back), True)] if closed else [(11, 11, 1.0, False), (there + 1, there + 1, back, False)]
    )
    assert list(gaps(jumps, points, longest)) == expected


@pytest.mark.parametrize("far", [0.9, 1.1])
def test_a_limb_jumps_beyond_a_fifth_of_a_leg_and_17_g_and_the_body_beyond_a_tenth_and_5_g(far: float) -> None:
    limb, body = (share + acceleration / 30.0**2 for share, acceleration in ((0.2, 200.0), (0.1, 60.0)))
    capture, x = walk_with_a_flying_hand(60, 63, far * limb)
    x[100:, :, 1] += far * body * walk()[1]
    notes = " ".join(upright(replace(capture, positions=x, rotations=None)).notes)
    assert ("l_arm jumps at frame" in notes, "The body jumps at frame 100" in notes) == (far > 1, far > 1), notes


def test_a_limb_that_flies_for_as_long_as_a_gap_that_is_bridged_is_led_across():
    capture, x = walk_with_a_flying_hand(60, 69)
    mended, whole = (upright(replace(capture, positions=p, rotations=None)) for p in (x, capture.positions))
    assert np.abs(mended.positions - whole.positions).max() < 0.08
    assert any("l_arm jumps at frames 60–68 (2.00–2.27 s)" in note for note in mended.notes)


def test_a_limb_that_flies_for_longer_than_a_gap_that_is_bridged_is_said_and_left():
    capture, x = walk_with_a_flying_hand(60, 70)
    mended, raw = (upright(replace(capture, positions=x, rotations=None), repair=repair) for repair in (True, False))
    assert any("l_arm jumps at frame" in note and "--frames" in note for note in mended.notes)
    np.testing.assert_array_equal(mended.positions, raw.positions)


def test_a_pose_that_changes_as_a_whole_is_another_take_and_no_limb_is_led_across():
    capture, leg = walk()
    x = capture.positions.copy()
    x[60:63] += 0.7 * leg * np.random.default_rng(0).normal(size=(1, x.shape[1], 3))
    mended, raw = (upright(replace(capture, positions=x, rotations=None), repair=repair) for repair in (True, False))
    assert any("Another pose begins" in note and "frame" in note for note in mended.notes)
    assert not any("_arm jumps" in note or "_leg jumps" in note for note in mended.notes), mended.notes
    np.testing.assert_array_equal(mended.positions, raw.positions)


@pytest.mark.parametrize("most", [False, True])
def test_a_pose_changes_where_more_than_half_of_the_keypoints_jump(most: bool) -> None:
    capture, leg = walk()
    marks = recognise(capture.skeleton, capture.positions).marks
    ends = [k for k in marks if k.partition("_")[2] in ("elbow", "wrist", "hand", "knee", "ankle", "toe", "heel")]
    x, jumping = capture.positions.copy(), sorted(ends)[: len(marks) // 2 + most]
    for k, keypoint in enumerate(jumping):
        x[60:63, list(marks[keypoint].joints)] += 0.7 * leg * np.array([np.cos(k), np.sin(k), 0.0])
    notes = upright(replace(capture, positions=x, rotations=None)).notes
    assert len(jumping) == len(marks) // 2 + most
    assert any("Another pose begins" in note for note in notes) == most, notes
    assert any("_arm jumps" in note for note in notes) != most


def test_a_head_that_flies_is_led_across():
    capture, leg = walk()
    head = [k for k, name in enumerate(capture.skeleton.names) if name.startswith("Head")]
    x = capture.positions.copy()
    x[60, head] += 3.0 * leg
    mended, whole = (upright(replace(capture, positions=p, rotations=None)) for p in (x, capture.positions))
    assert np.abs(mended.positions - whole.positions).max() < 0.08
    assert any("head jumps at frame 60" in note for note in mended.notes)


@pytest.mark.parametrize("away", [30.0, 1e3])
def test_a_joint_that_is_nowhere_near_the_body_is_said(away):
    capture, leg = walk()
    x = capture.positions.copy()
    x[60, capture.skeleton.names.index("Head_end")] += away * leg
    assert any("Head_end tears at frame 60" in note for note in upright(replace(capture, positions=x)).notes)


def test_a_joint_that_is_farther_away_than_any_walk_is_refused():
    capture, leg = walk()
    x = capture.positions.copy()
    x[60, capture.skeleton.names.index("Head_end")] += 1e5 * leg
    with pytest.raises(MotionError, match=r"a joint is .* m from the origin, more than 10000 m"):
        upright(replace(capture, positions=x))


def largest_steps(motion) -> np.ndarray:
    """(K,) of every keypoint [m]."""
    x = recognise(motion.skeleton, motion.positions).place(motion.positions)
    return np.linalg.norm(np.diff(x, axis=0), axis=2).max(axis=0)


@pytest.mark.parametrize("frames", [1, 4, 1000])
def test_a_trunk_that_bends_at_once_is_no_jump_of_the_body(frames):
    """Shifting the whole body after it would throw the pelvis, which stood still, across the room."""
    capture, leg = walk()
    names = capture.skeleton.names
    upper = [k for k in range(len(names)) if names.index("Spine") in capture.skeleton.above(k)]
    x = capture.positions.copy()
    x[100 : 100 + frames, upper] += 0.6 * leg * np.array([0.6, 0.0, 0.8])
    broken = replace(capture, positions=x, rotations=None)
    mended, raw = upright(broken), upright(broken, repair=False)
    assert (largest_steps(mended) <= largest_steps(raw) + 1e-9).all()
    assert any("The body jumps" in note and "frame 100 (" in note and "less smooth" in note for note in mended.notes)


def test_without_repair_it_is_only_said():
    capture, leg = walk()
    x = capture.positions.copy()
    x[100:] += leg
    motion = upright(replace(capture, positions=x), repair=False)
    assert any("The body jumps" in note and "--no-repair" in note for note in motion.notes)
    assert np.linalg.norm(np.diff(motion.positions, axis=0), axis=2).max() > 1.0


def test_a_pose_held_before_the_motion_is_dropped_however_long():
    capture, leg = walk()
    held = np.repeat(capture.positions[:1] + leg * np.array([2.0, 0.0, 1.0]), 45, axis=0)
    motion = upright(replace(capture, positions=np.concatenate([held, capture.positions]), rotations=None))
    assert len(motion) == len(capture.positions)
    assert any("The first 45 frames (1.50 s) are one pose" in note for note in motion.notes)


@pytest.mark.parametrize("count", [1, 4, 45])
def test_a_pose_held_after_the_motion_is_dropped_however_long(count):
    capture, leg = walk()
    held = np.repeat(capture.positions[-1:] + leg * np.array([2.0, 0.0, 1.0]), count, axis=0)
    motion = upright(replace(capture, positions=np.concatenate([capture.positions, held]), rotations=None))
    assert motion.positions == pytest.approx(upright(replace(capture, rotations=None)).positions)
    assert any(note.startswith("The last") and note.endswith("dropped.") for note in motion.notes)


@pytest.mark.parametrize(("way", "kept"), [(1, r"--frames 4[0-2]: "), (-1, r"--frames :(198|199|200) ")])
def test_a_t_pose_that_leads_into_the_motion_or_out_of_it_is_said(way, kept):
    """Arms and legs laid out straight by hand, held for 40 frames, and led on in a second."""
    capture, leg = walk()
    found = recognise(capture.skeleton, capture.positions)
    x = capture.positions[:40].copy()
    x[:] = x[:1]
    for side, sign in (("l", 1), ("r", -1)):
        hip, shoulder = (x[0, found.marks[f"{side}_{part}"].joints[0]] for part in ("hip", "shoulder"))
        across = x[0, found.marks["l_hip"].joints[0]] - x[0, found.marks["r_hip"].joints[0]]
        across = sign * np.array([across[0], 0, across[2]]) / np.linalg.norm(across)
        for part, (start, step) in {
            "knee": (hip, [0, -leg / 2, 0]), "ankle": (hip, [0, -leg, 0]), "toe": (hip, [0, -leg, leg / 9]),
            "elbow": (shoulder, leg / 3 * across), "hand": (shoulder, leg / 1.6 * across),
        }.items():  # fmt: skip
            x[:, found.marks[f"{side}_{part}"].joints[0]] = start + np.array(step)
    share = np.linspace(0, 1, 30)[:, None, None]
    posed = np.concatenate([x, x[-1:] + share * (capture.positions[:1] - x[-1:]), capture.positions[:170]])
    notes = upright(replace(capture, positions=posed[::way], rotations=None)).notes
    assert any("in a T-pose" in note and re.search(kept, note) for note in notes)


def test_feet_that_skate_throughout_are_said_with_how_fast_and_when():
    capture = capture_of("mixamo/test_freebvh_walk")
    still = upright(capture)
    moved = np.arange(len(capture.positions))[:, None, None] / capture.fps * np.array([0.0, 0.0, -120.0])
    motion = upright(replace(capture, positions=capture.positions + moved))
    (note,) = [note for note in motion.notes if "The feet skate" in note]
    assert float(re.findall(r"at ([\d.]+) m/s", note)[0]) == pytest.approx(1.2, abs=0.15)
    assert not any("skate" in note for note in still.notes)


def test_a_body_that_rises_throughout_is_said_to_float():
    capture = capture_of("xsens_mvn/BVH2SMPL_Sit54")
    rise = np.arange(len(capture.positions))[:, None, None] / capture.fps * np.array([0.0, 10.0, 0.0])
    notes = upright(replace(capture, positions=capture.positions + rise, up="+y")).notes
    assert any(note.startswith("The body floats in") and "--terrain auto" in note for note in notes)
    assert not any("floats" in note for note in upright(capture).notes)


@pytest.mark.parametrize("size", [0.003, 0.01])
def test_noise_is_measured_as_it_was_made_and_taken_away(size):
    capture, _ = walk()
    x = capture.positions + np.random.default_rng(0).normal(0, 100 * size, capture.positions.shape)
    assert noise_of(x / 100, capture.fps, NoiseRule()) == pytest.approx(size, rel=0.25)
    motion = upright(replace(capture, positions=x, rotations=None))
    assert any("waver by" in note and "low pass of 6 Hz" in note for note in motion.notes)
    # White noise through a low pass of 6 of 15 Hz keeps less than two thirds of its deviation.
    assert np.std(motion.positions - upright(capture).positions) < 0.7 * size


def test_smoothing_keeps_bones_as_long_as_they_are():
    capture = capture_of("xsens_mvn/BVH2SMPL_Sit54").part(slice(1, None))
    parents = capture.skeleton.parents
    bones = [
        np.linalg.norm(c.positions[:, 1:] - c.positions[:, parents[1:]], axis=2)
        for c in (capture, smoothed(capture, NoiseRule()))
    ]
    assert bones[1] == pytest.approx(bones[0], abs=1e-6)


def test_keyframes_far_apart_are_said():
    capture, _ = walk()
    assert any("keyframes" in note for note in upright(replace(capture, fps=1.0)).notes)


def test_a_body_that_climbs_is_noted_with_height_and_time():
    capture, _ = walk()
    share = np.clip((np.linspace(0, 1, len(capture.positions)) - 0.4) / 0.2, 0, 1)
    steps = 60.0 * share[:, None, None] * np.array([0.0, 1.0, 0.0])
    notes = upright(replace(capture, positions=capture.positions + steps, rotations=None, up="+y")).notes
    (note,) = [note for note in notes if "change their height" in note]
    assert float(re.findall(r"by ([\d.]+) m", note)[0]) == pytest.approx(0.6, abs=0.08)
    assert not any("change their height" in note for note in upright(capture).notes)


def test_frames_whose_values_are_shifted_by_columns_are_refused_and_the_others_are_as_if_they_were_not_there(
    tmp_path: Path,
) -> None:
    lines = (ROOT / "samples" / "walk.bvh").read_text().splitlines()
    at = next(k for k, line in enumerate(lines) if line.strip() == "MOTION")
    head, rows = lines[: at + 3], [line.split() for line in lines[at + 3 :] if line.strip()][:60]
    own, shifted = rows[:41], [["0"] * 7 * (t - 40) + row for t, row in enumerate(rows[41:], 41)]
    for name, some in (("own", own), ("all", own + [row[: len(rows[0])] for row in shifted])):
        head[at + 1] = f"Frames: {len(some)}"
        (tmp_path / f"{name}.bvh").write_text("\n".join([*head, *map(" ".join, some)]) + "\n")
    clean, broken = (read_motion(tmp_path / f"{name}.bvh") for name in ("own", "all"))
    assert len(broken) == 41 and np.array_equal(broken.positions, clean.positions)
    robot = load_robot("op3")
    with pytest.raises(
        MotionError, match=r"[Ff]rames 41–\d+ .* no poses.*--frames 0:41 takes the 41 frames before them"
    ):
        features_of(broken, match(broken, robot))
    part = broken.frames(0, 41)
    own_features, taken = features_of(clean, match(clean, robot)), features_of(part, match(part, robot))
    assert np.array_equal(own_features.positions, taken.positions)


def test_a_quick_motion_is_not_taken_for_noise() -> None:
    """A body that spins three times a second and whips all its limbs, at 30 frames a second."""
    walk = read_motion(ROOT / "samples" / "walk.bvh")
    quick = at_frames(walk, np.arange(0, len(walk) - 1, 4.0), 30.0)
    assert not clean_part(Capture(quick.skeleton, quick.positions, quick.rotations, 30.0, "q"), ScrambleRule())[1]
