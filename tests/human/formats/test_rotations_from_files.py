"""One door checks every rotation that is read: damage is refused at once, a lost rotation is bridged and said."""

import json
import pickle
from pathlib import Path

import numpy as np
import pytest
from headset_sessions import isaac_session, performer, poses_of, record
from scipy.spatial.transform import Rotation, Slerp
from shared_files import ROOT

from robot_retarget.base.errors import FileError, MotionError
from robot_retarget.base.untrusted.rotations import (
    checked_quaternions,
    quaternions_of_matrices,
    quaternions_of_vectors,
)
from robot_retarget.human.capture import Capture
from robot_retarget.human.read import read_motion
from robot_retarget.human.skeleton import Skeleton


@pytest.fixture(scope="module")
def walk():
    return read_motion(ROOT / "samples" / "walk.bvh")


def saved(path: Path, motion, rotations: np.ndarray, **other: object) -> Path:
    skeleton = motion.skeleton
    arrays = {"positions": motion.positions, "names": np.array(skeleton.names), "parents": skeleton.parents}
    np.savez(path, rotations=rotations, fps=motion.fps, **{**arrays, **other})
    return path


def matrices(motion) -> np.ndarray:
    turns = Rotation.from_quat(motion.rotations.reshape(-1, 4), scalar_first=True).as_matrix()
    return turns.reshape(*motion.rotations.shape[:2], 3, 3)


@pytest.mark.parametrize("damage", [np.inf, np.nan, 1e200, -1.0])
def test_a_damaged_rotation_matrix_is_refused_at_once(tmp_path, walk, damage):
    turns = matrices(walk)
    turns[4, 3, 1] = damage
    with pytest.raises(MotionError, match=r"rotations: the matrix at \[4, 3\] is no rotation"):
        read_motion(saved(tmp_path / "a.npz", walk, turns))


@pytest.mark.parametrize("damage", [np.inf, 1e150, 1e-3])
def test_a_quaternion_far_from_unit_length_is_refused(tmp_path, walk, damage):
    turns = np.array(walk.rotations)
    turns[4, 3] = damage * (turns[4, 3] if np.isfinite(damage) else 1.0)
    if np.isinf(damage):
        assert np.isnan(checked_quaternions(turns, "turns", gaps=True)[4, 3]).all()
        return
    with pytest.raises(MotionError, match=r"rotations: the quaternion at \[4, 3\] has the length"):
        read_motion(saved(tmp_path / "a.npz", walk, turns))


def test_a_lost_rotation_is_bridged_along_the_shortest_way_and_said(tmp_path, walk):
    turns = np.array(walk.rotations)
    turns[10:13, 3] = 0.0
    motion = read_motion(saved(tmp_path / "a.npz", walk, turns))
    assert any("3 rotations that were lost were bridged" in note for note in motion.notes)
    assert motion.rotations is not None
    ends = Rotation.from_quat(walk.rotations[[9, 13], 3], scalar_first=True)
    expected = Slerp([9, 13], ends)([10, 11, 12])
    found = Rotation.from_quat(motion.rotations[10:13, 3], scalar_first=True)
    np.testing.assert_allclose((found * expected.inv()).magnitude(), 0, atol=1e-6)


def test_a_rotation_that_is_lost_for_long_or_always_is_refused_by_its_name(tmp_path, walk):
    turns = np.array(walk.rotations)
    turns[10:-1, 3] = 0.0
    with pytest.raises(MotionError, match=f"{walk.skeleton.names[3]!r} is lost in frames 10 to"):
        read_motion(saved(tmp_path / "a.npz", walk, turns))
    turns[:, 3] = 0.0
    with pytest.raises(MotionError, match="has no rotation in any frame"):
        read_motion(saved(tmp_path / "a.npz", walk, turns))


def test_matrices_vectors_and_quaternions_give_one_rotation():
    turns = Rotation.random(20, rng=np.random.default_rng(4))
    expected = turns.as_quat(scalar_first=True)
    for found in (
        quaternions_of_matrices(turns.as_matrix(), "a"),
        quaternions_of_vectors(turns.as_rotvec(), "a"),
        checked_quaternions(1.2 * expected, "a"),
    ):
        np.testing.assert_allclose(np.abs((found * expected).sum(axis=1)), 1, atol=1e-12)
    with pytest.raises(FileError, match="more than 1000"):
        quaternions_of_vectors([[0.0, np.inf, 0.0]], "a")


def test_offsets_that_are_no_numbers_and_joints_far_away_are_refused(tmp_path, walk):
    skeleton = walk.skeleton
    for wrong in (np.nan, 1e200):
        broken = Skeleton(skeleton.names, skeleton.parents, np.where(np.eye(len(skeleton), 3) > 0, wrong, 0.1))
        with pytest.raises(MotionError, match=r"the offset of joint .* is \[.*, not within 1e\+07 of its parent"):
            Capture(broken, np.array(walk.positions), None, 30.0, "a")
    away = walk.positions + np.array([1e5, 0, 0])
    with pytest.raises(MotionError, match=r"a joint is 1e.05 m from the origin"):
        read_motion(saved(tmp_path / "a.npz", walk, walk.rotations, positions=away))


def test_a_session_whose_records_lie_a_day_apart_asks_for_no_memory(tmp_path):
    poses = poses_of(performer(tmp_path))[:10]
    path = isaac_session(tmp_path / "a.mcap", [record(frame) for frame in poses], fps=60.0)
    assert len(read_motion(path)) == 10
    slow = tmp_path / "slow.mcap"
    from mcap.writer import CompressionType, Writer

    with slow.open("wb") as stream:
        writer = Writer(stream, compression=CompressionType.NONE)
        writer.start()
        kind = writer.register_schema("core.FullBodyPoseRecord", "flatbuffer", b"")
        channel = writer.register_channel("full_body", "flatbuffer", kind)
        for k, frame in enumerate(poses):
            stamp = 10**9 + (round(k / 60 * 1e9) if k < 9 else 86400 * 10**9)
            writer.add_message(channel, stamp, record(frame), stamp, k)
        writer.finish()
    with pytest.raises(MotionError, match=r"its records stop for up to 8.64e.04 s"):
        read_motion(slow)


def test_parc_holds_deepmimics_body_with_z_up(tmp_path):
    """The oracle is the reader of DeepMimic's own files: one motion written both ways."""
    rng = np.random.default_rng(3)
    frames, bodies = [], []
    for _ in range(12):
        rows, turns = [], {}
        for name, count in (
            ("root", 4), ("chest", 4), ("neck", 4), ("right_hip", 4), ("right_knee", 1), ("right_ankle", 4),
            ("right_shoulder", 4), ("right_elbow", 1), ("left_hip", 4), ("left_knee", 1), ("left_ankle", 4),
            ("left_shoulder", 4), ("left_elbow", 1),
        ):  # fmt: skip
            if count == 1:
                angle = 0.3 * rng.normal()
                turn = Rotation.from_euler("z", angle)
                rows.append(angle)
            else:
                turn = Rotation.from_rotvec(0.2 * rng.normal(size=3))
                rows += turn.as_quat(scalar_first=True).tolist()
            turns[name] = turn
        place = [0.0, 0.9, 0.0]
        frames.append([1 / 30, *place, *rows])
        upright = Rotation.from_matrix([[1, 0, 0], [0, 0, -1], [0, 1, 0]])
        order = ("chest", "neck", "right_shoulder", "right_elbow", "", "left_shoulder", "left_elbow", "",
                 "right_hip", "right_knee", "right_ankle", "left_hip", "left_knee", "left_ankle")  # fmt: skip
        inner = [(upright * turns[n] * upright.inv()).as_quat() if n else [0, 0, 0, 1.0] for n in order]
        bodies.append((upright.apply(place), (upright * turns["root"] * upright.inv()).as_quat(), inner))
    (tmp_path / "a.txt").write_text(json.dumps({"Loop": "none", "Frames": frames}))
    place, root, inner = (np.array(part, dtype="f4") for part in zip(*bodies, strict=True))
    motion = {"root_pos": place, "root_rot": root, "joint_rot": inner, "fps": 30, "loop_mode": "CLAMP"}
    (tmp_path / "a.pkl").write_bytes(pickle.dumps({"motion_data": pickle.dumps(motion), "terrain_data": b""}))
    theirs, ours = read_motion(tmp_path / "a.txt"), read_motion(tmp_path / "a.pkl")
    assert ours.skeleton.names == theirs.skeleton.names and ours.fps == 30
    lengths = [np.linalg.norm(m.positions[:, :, None] - m.positions[:, None], axis=3) for m in (ours, theirs)]
    np.testing.assert_allclose(lengths[0], lengths[1], atol=1e-5)
    np.testing.assert_allclose(ours.positions[..., 2], theirs.positions[..., 2], atol=1e-5)


def test_windows_of_omomo_hold_the_joints_of_smpl(tmp_path):
    joints = performer(tmp_path).positions
    rows = np.concatenate([joints.reshape(len(joints), 72), np.zeros((len(joints), 204))], axis=1)
    (tmp_path / "a.pkl").write_bytes(pickle.dumps({"motion": rows, "trans2joint": np.zeros(3), "seq_name": "a"}))
    np.savez(tmp_path / "a.npz", positions=joints, fps=30.0)
    found, expected = read_motion(tmp_path / "a.pkl"), read_motion(tmp_path / "a.npz", up="z")
    assert found.fps == 30 and found.skeleton.names == expected.skeleton.names
    np.testing.assert_allclose(found.positions, expected.positions, atol=1e-9)


def test_positions_of_omniretarget_have_their_rate(tmp_path):
    joints = np.random.default_rng(6).normal(size=(9, 22, 3))
    np.savez(tmp_path / "a.npz", global_joint_positions=joints, height=1.7)
    np.savez(tmp_path / "b.npz", positions=joints)
    assert (read_motion(tmp_path / "a.npz", up="z").fps, read_motion(tmp_path / "b.npz", up="z").fps) == (30, 20)
