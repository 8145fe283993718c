"""C3D: joint centres where the regressions put them, of points that ezc3d reads and writes."""

from pathlib import Path

import ezc3d
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from shared_files import SHARED, needs_shared

from robot_retarget.base.errors import MotionError
from robot_retarget.base.keypoints import KEYPOINTS
from robot_retarget.human.capture import Request
from robot_retarget.human.read import read_motion
from robot_retarget.human.readers import c3d
from robot_retarget.human.readers.regressions import Markers, chord, hip_centres
from robot_retarget.human.recognition import recognise

FOLDER = SHARED / "motions" / "other" / "c3d"
# A standing adult, x ahead, y left, z up [mm]; the left side, the right one is its mirror image.
SIDE = {
    "ASI": (80, 120, 950), "PSI": (-90, 45, 970), "THI": (10, 175, 720), "KNE": (0, 150, 500), "TIB": (0, 140, 280),
    "ANK": (-20, 135, 80), "TOE": (170, 110, 30), "HEE": (-60, 100, 30), "SHO": (0, 180, 1430), "ELB": (-10, 260, 1130),
    "WRA": (40, 270, 880), "WRB": (0, 290, 880), "FHD": (90, 70, 1640), "BHD": (-90, 70, 1640),
}  # fmt: skip
MIDDLE = {"C7": (-70, 0, 1480), "CLAV": (60, 0, 1400), "STRN": (80, 0, 1250), "T10": (-110, 0, 1230)}


def adult() -> dict[str, np.ndarray]:
    left = {f"L{name}": np.array(place, float) for name, place in SIDE.items()}
    right = {f"R{name}": np.array(place, float) * [1, -1, 1] for name, place in SIDE.items()}
    return left | right | {name: np.array(place, float) for name, place in MIDDLE.items()}


def written(path: Path, markers: dict[str, np.ndarray], rate=100.0, unit="mm", subject="") -> Path:
    """A file of markers, each (3,) for ten frames, or (T, 3)."""
    paths = {name: np.atleast_2d(place) for name, place in markers.items()}
    frames = max(max(map(len, paths.values())), 10)
    points = np.stack([np.broadcast_to(place, (frames, 3)) for place in paths.values()], axis=1)
    file = ezc3d.c3d()
    file["parameters"]["POINT"]["UNITS"]["value"] = [unit]
    file["parameters"]["POINT"]["RATE"]["value"] = [rate]
    file["parameters"]["POINT"]["LABELS"]["value"] = [subject + name for name in paths]
    file["data"]["points"] = np.concatenate([points.transpose(2, 1, 0), np.ones((1, len(paths), frames))])
    file.write(str(path))
    return path


@needs_shared
def test_joints_between_two_markers_are_their_middle_as_ezc3d_reads_them():
    capture = c3d.read(FOLDER / "ezc3d_Qualisys.c3d", Request())
    file = ezc3d.c3d(str(FOLDER / "ezc3d_Qualisys.c3d"))
    labels = file["parameters"]["POINT"]["LABELS"]["value"]
    points = file["data"]["points"][:3].transpose(2, 1, 0) / 1000
    for joint, marks in {
        "left_knee": ("L_FLE", "L_FME"), "right_ankle": ("R_FAL", "R_TAM"), "left_elbow": ("L_HLE", "L_HME"),
        "right_wrist": ("R_RSP", "R_UHE"), "left_toe": ("L_FM1", "L_FM5"),
        "head": ("L_HDF", "R_HDF", "L_HDB", "R_HDB"),
    }.items():  # fmt: skip
        middle = np.mean([points[:, labels.index(mark)] for mark in marks], axis=0)
        assert capture.positions[:, capture.skeleton.names.index(joint)] == pytest.approx(middle, abs=1e-9)
    assert capture.fps == 200


@needs_shared
def test_a_walk_in_the_laboratory_has_all_keypoints_and_rigid_bones():
    motion = read_motion(FOLDER / "ezc3d_Qualisys.c3d")
    recognition = recognise(motion.skeleton, motion.positions)
    assert recognition.keypoints == KEYPOINTS
    x = dict(zip(KEYPOINTS, recognition.place(motion.positions).swapaxes(0, 1), strict=True))
    for above, below in (("l_hip", "l_knee"), ("r_hip", "r_knee"), ("l_knee", "l_ankle"), ("r_shoulder", "r_elbow")):
        length = np.linalg.norm(x[above] - x[below], axis=1)
        assert 0.2 < length.mean() < 0.5 and length.std() < 0.01, (above, below)
    assert 1.5 < x["head"][:, 2].mean() < 1.7 or x["head"][:, 2].mean() > 1.3


@needs_shared
@pytest.mark.parametrize(
    ("name", "missing"),
    [("ezc3d_Optotrak", r"left front of the pelvis \(LASI or L_IAS"), ("pyc3d_my-motion", r"Its labels: RFT1, RFT2")],
)
def test_markers_without_anatomy_are_refused_with_what_is_missing(name, missing):
    with pytest.raises(MotionError, match=missing):
        read_motion(FOLDER / f"{name}.c3d")


@pytest.mark.parametrize("subject", ["", "Anna:"])
@pytest.mark.parametrize(("unit", "scale"), [("mm", 1), ("cm", 0.1), ("m", 0.001)])
def test_plug_in_gait_makes_an_adult_in_any_unit(tmp_path, unit, scale, subject):
    markers = {name: scale * place for name, place in adult().items()}
    motion = read_motion(written(tmp_path / "a.c3d", markers, unit=unit, subject=subject))
    recognition = recognise(motion.skeleton, motion.positions)
    assert recognition.keypoints == KEYPOINTS and motion.fps == 100
    x = dict(zip(KEYPOINTS, recognition.place(motion.positions)[0], strict=True))
    # Harrington 2007 by hand: width 240, depth 170 and a tilt of the pelvis by atan(20 / 170).
    tilt = np.arctan2(20, 170)
    depth = np.hypot(20, 170)
    ahead, above = -0.24 * depth - 9.9, -0.30 * 240 - 10.9
    hip = np.array([80, 0, 950]) + ahead * np.array([np.cos(tilt), 0, -np.sin(tilt)])
    hip += above * np.array([np.sin(tilt), 0, np.cos(tilt)]) + (0.33 * 240 + 7.3) * np.array([0, 1, 0])
    assert 1000 * x["l_hip"] == pytest.approx(hip, abs=0.5)
    assert 1000 * (np.array([0, 0.18, 1.43]) - x["l_shoulder"])[2] == pytest.approx(0.17 * 360, rel=0.01)
    assert 1000 * np.linalg.norm(x["l_knee"] - [0, 0.15, 0.5]) == pytest.approx(57, abs=0.1)
    assert abs(x["l_knee"][1]) < 0.1 < 0.15, "towards the middle of the body"


@given(st.integers(0, 2**31))
def test_hips_turn_with_the_pelvis(seed):
    rng = np.random.default_rng(seed)
    turn, shift = Rotation.from_quat(rng.normal(size=4)), rng.normal(size=3)
    labels = ("LASI", "RASI", "LPSI", "RPSI")
    still = {name: adult()[name][None] / 1000 for name in labels}
    moved = {name: turn.apply(place) + shift for name, place in still.items()}
    for before, after in zip(hip_centres(Markers(still)), hip_centres(Markers(moved)), strict=True):
        assert after == pytest.approx(turn.apply(before) + shift, abs=1e-9)


@given(st.integers(0, 2**31), st.floats(0.02, 0.1))
def test_a_chord_is_as_far_as_asked_at_a_right_angle_and_away_from_the_wand(seed, half):
    above, outer, beside = np.random.default_rng(seed).normal(size=(3, 1, 3))
    centre = chord(above, outer, beside, half)
    assert np.linalg.norm(centre - outer) == pytest.approx(half)
    assert ((above - centre) * (outer - centre)).sum() == pytest.approx(0, abs=1e-9)
    normal = np.cross(above - outer, beside - outer)
    assert ((centre - outer) * normal).sum() == pytest.approx(0, abs=1e-9)
    assert np.dot(np.cross(above[0] - outer[0], centre[0] - outer[0]), normal[0]) < 0


def test_one_of_two_people_is_read_by_name(tmp_path):
    people = {f"Anna:{name}": place for name, place in adult().items()}
    people |= {f"Ben:{name}": np.add(place, [0, 2000, 0]) for name, place in adult().items()}
    written(tmp_path / "both.c3d", people)
    anna, ben = read_motion(tmp_path / "both.c3d"), read_motion(f"{tmp_path / 'both.c3d'}#Ben")
    assert any("The first of 2 motions was read (Anna, Ben)" in note for note in anna.notes)
    assert ben.positions - anna.positions == pytest.approx(
        np.tile([0.0, 2, 0], (*ben.positions.shape[:2], 1)), abs=1e-6
    )


def test_lost_markers_are_bridged_cut_off_or_refused(tmp_path):
    path = {name: np.tile(place, (100, 1)) for name, place in adult().items()}
    path["LKNE"][:, 0] = np.arange(100.0)
    path["LKNE"][40:60] = np.nan
    path["RTOE"][:10] = np.nan
    capture = c3d.read(written(tmp_path / "a.c3d", path), Request())
    assert len(capture.positions) == 90
    assert any("20 places of points that were lost were bridged" in note for note in capture.notes)
    assert any("Frames 10 to 99 of 100" in note for note in capture.notes)
    knee = capture.positions[:, capture.skeleton.names.index("left_knee"), 0]
    assert np.diff(knee).min() > 0.0005
    path["LKNE"][30:90] = np.nan
    with pytest.raises(MotionError, match=r"a\.c3d: 'LKNE' is lost in frames 30 to 89, longer than 0\.5 s"):
        c3d.read(written(tmp_path / "a.c3d", path), Request())
    path["LKNE"][:] = np.nan
    with pytest.raises(MotionError, match="'LKNE' is in no frame"):
        c3d.read(written(tmp_path / "a.c3d", path), Request())


def test_a_missing_marker_a_strange_unit_and_a_cut_file_are_named(tmp_path):
    markers = adult()
    del markers["RELB"]
    with pytest.raises(
        MotionError,
        match=r"Missing: right outer elbow \(RELB or R_HLE or RELBOWOUT or RLEL or RELBOW\)\. Its labels: LASI",
    ):
        read_motion(written(tmp_path / "a.c3d", markers))
    with pytest.raises(MotionError, match=r"POINT:UNITS: expected one of mm, cm, m, in, found .furlong."):
        read_motion(written(tmp_path / "a.c3d", adult(), unit="furlong"))
    whole = written(
        tmp_path / "a.c3d", {name: np.tile(place, (300, 1)) for name, place in adult().items()}
    ).read_bytes()
    for length, message in ((100, "not a C3D file"), (600, "not a C3D file"), (1500, "not a C3D file")):
        (tmp_path / "cut.c3d").write_bytes(whole[:length])
        with pytest.raises(MotionError, match=message):
            read_motion(tmp_path / "cut.c3d")
    (tmp_path / "cut.c3d").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(MotionError, match="truncated: 149 of 300 frames are present"):
        read_motion(tmp_path / "cut.c3d")


@pytest.mark.parametrize("place", [525, 681, 912, 1033, 1243])
def test_a_changed_byte_at_which_ezc3d_crashes_is_a_sentence_and_the_interpreter_lives(place, tmp_path):
    path = written(tmp_path / "a.c3d", adult())
    data = bytearray(path.read_bytes())
    data[place] = 255
    path.write_bytes(data)
    with pytest.raises(MotionError, match=r"a\.c3d"):
        c3d.read(path, Request())
