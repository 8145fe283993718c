"""DeepMimic: its frames on the skeleton of the character file."""

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from shared_files import SHARED, needs_shared

from robot_retarget.base.errors import MotionError
from robot_retarget.base.keypoints import KEYPOINTS
from robot_retarget.human.capture import Request
from robot_retarget.human.read import read_motion
from robot_retarget.human.readers import datasets
from robot_retarget.human.recognition import recognise

FOLDER = SHARED / "motions" / "other" / "deepmimic"
TAKES = ("dance_a", "getup_facedown", "kick", "walk")


@needs_shared
def test_the_skeleton_is_that_of_the_character_file():
    joints = json.loads((FOLDER / "character_humanoid3d.txt").read_text())["Skeleton"]["Joints"]
    skeleton = datasets.SKELETON
    for joint in joints:
        index = skeleton.names.index(joint["Name"])
        assert skeleton.offsets[index].tolist() == [joint[f"Attach{axis}"] for axis in "XYZ"]
        parent = skeleton.parents[index]
        assert (skeleton.names[parent] if parent >= 0 else "") == (
            joints[joint["Parent"]]["Name"] if parent >= 0 else ""
        )


@needs_shared
@pytest.mark.parametrize("take", TAKES)
def test_joints_stand_where_rotations_along_the_chain_put_them(take):
    path = FOLDER / f"humanoid3d_{take}.txt"
    capture = datasets.read_deepmimic(path, Request())
    joints = json.loads((FOLDER / "character_humanoid3d.txt").read_text())["Skeleton"]["Joints"]
    rows = json.loads(path.read_text())["Frames"]
    for frame in range(0, len(rows), 11):
        numbers = rows[frame][1:]
        place, turn = {}, {}
        for joint in joints:
            above = joint["Parent"]
            attach = [joint[f"Attach{axis}"] for axis in "XYZ"]
            if joint["ID"] == 0:
                place[0], numbers = np.array(numbers[:3]), numbers[3:]
                turn[0], numbers = Rotation.from_quat(np.roll(numbers[:4], -1)), numbers[4:]
                continue
            place[joint["ID"]] = place[above] + turn[above].apply(attach)
            own = Rotation.identity()
            if joint["Type"] == "spherical":
                own, numbers = Rotation.from_quat(np.roll(numbers[:4], -1)), numbers[4:]
            elif joint["Type"] == "revolute":
                own, numbers = Rotation.from_rotvec([0, 0, numbers[0]]), numbers[1:]
            turn[joint["ID"]] = turn[above] * own
            index = capture.skeleton.names.index(joint["Name"])
            assert capture.positions[frame, index] == pytest.approx(place[joint["ID"]], abs=1e-9), joint["Name"]
        assert not numbers


@needs_shared
@pytest.mark.parametrize("take", TAKES)
def test_every_take_is_a_human_on_the_floor(take):
    motion = read_motion(FOLDER / f"humanoid3d_{take}.txt")
    assert recognise(motion.skeleton, motion.positions).keypoints == KEYPOINTS
    assert motion.fps == pytest.approx(60 if take in ("dance_a", "getup_facedown") else 30, abs=0.01)
    assert -0.05 < motion.positions[..., 2].min() < 0.05


def written(tmp_path: Path, rows: list) -> Path:
    path = tmp_path / "clip.txt"
    path.write_text(json.dumps({"Loop": "none", "Frames": rows}))
    return path


def frame(**changes) -> list[float]:
    row = [1 / 30, 0, 0.9, 0, *[1, 0, 0, 0] * 4, 0, *[1, 0, 0, 0] * 2, 0, *[1, 0, 0, 0], 0, *[1, 0, 0, 0] * 2, 0]
    for at, value in changes.items():
        row[int(at[1:])] = value
    return row


def test_broken_frames_are_named(tmp_path):
    assert len(frame()) == datasets.DEEPMIMIC_WIDTH == 44
    for rows, message in (
        ([frame(), frame()[:-1]], r"Frames\[1\]: expected 44 numbers \(the character humanoid3d\), found 43"),
        ([frame(), frame(_4=0.0)], r"Frames, root: the quaternion at \[1\] has the length 0, expected 1"),
        ([frame(_5=float("nan"))], r"Frames\[0\]: a number is not finite"),
        ([frame(_5="x")], "Frames: expected numbers only"),
        ([frame(_0=0)], "Frames: expected durations over 0 s"),
        ([], "expected the `Frames` of a DeepMimic motion"),
    ):
        with pytest.raises(MotionError, match=message):
            read_motion(written(tmp_path, rows))
    path = written(tmp_path, [frame()] * 3)
    path.write_text(path.read_text()[:-20])
    with pytest.raises(MotionError, match=r"clip\.txt:1: not JSON"):
        read_motion(path)
