"""Landmarks: the same body from every file that holds them."""

import json
from pathlib import Path

import numpy as np
import pytest

from robot_retarget.base.errors import MotionError
from robot_retarget.base.keypoints import KEYPOINTS
from robot_retarget.human.capture import Request
from robot_retarget.human.read import read_motion
from robot_retarget.human.readers import landmarks
from robot_retarget.human.readers.landmarks import LANDMARKS
from robot_retarget.human.recognition import recognise

T = 24
PLACES = {
    "nose": (0, -0.1, 1.60), "ear": (0.07, 0, 1.60), "shoulder": (0.18, 0, 1.42), "elbow": (0.22, 0, 1.12),
    "wrist": (0.24, -0.05, 0.86), "hip": (0.1, 0, 0.92), "knee": (0.11, -0.01, 0.5), "ankle": (0.11, 0.03, 0.08),
    "heel": (0.11, 0.07, 0.03), "foot_index": (0.12, -0.14, 0.02),
}  # fmt: skip
"""Of the left side, x to the left, y back, z up [m]."""


def body() -> np.ndarray:
    """(T, 33, 3) of an adult who lifts the left hand and walks on."""
    points = np.zeros((T, 33, 3))
    for k, name in enumerate(LANDMARKS):
        part = next((part for part in PLACES if name.endswith(part)), "nose")
        points[:, k] = np.array(PLACES[part]) * [-1 if "right" in name else 1, 1, 1]
    points[:, LANDMARKS.index("left_wrist"), 2] += np.linspace(0, 0.5, T)
    points[:, LANDMARKS.index("left_wrist"), 1] -= 0.25 * np.sin(np.linspace(0, np.pi, T))
    return points + np.linspace(0, 1, T)[:, None, None] * [0, -1, 0]


def wide(path: Path, points: np.ndarray, prefix: str = "", skip: str = "") -> Path:
    names = [name for name in LANDMARKS if name != skip]
    header = ",".join(f"{prefix}{name}_{axis}" for name in names for axis in "xyz")
    rows = points[:, [LANDMARKS.index(name) for name in names]].reshape(len(points), -1)
    lines = [",".join("" if np.isnan(v) else repr(float(v)) for v in row) for row in rows]
    path.write_text("\n".join([header, *lines]) + "\n")
    return path


def long(path: Path, points: np.ndarray) -> Path:
    lines = ["frame,timestamp,model,keypoint,x,y,z"]
    for t, frame in enumerate(points):
        lines += [
            f"{t},{t / 30},mediapipe_body,{name},{x},{y},{z}" for name, (x, y, z) in zip(LANDMARKS, frame, strict=True)
        ]
        lines.append(f"{t},{t / 30},mediapipe_face,0000,1,2,3")
    path.write_text("\n".join(lines))
    return path


def as_json(path: Path, points: np.ndarray, key: str | None, people: bool) -> Path:
    frames = []
    for frame in points:
        marks = [{"x": x, "y": y, "z": z, "visibility": 0.9} for x, y, z in frame.tolist()]
        marks = [marks] if people else marks
        frames.append({key: marks} if key else marks)
    path.write_text(json.dumps({"fps": 25, "frames": frames}))
    return path


def test_every_file_of_the_same_landmarks_is_the_same_body(tmp_path):
    points = body()
    np.save(tmp_path / "a.npy", points)
    np.save(tmp_path / "b.npy", np.concatenate([points, np.full((T, 520, 3), np.nan)], axis=1))
    files = [
        tmp_path / "a.npy",
        tmp_path / "b.npy",
        wide(tmp_path / "c.csv", points),
        wide(tmp_path / "d.csv", points, "body_"),
        long(tmp_path / "e.csv", points),
        as_json(tmp_path / "f.json", points, "worldLandmarks", people=True),
        as_json(tmp_path / "g.json", points, "landmarks", people=False),
        as_json(tmp_path / "h.json", points, None, people=False),
    ]
    for file in files:
        motion = read_motion(file)
        recognition = recognise(motion.skeleton, motion.positions)
        assert set(KEYPOINTS) - set(recognition.keypoints) <= {"chest", "neck"}, file.name
        x = dict(zip(recognition.keypoints, recognition.place(motion.positions).swapaxes(0, 1), strict=True))
        assert x["l_hand"] == pytest.approx(points[:, LANDMARKS.index("left_wrist")], abs=1e-6), file.name
        assert x["r_toe"] == pytest.approx(points[:, LANDMARKS.index("right_foot_index")], abs=1e-6), file.name
        assert motion.fps == (25 if file.suffix == ".json" else 30)


def test_world_landmarks_with_y_down_stand_up_and_do_not_travel(tmp_path):
    points = body()
    points -= points[:, [LANDMARKS.index("left_hip"), LANDMARKS.index("right_hip")]].mean(axis=1, keepdims=True)
    np.save(tmp_path / "a.npy", points[..., [0, 2, 1]] * [1, -1, 1])
    motion = read_motion(tmp_path / "a.npy")
    assert any("does not travel" in note for note in motion.notes)
    recognition = recognise(motion.skeleton, motion.positions)
    x = dict(zip(recognition.keypoints, recognition.place(motion.positions)[0], strict=True))
    assert x["head"][2] - x["l_ankle"][2] == pytest.approx(1.52, abs=0.01)


def test_a_lost_landmark_is_bridged_and_a_missing_one_named(tmp_path):
    points = body()
    points[5:8, LANDMARKS.index("left_knee")] = np.nan
    capture = landmarks.read(wide(tmp_path / "a.csv", points), Request())
    knee = capture.positions[:, capture.skeleton.names.index("left_knee")]
    assert knee == pytest.approx(body()[:, LANDMARKS.index("left_knee")], abs=1e-9)
    points[2:22, LANDMARKS.index("left_knee")] = np.nan
    with pytest.raises(MotionError, match="'left_knee' is lost in frames 2 to 21"):
        read_motion(wide(tmp_path / "a.csv", points))
    with pytest.raises(MotionError, match="lacks the landmarks right_ankle"):
        read_motion(wide(tmp_path / "a.csv", body(), skip="right_ankle"))


def test_broken_tables_name_their_line(tmp_path):
    path = wide(tmp_path / "a.csv", body())
    lines = path.read_text().splitlines()
    for line, change, message in (
        (4, "1,2", r"a\.csv:4: expected 99 columns as in the header, found 2"),
        (3, lines[2].replace("1.6", "head", 1), r"a\.csv:3: not a number: .*head"),
    ):
        path.write_text("\n".join([*lines[: line - 1], change, *lines[line:]]))
        with pytest.raises(MotionError, match=message):
            read_motion(path)
    path.write_text(lines[0])
    with pytest.raises(MotionError, match=r"a\.csv:2: no frames after the header"):
        read_motion(path)
    marks = as_json(tmp_path / "a.json", body()[:, :20], "landmarks", people=False)
    with pytest.raises(MotionError, match="frame 0: expected 33 landmarks, found 20"):
        read_motion(marks)


def test_broken_results_name_their_frame(tmp_path):
    path = tmp_path / "a.json"
    for said, message in (
        ("7", "expected a list of frames of landmarks"),
        ('{"landmarks": [[[]]]}', "'left_ear' is in no frame"),
        ('{"landmarks": [[1, 2]]}', "frame 0: expected 33 landmarks, found 2"),
        (json.dumps({"landmarks": [[[0, 1]] * 33]}), "frame 0: expected x, y and z of every landmark"),
        (json.dumps({"landmarks": [[{"x": 0}] * 33]}), "frame 0: expected x, y and z of every landmark"),
        (json.dumps({"fps": 0, "landmarks": [[[0, 1, 2]] * 33]}), "fps: expected a positive number"),
    ):
        path.write_text(said)
        with pytest.raises(MotionError, match=message):
            landmarks.read(path, Request())
    table = long(tmp_path / "a.csv", body())
    table.write_text(table.read_text().replace("\n3,", "\n-3,", 1))
    with pytest.raises(MotionError, match=r"a\.csv:104: frame: expected a whole number from 0 to 1000000, found '-3'"):
        read_motion(table)


def test_landmarks_of_an_image_are_refused(tmp_path):
    points = body()
    np.save(tmp_path / "a.npy", (points - points.min()) / np.ptp(points))
    with pytest.raises(MotionError, match="give the world landmarks, in metres"):
        read_motion(tmp_path / "a.npy")
