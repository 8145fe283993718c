"""Results of video: the camera's tilt is found from feet and posture, the scale from the stature, and people are chosen."""

import pickle
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from shared_files import ROOT

from robot_retarget.base.errors import MotionError, UsageError
from robot_retarget.human.motion import Motion
from robot_retarget.human.read import read_motion
from robot_retarget.human.recognition import recognise
from robot_retarget.human.recognition.recognise import stature

INDEX = {
    "l_shoulder": 5, "r_shoulder": 6, "l_elbow": 7, "r_elbow": 8, "l_hip": 9, "r_hip": 10, "l_knee": 11, "r_knee": 12,
    "l_ankle": 13, "r_ankle": 14, "r_hand": 41, "l_hand": 62, "neck": 69,
}  # fmt: skip


@pytest.fixture(scope="module")
def walk() -> Motion:
    return read_motion(ROOT / "samples" / "walk.bvh")


def seen(motion: Motion, pitch: float, roll: float = 0.0, noise: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """(T, 70, 3) keypoints about the hips, and (T, 3) translations, of a camera 4 m away that looks down by `pitch` [rad]."""
    found = recognise(motion.skeleton, motion.positions)
    x = dict(zip(found.keypoints, found.place(motion.positions).swapaxes(0, 1), strict=True))
    points = np.zeros((len(motion), 70, 3))
    for keypoint, k in INDEX.items():
        points[:, k] = x[keypoint]
    for side, toes, ear in (("l", (15, 16), 3), ("r", (18, 19), 4)):
        points[:, list(toes)] = x[f"{side}_toe"][:, None]
        points[:, ear] = x["head"]
    points += noise * np.random.default_rng(3).normal(size=points.shape)
    level = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])  # x right, y down, z away
    turn = Rotation.from_euler("xz", [pitch, roll]).as_matrix() @ level
    placed = points @ turn.T + [0.0, 0.3, 4.0]
    camera = placed[:, [9, 10]].mean(axis=1)
    return placed - camera[:, None], camera


@pytest.mark.parametrize(("pitch", "roll"), [(0.0, 0.0), (0.35, 0.0), (-0.3, 0.15)])
def test_the_tilt_of_a_camera_is_found_and_taken_out(tmp_path: Path, walk: Motion, pitch: float, roll: float) -> None:
    points, camera = seen(walk, pitch, roll, noise=0.01)
    np.savez(tmp_path / "a.npz", pred_keypoints_3d=points, pred_cam_t=camera, fps=30)
    motion = read_motion(tmp_path / "a.npz")
    found, own = (recognise(m.skeleton, m.positions) for m in (motion, walk))
    for keypoint in ("pelvis", "l_hand", "r_ankle"):
        a, b = (r.place(m.positions)[:, r.keypoints.index(keypoint), 2] for r, m in ((found, motion), (own, walk)))
        assert np.ptp(a - b) < 0.09  # of a walk of 3 m: 1.7° of tilt
    assert any(f"tilted by {np.degrees(np.hypot(pitch, roll)):.0f}°" in note and "±" in note for note in motion.notes)


def test_the_scale_is_that_of_the_stature(tmp_path: Path, walk: Motion) -> None:
    points, camera = seen(walk, 0.2)
    np.savez(tmp_path / "a.npz", pred_keypoints_3d=0.7 * points, pred_cam_t=0.7 * camera)
    motion = read_motion(tmp_path / "a.npz", height=1.83)
    assert stature(recognise(motion.skeleton, motion.positions), motion.positions) == pytest.approx(1.83, abs=0.02)
    with pytest.raises(UsageError, match="height must be a stature"):
        read_motion(tmp_path / "a.npz", height=18.3)


def test_people_of_a_list_of_frames_are_followed_by_their_track(tmp_path: Path, walk: Motion) -> None:
    points, camera = seen(walk, 0.1)
    frames = []
    for t in range(len(walk)):
        one = {"pred_keypoints_3d": points[t], "pred_cam_t": camera[t], "track_id": 3}
        two = {"pred_keypoints_3d": points[t], "pred_cam_t": camera[t] + [1.5, 0, 0], "track_id": 8}
        frames.append([two, one] if t % 2 else [one, two])
    frames[20] = frames[20][1:]
    (tmp_path / "a.pkl").write_bytes(pickle.dumps(frames))
    first, other = read_motion(tmp_path / "a.pkl"), read_motion(f"{tmp_path / 'a.pkl'}#8")
    assert any("first of 2 motions was read (3, 8)" in note for note in first.notes)
    assert any("bridged by straight lines" in note for note in first.notes)
    assert len(first) == len(other) == len(walk)
    with pytest.raises(MotionError, match="known: 3, 8"):
        read_motion(f"{tmp_path / 'a.pkl'}#5")
