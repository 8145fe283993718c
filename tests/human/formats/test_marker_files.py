"""TRC, Vicon's and OptiTrack's CSV, MVNX: written here as their programs lay them out, from a clip that is known."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from shared_files import ROOT

from robot_retarget.base.errors import MotionError
from robot_retarget.base.keypoints import KEYPOINTS
from robot_retarget.human.motion import Motion
from robot_retarget.human.read import read_motion
from robot_retarget.human.readers.marker_tables import PARENTS
from robot_retarget.human.recognition import recognise

CENTRES = {
    "Neck": "neck", "Head": "head",
    **{f"{side}{word}": f"{side.lower()}_{part}" for side in "LR" for word, part in (
        ("Hip", "hip"), ("Knee", "knee"), ("Ankle", "ankle"), ("BigToe", "toe"),
        ("Shoulder", "shoulder"), ("Elbow", "elbow"), ("Wrist", "hand"))},
}  # fmt: skip
"""Labels of Pose2Sim, and the keypoints that they are."""


@pytest.fixture(scope="module")
def walk() -> Motion:
    return read_motion(ROOT / "samples" / "walk.bvh")


@pytest.fixture(scope="module")
def places(walk: Motion) -> dict[str, np.ndarray]:
    """Keypoints (T, 3) of the walk, y up [m]."""
    found = recognise(walk.skeleton, walk.positions)
    return {
        k: x[:, [1, 2, 0]] for k, x in zip(found.keypoints, found.place(walk.positions).swapaxes(0, 1), strict=True)
    }


def trc(path: Path, labels: dict[str, np.ndarray], unit: str = "m", fps: float = 60.0) -> Path:
    frames = len(next(iter(labels.values())))
    head = ["PathFileType\t4\t(X/Y/Z)\ta.trc", "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate"]
    head += [f"{fps:g}\t{fps:g}\t{frames}\t{len(labels)}\t{unit}\t{fps:g}"]
    head += [
        "Frame#\tTime\t" + "\t\t\t".join(labels) + "\t\t",
        "\t\t" + "\t".join(f"X{k}\tY{k}\tZ{k}" for k in range(1, len(labels) + 1)),
    ]
    rows = [
        "\t".join(
            [str(t + 1), f"{t / fps:.5f}", *("" if np.isnan(v) else f"{v:.7f}" for x in labels.values() for v in x[t])]
        )
        for t in range(frames)
    ]
    path.write_text("\n".join([*head, *rows]) + "\n")
    return path


def vicon(path: Path, labels: dict[str, np.ndarray], fps: float = 100.0) -> Path:
    head = ["Devices", "1000", ",,Plate", "Frame,Sub Frame,Fx", ",,N", "1,0,3", "", "Trajectories", f"{fps:g}"]
    head += [
        ",," + ",".join(f"Anna:{name},," for name in labels),
        "Frame,Sub Frame," + ",".join(["X,Y,Z"] * len(labels)),
    ]
    head += [",," + ",".join(["mm,mm,mm"] * len(labels))]
    frames = len(next(iter(labels.values())))
    rows = [f"{t + 1},0," + ",".join(f"{1000 * v:.4f}" for x in labels.values() for v in x[t]) for t in range(frames)]
    path.write_text("\n".join([*head, *rows]) + "\n")
    return path


@pytest.mark.parametrize("write", [trc, vicon])
def test_joint_centres_stay_where_they_are(tmp_path: Path, places: dict[str, np.ndarray], write) -> None:
    labels = {label: places[keypoint] for label, keypoint in CENTRES.items()}
    motion = read_motion(write(tmp_path / ("a.trc" if write is trc else "a.csv"), labels), repair=False)
    assert motion.fps == (60.0 if write is trc else 100.0)
    found = recognise(motion.skeleton, motion.positions)
    assert set(KEYPOINTS) - set(found.keypoints) <= {"chest"}
    knee = motion.positions[:, motion.skeleton.names.index("left_knee")]
    hip = motion.positions[:, motion.skeleton.names.index("left_hip")]
    assert np.allclose((knee - hip)[:, [1, 2, 0]], places["l_knee"] - places["l_hip"], atol=1e-6)


def test_a_lost_point_of_a_trc_is_bridged_and_a_word_is_named(tmp_path: Path, places: dict[str, np.ndarray]) -> None:
    labels = {label: places[keypoint].copy() for label, keypoint in CENTRES.items()}
    labels["LKnee"][10:14] = np.nan
    motion = read_motion(trc(tmp_path / "a.trc", labels))
    assert any("4 places of points" in note for note in motion.notes)
    lines = (tmp_path / "a.trc").read_text().replace("0.00000\t", "0.00000\tx", 1)
    (tmp_path / "b.trc").write_text(lines)
    with pytest.raises(MotionError, match=r"b.trc:6: not a number"):
        read_motion(tmp_path / "b.trc")


def test_points_that_are_no_joints_are_refused_with_what_is_missing(
    tmp_path: Path, places: dict[str, np.ndarray]
) -> None:
    with pytest.raises(MotionError, match=r"Missing: left front of the pelvis .*Its labels: M1, M2"):
        read_motion(trc(tmp_path / "a.trc", {"M1": places["head"], "M2": places["neck"]}))


BONES = {
    "Hip": "Hips", "Ab": "Chest", "Chest": "Chest3", "Neck": "Neck", "Head": "Head",
    **{f"{s}{b}": f"{word}{j}" for s, word in (("L", "Left"), ("R", "Right")) for b, j in (
        ("Shoulder", "Collar"), ("UArm", "Shoulder"), ("FArm", "Elbow"), ("Hand", "Wrist"),
        ("Thigh", "Hip"), ("Shin", "Knee"), ("Foot", "Ankle"), ("Toe", "Toe"))},
}  # fmt: skip
"""Bones of Motive's skeletons, and the joints of the sample at which they begin."""


def optitrack(path: Path, motion: Motion, unit: str = "Millimeters", lost: slice = slice(0)) -> Path:
    """Bones of two skeletons, y up, quaternions x y z w; the second stands two metres aside."""
    assert motion.rotations is not None
    to_y = Rotation.from_euler("x", -90, degrees=True)
    columns, cells = [], []
    for person, aside in (("Anna", 0.0), ("Ben", 2.0)):
        for bone in PARENTS:
            if bone not in BONES:
                continue
            j = motion.skeleton.names.index(BONES[bone])
            turn = (to_y * Rotation.from_quat(motion.rotations[:, j], scalar_first=True) * to_y.inv()).as_quat()
            place = 1000 * to_y.apply(motion.positions[:, j] + [0, aside, 0])
            columns += [(f"{person}:{bone}", "Rotation", a) for a in "XYZW"] + [
                (f"{person}:{bone}", "Position", a) for a in "XYZ"
            ]
            cells += [turn, place]
    table = np.concatenate(cells, axis=1)
    rows = [[f"{v:.7f}" for v in row] for row in table]
    for row in rows[lost]:
        row[7:14] = [""] * 7
    head = [
        f"Format Version,1.23,Take Name,Take,Capture Frame Rate,120.000000,Export Frame Rate,120.000000,Rotation Type,Quaternion,Length Units,{unit},Coordinate Space,Global",
        "", ",Type," + ",".join("Bone" for _ in columns), ",Name," + ",".join(c[0] for c in columns),
        ",ID," + ",".join("1" for _ in columns), ",," + ",".join(c[1] for c in columns),
        "Frame,Time (Seconds)," + ",".join(c[2] for c in columns),
    ]  # fmt: skip
    path.write_text("\n".join([*head, *(f"{t},{t / 120:.6f}," + ",".join(row) for t, row in enumerate(rows))]) + "\n")
    return path


def test_bones_of_optitrack_are_read_with_their_rotations(tmp_path: Path, walk: Motion) -> None:
    motion = read_motion(optitrack(tmp_path / "a.csv", walk, lost=slice(5, 8)), repair=False)
    assert motion.fps == 120 and any("first of 2 motions" in note for note in motion.notes)
    found = recognise(motion.skeleton, motion.positions)
    assert motion.skeleton.names[found.marks["l_knee"].joints[0]] == "LShin"
    bone = [motion.skeleton.names.index(name) for name in ("LThigh", "LShin")]
    own = [walk.skeleton.names.index(BONES[name]) for name in ("LThigh", "LShin")]
    there, here = (np.diff(m.positions[:, at], axis=1)[:, 0] for m, at in ((walk, own), (motion, bone)))
    turn = Rotation.align_vectors(here, there)[0]
    assert np.allclose(turn.apply(there), here, atol=1e-5)
    other = read_motion(f"{tmp_path / 'a.csv'}#Ben", repair=False)
    assert np.allclose(other.positions - motion.positions, (other.positions - motion.positions)[0, 0], atol=1e-5)


MVNX = """<?xml version="1.0"?><mvnx xmlns="http://www.xsens.com/mvn/mvnx" version="4"><subject label="A" frameRate="60" segmentCount="{n}">
<segments>{segments}</segments><joints>{joints}</joints>
<footContactDefinition><contactDefinition label="LeftFoot_Heel" index="0"/><contactDefinition label="LeftFoot_Toe" index="1"/>
<contactDefinition label="RightFoot_Heel" index="2"/><contactDefinition label="RightFoot_Toe" index="3"/></footContactDefinition>
<frames><frame type="identity"><position>0</position><orientation>1</orientation></frame>{frames}</frames></subject></mvnx>"""


def mvnx(path: Path, motion: Motion) -> Path:
    """The joints of a motion as segments; the foot contacts of every frame are left heel alone."""
    assert motion.rotations is not None
    names, skeleton = motion.skeleton.names, motion.skeleton
    points = {n: [(f"j{n}", np.zeros(3))] for n in names}
    joints = ""
    for j, parent in enumerate(skeleton.parents.tolist()):
        if parent >= 0:
            points[names[parent]].append((f"j{names[j]}", skeleton.offsets[j]))
            joints += f'<joint label="j{names[j]}"><connector1>{names[parent]}/j{names[j]}</connector1><connector2>{names[j]}/j{names[j]}</connector2></joint>'
    segments = "".join(
        f'<segment label="{n}"><points>'
        + "".join(f'<point label="{q}"><pos_b>{" ".join(map(str, x))}</pos_b></point>' for q, x in of)
        + "</points></segment>"
        for n, of in points.items()
    )
    frames = "".join(
        f'<frame type="normal"><orientation>{" ".join(map(str, motion.rotations[t].ravel()))}</orientation>'
        f"<position>{' '.join(map(str, motion.positions[t].ravel()))}</position><footContacts>1 0 0 0</footContacts></frame>"
        for t in range(len(motion))
    )
    path.write_text(MVNX.format(n=len(names), segments=segments, joints=joints, frames=frames))
    return path


def test_segments_of_mvnx_are_joints_with_rotations_and_contacts(tmp_path: Path, walk: Motion) -> None:
    motion = read_motion(mvnx(tmp_path / "a.mvnx", walk), repair=False)
    assert motion.rotations is not None and walk.rotations is not None
    kept = [motion.skeleton.names.index(name) for name in walk.skeleton.names]
    assert motion.fps == 60 and len(motion) == len(walk)
    assert np.allclose(
        motion.positions[:, kept] - walk.positions, (motion.positions[:, kept] - walk.positions)[0, 0], atol=1e-9
    )
    assert np.allclose(np.abs((motion.rotations[:, kept] * walk.rotations).sum(2)), 1)
    assert motion.contacts is not None and motion.contacts.labels.all(axis=0).tolist() == [True, False, False, False]


def test_a_cut_mvnx_is_refused_with_its_line(tmp_path: Path, walk: Motion) -> None:
    whole = mvnx(tmp_path / "a.mvnx", walk.frames(0, 20)).read_text()
    (tmp_path / "b.mvnx").write_text(whole[: len(whole) // 2])
    with pytest.raises(MotionError, match=r"b.mvnx:\d+: not XML"):
        read_motion(tmp_path / "b.mvnx")


OPENSIM = {
    "R.ASIS": "RASI", "L.ASIS": "LASI", "V.Sacral": "SACR", "R.Knee.Lat": "RKNE", "L.Knee.Lat": "LKNE", "R.Ankle.Lat": "RANK",
    "L.Ankle.Lat": "LANK", "R.Acromium": "RSHO", "L.Acromium": "LSHO", "R.Elbow": "RELB", "L.Elbow": "LELB",
    "R.Wrist.Lat": "RWRA", "L.Wrist.Lat": "LWRA", "R.Wrist.Med": "RWRB", "L.Wrist.Med": "LWRB", "R.Toe.Tip": "RTOE",
    "L.Toe.Tip": "LTOE", "Sternum": "STRN", "R.Temple": "RFHD", "L.Temple": "LFHD",
}  # fmt: skip
"""Markers of OpenSim's models (gait2392, Hamner), and those of Plug-in-Gait at the same place."""


def test_markers_of_opensim_are_those_of_plug_in_gait_and_doubled_tabs_count_once(
    tmp_path: Path, places: dict[str, np.ndarray]
) -> None:
    at = {
        **{f"{s}ASI": places[f"{s.lower()}_hip"] + [0, 0.08, 0.06] for s in "LR"},
        "SACR": places["pelvis"] + [0, 0.08, -0.1],
        **{f"{s}{m}": places[f"{s.lower()}_{k}"] for s in "LR" for m, k in
           (("KNE", "knee"), ("ANK", "ankle"), ("SHO", "shoulder"), ("ELB", "elbow"), ("WRA", "hand"), ("TOE", "toe"))},
        **{f"{s}WRB": places[f"{s.lower()}_hand"] + [0, 0, 0.05] for s in "LR"},
        "STRN": places["chest"], **{f"{s}FHD": places["head"] for s in "LR"},
    }  # fmt: skip
    plain = read_motion(trc(tmp_path / "a.trc", at), repair=False)
    theirs = trc(tmp_path / "b.trc", {label: at[name] for label, name in OPENSIM.items()})
    np.testing.assert_allclose(read_motion(theirs, repair=False).positions, plain.positions, atol=1e-6)
    lines = theirs.read_text().split("\n")
    doubled = [line.replace("\t", "\t\t") if k in (1, 2) or k > 4 else line for k, line in enumerate(lines)]
    theirs.write_text("\n".join(doubled))
    np.testing.assert_allclose(read_motion(theirs, repair=False).positions, plain.positions, atol=1e-6)


def test_single_markers_of_knees_ankles_shoulders_and_wrists_are_their_outer_ones(
    tmp_path: Path, places: dict[str, np.ndarray]
) -> None:
    """As in the trials of OpenSim's full-body model (Rajagopal), which lack inner markers."""
    parts = {"Knee": "knee", "Ankle": "ankle", "Shoulder": "shoulder", "Elbow": "elbow", "Wrist": "hand", "Toe": "toe"}
    at = {f"{s}.{m}": places[f"{s.lower()}_{k}"] for s in "RL" for m, k in parts.items()}
    at |= {f"{s}.ASIS": places[f"{s.lower()}_hip"] + [0, 0.08, 0.06] for s in "RL"}
    at |= {f"{s}.PSIS": places[f"{s.lower()}_hip"] + [0, 0.08, -0.1] for s in "RL"}
    motion = read_motion(trc(tmp_path / "a.trc", at), repair=False)
    knee, wrist = (motion.positions[:, motion.skeleton.names.index(f"left_{part}")] for part in ("knee", "wrist"))
    shin = np.linalg.norm(places["l_knee"] - places["l_hand"], axis=1)
    np.testing.assert_allclose(np.linalg.norm(knee - wrist, axis=1), shin, atol=1e-6)
    assert "No inner marker of the left knee: its centre is at the outer one." in motion.notes
    del at["L.Knee"]
    with pytest.raises(MotionError, match="Missing: left outer knee"):
        read_motion(trc(tmp_path / "b.trc", at))
