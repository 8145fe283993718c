"""BVH files are read as their exporters meant them."""

import importlib.util
import time
from pathlib import Path

import numpy as np
import pytest
from bvh_texts import HEAD, ROWS, text
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from shared_files import SHARED, needs_shared

from robot_retarget.human.capture import Capture
from robot_retarget.human.readers.bvh import read_bvh

CLIPS = sorted((SHARED / "motions" / "bvh").glob("*/*.bvh"))
RELATIVE = [clip for clip in CLIPS if clip.stem in ("mh_benchmark_1frame_163j", "mh_tpose_173j")]
"""Clips whose position channels add to OFFSET; the independent reader takes them for absolute ones."""


def read(folder: Path, content: str | bytes, name: str = "clip.bvh") -> Capture:
    path = folder / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return read_bvh(path)


@pytest.fixture(scope="module")
def judge_reader():
    spec = importlib.util.spec_from_file_location("judge", SHARED / "judge" / "judge.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.read_bvh


@needs_shared
@pytest.mark.parametrize("clip", [clip for clip in CLIPS if clip not in RELATIVE], ids=lambda clip: clip.stem)
def test_positions_are_those_of_an_independent_reader(clip, judge_reader):
    capture = read_bvh(clip)
    _, expected, frame_time = judge_reader(clip)
    assert capture.positions == pytest.approx(expected, abs=1e-9)
    assert capture.fps == pytest.approx(1 / frame_time, rel=1e-4)


@needs_shared
@pytest.mark.parametrize("clip", RELATIVE, ids=lambda clip: clip.stem)
def test_relative_position_channels_keep_the_bones(clip):
    capture = read_bvh(clip)
    assert any("relative" in note for note in capture.notes)
    parents, below = capture.skeleton.parents, capture.skeleton.parents >= 0
    bones = np.linalg.norm(capture.positions - capture.positions[:, parents], axis=2)[:, below]
    assert bones == pytest.approx(np.linalg.norm(capture.skeleton.offsets, axis=1)[None, below], abs=0.02)


def test_a_turned_root_carries_its_child_along(tmp_path):
    capture = read(tmp_path, text())
    assert capture.skeleton.names == ("Hips", "Spine", "Spine_end")
    assert capture.positions[0] == pytest.approx(np.array([[1, 2, 3], [-9, 2, 3], [-14, 2, 3]]))
    assert capture.positions[1] == pytest.approx(np.array([[4, 5, 6], [4, 5, 16], [4, 5, 21]]))
    assert capture.fps == pytest.approx(25)
    assert capture.notes == ()


@settings(max_examples=25, deadline=None)
@given(st.permutations("XYZ"), st.permutations("XYZ"), st.booleans(), st.integers(0, 2**32 - 1))
def test_channels_may_stand_in_any_order(tmp_path_factory, turns, moves, rotation_first, seed):
    parts = [[f"{axis}position" for axis in moves], [f"{axis}rotation" for axis in turns]]
    channels = [name for part in (parts[::-1] if rotation_first else parts) for name in part]
    values = np.random.default_rng(seed).uniform(-180, 180, 6)
    head = HEAD.replace("Xposition Yposition Zposition Zrotation Xrotation Yrotation", " ".join(channels))
    row = " ".join(f"{value:.17g}" for value in values) + " 0 0 0"
    capture = read(tmp_path_factory.mktemp("order"), text(head, (row,)))
    by_name = dict(zip(channels, values, strict=True))
    turn = np.eye(3)
    for axis in turns:
        one = np.zeros(3)
        one["XYZ".index(axis)] = np.radians(by_name[f"{axis}rotation"])
        turn = turn @ Rotation.from_rotvec(one).as_matrix()
    place = np.array([by_name[f"{axis}position"] for axis in "XYZ"])
    assert capture.positions[0, 1] == pytest.approx(place + turn @ [0, 10, 0], abs=1e-9)
    assert capture.rotations is not None
    assert Rotation.from_quat(capture.rotations[0, 0], scalar_first=True).as_matrix() == pytest.approx(turn, abs=1e-9)


def test_a_joint_may_have_no_channel_or_one_or_two(tmp_path):
    head = HEAD.replace("CHANNELS 3 Zrotation Xrotation Yrotation", "CHANNELS 0")
    assert len(read(tmp_path, text(head, ("1 2 3 0 0 0",))).positions) == 1
    head = HEAD.replace("CHANNELS 3 Zrotation Xrotation Yrotation", "CHANNELS 1 Xrotation")
    turned = read(tmp_path, text(head, ("0 0 0 0 0 0 90", "0 0 0 0 0 0 -90"))).positions[:, 2]
    assert turned == pytest.approx(np.array([[0, 10, 5], [0, 10, -5]]))
    head = HEAD.replace(
        "CHANNELS 3 Zrotation Xrotation Yrotation", "CHANNELS 4 Xrotation Xrotation Zrotation Xrotation"
    )
    turned = read(tmp_path, text(head, ("0 0 0 0 0 0 45 45 0 0", "0 0 0 0 0 0 0 0 0 -90"))).positions[:, 2]
    assert turned == pytest.approx(np.array([[0, 10, 5], [0, 10, -5]]))
    head = HEAD.replace("\t\tCHANNELS 3 Zrotation Xrotation Yrotation\n", "")
    assert read(tmp_path, text(head, ("0 0 0 0 0 0",))).positions[0, 2] == pytest.approx(np.array([0, 15, 0]))


SIX = HEAD.replace(
    "CHANNELS 3 Zrotation Xrotation Yrotation", "CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation"
)


def test_absolute_positions_replace_the_offset(tmp_path):
    capture = read(tmp_path, text(SIX, ("0 0 0 0 0 0 0.1 10.2 0 0 0 0",)))
    assert capture.positions[0, 1] == pytest.approx(np.array([0.1, 10.2, 0]))


def test_relative_positions_are_added_to_the_offset(tmp_path):
    capture = read(tmp_path, text(SIX, ("0 0 0 0 0 0 0.1 0.2 0 0 0 0",)))
    assert capture.positions[0, 1] == pytest.approx(np.array([0.1, 10.2, 0]))
    assert "relative" in capture.notes[0]


@pytest.mark.parametrize("spelling", ["End site", "End Site-7", "JOINT Site", "END SITE", "EndSite"])
def test_an_end_site_is_one_however_it_is_spelled(tmp_path, spelling):
    assert read(tmp_path, text(HEAD.replace("End Site", spelling))).skeleton.names == ("Hips", "Spine", "Spine_end")


def test_an_end_site_may_stand_beside_children(tmp_path):
    head = HEAD.replace("\tJOINT Spine", "\tEnd Site\n\t{\n\t\tOFFSET 1 0 0\n\t}\n\tJOINT Spine")
    capture = read(tmp_path, text(head))
    assert capture.skeleton.names == ("Hips", "Hips_end", "Spine", "Spine_end")
    assert list(capture.skeleton.parents) == [-1, 0, 0, 2]


def test_leaves_may_lack_an_end_site(tmp_path):
    head = HEAD[: HEAD.index("\t\tEnd Site")] + "\t}\n}\n"
    assert read(tmp_path, text(head)).skeleton.names == ("Hips", "Spine")


def test_several_roots_and_no_root_are_read(tmp_path):
    second = HEAD.removeprefix("HIERARCHY\n")
    capture = read(tmp_path, text(HEAD + second, tuple(f"{row} {row}" for row in ROWS)))
    assert list(capture.skeleton.parents) == [-1, 0, 1, -1, 3, 4]
    assert capture.positions[:, :3] == pytest.approx(capture.positions[:, 3:])
    assert read(tmp_path, text(HEAD.replace("ROOT", "JOINT"))).skeleton.names[0] == "Hips"


def test_the_first_three_of_six_offset_numbers_count(tmp_path):
    capture = read(tmp_path, text(HEAD.replace("OFFSET 0 10 0", "OFFSET 0 10 0 1 2 3")))
    assert capture.skeleton.offsets[1] == pytest.approx(np.array([0, 10, 0]))
    assert capture.notes[0] == "1 joint with more than 3 numbers of OFFSET use the first 3: 'Spine' (6)."


@pytest.mark.parametrize("name", ["Bip01 L Thigh", "mixamorig:Spine", "spine.001", "Hüfte", "左足", "End", "x-1_(2)"])
def test_names_are_kept_whole(tmp_path, name):
    assert read(tmp_path, text(HEAD.replace("Spine", name))).skeleton.names[1] == name


def test_notes_of_one_kind_are_one_note(tmp_path):
    capture = read(
        tmp_path, text(HEAD.replace("OFFSET 0 10 0", "OFFSET 0 10 0 1").replace("OFFSET 0 5 0", "OFFSET 0 5 0 1"))
    )
    assert sum("OFFSET" in note for note in capture.notes) == 1


def test_equal_and_missing_names_are_made_unique_and_noted(tmp_path):
    capture = read(tmp_path, text(HEAD.replace("Spine", "Hips")))
    assert capture.skeleton.names == ("Hips", "Hips_2", "Hips_2_end")
    assert any(
        "1 joint with the name of an earlier one got a number: 'Hips_2' in line" in note for note in capture.notes
    )
    capture = read(tmp_path, text(HEAD.replace(" Spine", "")))
    assert capture.skeleton.names[1] == "joint_1"
    assert any("1 joint without a name got one: 'joint_1' in line" in note for note in capture.notes)


@pytest.mark.parametrize(
    "mangle",
    [
        lambda t: t.replace("\n", "\r\n").encode(),
        lambda t: t.replace("\n", "\r").encode(),
        lambda t: t.replace("\n", "\r\n", 9).encode(),
        lambda t: b"\xef\xbb\xbf" + t.encode(),
        lambda t: t.encode("utf-16"),
        lambda t: t.replace(" ", "\t").encode(),
        lambda t: t.replace("\n", "  \n\n").encode(),
        lambda t: t.replace("\n{", " {").encode(),
        lambda t: t.lower().replace("hips", "Hips").replace("spine", "Spine").encode(),
        lambda t: t.rstrip().encode(),
    ],
    ids=["crlf", "cr", "mixed", "bom", "utf-16", "tabs", "blank lines", "braces behind", "lower case", "no last end"],
)
def test_line_ends_blanks_and_encodings_do_not_matter(tmp_path, mangle):
    plain = read(tmp_path, text())
    other = read(tmp_path, mangle(text()))
    assert other.skeleton.names == plain.skeleton.names
    assert np.array_equal(other.positions, plain.positions)


def test_names_in_an_old_encoding_do_not_stop_the_reader(tmp_path):
    assert read(tmp_path, text(HEAD.replace("Spine", "Hüfte")).encode("latin-1")).skeleton.names[1] == "Hüfte"


@pytest.mark.parametrize(
    "row",
    [
        "1.0 2.0 3.0 90.0-0.0 0.0 0.0 0.0 0.0",
        "1,0 2,0 3,0 90,0 0,0 0,0 0,0 0,0 0,0",
        "1.0, 2.0, 3.0, 90.0, 0.0, 0.0, 0.0, 0.0, 0.0",
        "1e0 2E+00 3.0e0 9.0E1 1e-320 -0.0 0 0 0",
        "+1 2. 3 90 .0 0 0 0 0",
    ],
    ids=["glued", "decimal comma", "comma between", "scientific and denormal", "short forms"],
)
def test_odd_numbers_are_read_as_meant(tmp_path, row):
    assert read(tmp_path, text(rows=(row,))).positions == pytest.approx(read(tmp_path, text()).positions[:1])


@pytest.mark.parametrize("said", [1, 3, 4])
def test_the_rows_count_and_not_what_the_file_says_of_them(tmp_path, said):
    capture = read(tmp_path, text(frames=said))
    assert len(capture.positions) == 2
    assert f"Frames says {said}, 2 rows follow" in capture.notes[0]


def test_a_row_may_be_wrapped_over_lines(tmp_path):
    wrapped = tuple(part for row in ROWS for part in (row[:6], row[6:]))
    assert np.array_equal(read(tmp_path, text(rows=wrapped, frames=2)).positions, read(tmp_path, text()).positions)


def test_the_frame_time_is_kept_to_the_last_digit(tmp_path):
    assert read(tmp_path, text(time="0.04170837504170838")).fps == 1 / 0.04170837504170838
    assert read(tmp_path, text(time="0,04")).fps == pytest.approx(25)


def test_a_file_without_rotation_channels_gives_none(tmp_path):
    head = HEAD.replace(" Zrotation Xrotation Yrotation", "").replace("CHANNELS 6", "CHANNELS 3")
    head = head.replace("\t\tCHANNELS 3\n", "\t\tCHANNELS 3 Xposition Yposition Zposition\n")
    assert read(tmp_path, text(head, ("0 0 0 1 11 0",))).rotations is None


def test_thousands_of_frames_are_read_in_a_blink(tmp_path):
    joints, frames = 22, 4900
    inner = "".join(
        f"JOINT j{k}\n{{\nOFFSET 0 {k % 5 + 1} 0\nCHANNELS 3 Zrotation Yrotation Xrotation\n" for k in range(1, joints)
    )
    head = "HIERARCHY\nROOT j0\n{\nOFFSET 0 0 0\nCHANNELS 6 "
    head += f"Xposition Yposition Zposition Zrotation Yrotation Xrotation\n{inner}{'}' * joints}\n"
    rows = np.random.default_rng(0).uniform(-180, 180, (frames, 3 + 3 * joints))
    path = tmp_path / "long.bvh"
    path.write_text(text(head, tuple(" ".join(f"{value:.6f}" for value in row) for row in rows)))
    assert path.stat().st_size > 3.3e6
    started = time.process_time()
    capture = read_bvh(path)
    assert time.process_time() - started < 1.5
    assert capture.positions.shape == (frames, joints, 3)
