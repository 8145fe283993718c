"""What programs write of people in video: each layout is read as the known motion, level, where it happened."""

from pathlib import Path

import joblib
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from shared_files import ROOT
from video_files import IN_CAMERA, IN_PLACE, WRITERS, Dance, danced

from robot_retarget.base.errors import MotionError
from robot_retarget.human.motion import Motion
from robot_retarget.human.read import read_motion
from robot_retarget.human.readers.smpl import NAMES
from robot_retarget.tools.batch.run import find_clips

PARTS = ("left_hip", "right_hip", "left_knee", "right_knee", "left_ankle", "right_ankle", "left_shoulder", "right_shoulder",
         "left_elbow", "right_elbow", "left_wrist", "right_wrist")  # fmt: skip


@pytest.fixture(scope="module")
def dance() -> Dance:
    return danced(read_motion(ROOT / "samples" / "hips_and_bow.bvh"))


def errors(motion: Motion, dance: Dance, first: int = 0) -> tuple[float, float, float]:
    """The tilt [°], the way of the pelvis and the joints about it [m], each in the mean, after a turn about z and a scale."""
    x = np.stack([motion.positions[:, motion.skeleton.names.index(name)] for name in PARTS], axis=1)
    y = dance.joints[first : first + len(x)][:, [NAMES.index(name) for name in PARTS]]
    ways = [points[:, :2].mean(axis=1) for points in (x, y)]
    x, y = (points - way[:, None] for points, way in zip((x, y), ways, strict=True))
    scale = np.sqrt((y**2).sum() / (x**2).sum())
    whole = Rotation.align_vectors(y.reshape(-1, 3), x.reshape(-1, 3))[0]
    tilt = np.degrees(np.arccos(np.clip(whole.as_matrix()[2, 2], -1, 1)))
    a, b = ((points[..., 0] + 1j * points[..., 1]).ravel() for points in (x, y))
    yaw = Rotation.from_rotvec([0, 0, np.angle((np.conj(a) * b).sum())]).as_matrix()
    pose = float(np.linalg.norm(scale * x @ yaw.T - y, axis=2).mean())
    start, end = (way - way.mean(axis=0) for way in (scale * ways[0] @ yaw.T, ways[1]))
    return float(tilt), float(np.linalg.norm(start - end, axis=1).mean()), pose


@pytest.mark.parametrize("program", WRITERS)
def test_people_from_video_are_read_level_and_where_they_were(tmp_path: Path, dance: Dance, program: str) -> None:
    motion = read_motion(WRITERS[program](tmp_path, dance), fps=30)
    tilt, way, pose = errors(motion, dance, first=5 if program == "GLAMR" else 0)
    said = any("camera is tilted by" in note for note in motion.notes)
    assert said == (program in IN_CAMERA)
    assert tilt < (2 if said else 1e-3)
    assert pose < (0.03 if said else 1e-3)
    assert program in IN_PLACE or way < (0.05 if said else 1e-3)


@pytest.mark.parametrize("program", ["SLAHMR", "EasyMocap", "GVHMR in camera"])
def test_a_walk_into_the_depth_is_known_to_be_seen_by_a_camera(tmp_path: Path, program: str) -> None:
    """Its layout does not say so: the person stays near the axis of the camera, where a world may have its floor."""
    walk = danced(read_motion(ROOT / "samples" / "walk.bvh"))
    tilt, way, pose = errors(read_motion(WRITERS[program](tmp_path, walk), fps=30), walk)
    assert tilt < 2 and way < 0.02 and pose < 0.03


def test_a_person_whose_name_has_slashes_is_asked_for_as_the_note_says(tmp_path: Path, dance: Dance) -> None:
    path = WRITERS["PromptHMR"](tmp_path, dance)
    note = next(note for note in read_motion(path).notes if "ask for another" in note)
    assert "results.pkl#people/1/smplx_cam" in note
    tilt, way, _ = errors(read_motion(f"{path}#people/1/smplx_cam"), dance)
    assert tilt < 2 and way < 0.01


def test_frames_without_the_person_take_their_time(tmp_path: Path, dance: Dance) -> None:
    there = np.delete(np.arange(60), [20, 21, 22])
    cut = Dance(dance.turns[there], dance.pelvis[there], dance.joints[there])
    path = WRITERS["PromptHMR"](tmp_path, cut)
    content = joblib.load(path)
    content["people"][1]["frames"] = there
    joblib.dump(content, path)
    assert errors(read_motion(path), dance)[2] < 0.01
    joblib.dump(content["people"][1]["smplx_world"], tmp_path / "bare.pkl")  # without the numbers
    assert len(read_motion(path)) == 60 and len(read_motion(tmp_path / "bare.pkl")) == 57


def test_files_that_hold_less_than_a_motion_are_refused_with_the_file_that_holds_it(
    tmp_path: Path, dance: Dance
) -> None:
    frame = {"smpl_thetas": dance.vectors[:2], "cam_trans": dance.shift[:2], "smpl_betas": np.zeros((2, 10))}
    np.savez(tmp_path / "000001.npz", results=frame)  # pyright: ignore[reportArgumentType]
    with pytest.raises(MotionError, match=r"one frame of ROMP: give video_results\.npz"):
        read_motion(tmp_path / "000001.npz")
    coco = np.zeros((9, 17, 3))
    coco[:, 1:5, 0] = 0.03, -0.03, 0.07, -0.07  # eyes and ears beside a nose
    coco[:, 1:3, 2], coco[:, 5:, 1] = 0.03, np.arange(12)
    np.save(tmp_path / "coco.npy", coco)
    with pytest.raises(MotionError, match=r"not the 17 joints of Human3\.6M in their order: give the joints' names"):
        read_motion(tmp_path / "coco.npy")


def test_a_folder_of_frames_is_one_clip_of_a_batch(tmp_path: Path, dance: Dance) -> None:
    path = WRITERS["EasyMocap"](tmp_path, dance)
    assert [clip.path for clip in find_clips([tmp_path])] == [path]
    assert len(read_motion(tmp_path / "000007.json")) == len(dance.pelvis)
