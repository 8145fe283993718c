"""Joint positions as arrays are motions too."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from shared_files import SHARED, needs_shared

from robot_retarget.base.errors import MotionError
from robot_retarget.base.keypoints import KEYPOINTS
from robot_retarget.human.read import read_motion
from robot_retarget.human.readers.bvh import read_bvh
from robot_retarget.human.readers.positions import HUMANML3D
from robot_retarget.human.recognition import recognise
from robot_retarget.human.skeleton import sorted_tree

SMPL_OF_LAFAN = [
    "Hips", "LeftUpLeg", "RightUpLeg", "Spine", "LeftLeg", "RightLeg", "Spine1", "LeftFoot", "RightFoot", "Spine2",
    "LeftToe", "RightToe", "Neck", "LeftShoulder", "RightShoulder", "Head", "LeftArm", "RightArm", "LeftForeArm",
    "RightForeArm", "LeftHand", "RightHand",
]  # fmt: skip
"""The joints of a LAFAN1 body in the order of HumanML3D."""


@pytest.fixture(scope="module")
def walk() -> np.ndarray:
    """A walk as the 22 joints of HumanML3D, metres, y up."""
    capture = read_bvh(SHARED / "motions" / "bvh" / "lafan1_procedural" / "walk_procedural.bvh")
    return capture.positions[:, [capture.skeleton.names.index(name) for name in SMPL_OF_LAFAN]] / 100


@needs_shared
def test_22_joints_without_names_are_those_of_humanml3d(tmp_path, walk):
    np.save(tmp_path / "walk.npy", walk)
    motion = read_motion(tmp_path / "walk.npy")
    assert motion.fps == 20
    assert motion.rotations is None
    assert motion.positions == pytest.approx(walk[..., [2, 0, 1]])
    assert motion.skeleton.names[16] == "left_shoulder"
    recognition = recognise(motion.skeleton, motion.positions)
    assert recognition.keypoints == KEYPOINTS
    found = {k: [motion.skeleton.names[j] for j in m.joints] for k, m in recognition.marks.items()}
    assert found["chest"] == ["spine3"] and found["l_toe"] == ["left_foot"] and found["r_hand"] == ["right_wrist"]


@needs_shared
def test_24_joints_are_those_of_smpl(tmp_path, walk):
    hands = walk[:, [20, 21]] * 1.2 - walk[:, [18, 19]] * 0.2
    np.save(tmp_path / "walk.npy", np.concatenate([walk, hands], axis=1))
    motion = read_motion(tmp_path / "walk.npy")
    recognition = recognise(motion.skeleton, motion.positions)
    assert recognition.marks["l_hand"].joints == (20,)


@needs_shared
def test_an_npz_may_say_everything_itself(tmp_path, walk):
    names = [f"n{k}" for k in range(22)]
    parents = np.array(HUMANML3D.parent_indices(HUMANML3D.names))
    np.savez(tmp_path / "walk.npz", joints=walk, joint_names=names, parents=parents, fps=np.array([60]))
    motion = read_motion(tmp_path / "walk.npz")
    assert motion.skeleton.names == tuple(names)
    assert list(motion.skeleton.parents) == list(parents)
    assert motion.fps == 60
    assert read_motion(tmp_path / "walk.npz", fps=25).fps == 25


@needs_shared
def test_joints_in_any_order_are_sorted_parents_first(tmp_path, walk):
    shuffle = np.random.default_rng(0).permutation(22)
    parents = np.array(HUMANML3D.parent_indices(HUMANML3D.names))
    place = np.argsort(shuffle)
    moved = np.where(parents[shuffle] < 0, -1, place[parents[shuffle]])
    names = np.array(HUMANML3D.names)
    np.savez(tmp_path / "walk.npz", positions=walk[:, shuffle], names=names[shuffle], parents=moved)
    motion = read_motion(tmp_path / "walk.npz")
    assert np.all(motion.skeleton.parents < np.arange(22))
    for joint, parent in enumerate(motion.skeleton.parents):
        old = int(np.flatnonzero(names == motion.skeleton.names[joint])[0])
        assert motion.positions[:, joint] == pytest.approx(walk[:, old][..., [2, 0, 1]])
        assert parent < 0 or names[parents[old]] == motion.skeleton.names[parent]


@needs_shared
def test_a_known_set_needs_no_parents_in_any_order(tmp_path, walk):
    shuffle = np.random.default_rng(1).permutation(22)
    np.savez(tmp_path / "walk.npz", positions=walk[:, shuffle], names=np.array(HUMANML3D.names)[shuffle])
    motion = read_motion(tmp_path / "walk.npz")
    found = {
        k: motion.skeleton.names[m.joints[0]] for k, m in recognise(motion.skeleton, motion.positions).marks.items()
    }
    assert found["l_elbow"] == "left_elbow" and found["r_knee"] == "right_knee" and found["head"] == "head"


@needs_shared
def test_rotations_in_the_world_frame_are_taken_along():
    paths = sorted((SHARED / "motions" / "other" / "npz").glob("*.npz"))
    assert paths
    for path in paths:
        motion = read_motion(path)
        assert motion.rotations is not None
        assert recognise(motion.skeleton, motion.positions).keypoints == KEYPOINTS
        hip, knee = (motion.skeleton.names.index(name) for name in ("LeftLeg", "LeftShin"))
        turn = Rotation.from_quat(motion.rotations[:, hip], scalar_first=True)
        bone = turn.apply(np.array(motion.skeleton.offsets[knee]))
        assert motion.positions[:, knee] - motion.positions[:, hip] == pytest.approx(bone, abs=1e-3)


def broken(tmp_path, name: str, **arrays) -> str:
    path = tmp_path / name
    if name.endswith(".npy"):
        np.save(path, arrays["positions"], allow_pickle=True)
    else:
        np.savez(path, **arrays)
    with pytest.raises(MotionError) as caught:
        read_motion(path)
    assert str(caught.value).startswith(str(path))
    return str(caught.value)


def test_a_wrong_array_is_refused_with_what_was_expected(tmp_path):
    points = np.zeros((4, 22, 3))
    assert "(T, J, 3), got float64 (4, 66)" in broken(tmp_path, "a.npy", positions=points.reshape(4, 66))
    assert "(T, J, 3), got float64 (0, 22, 3)" in broken(tmp_path, "a.npy", positions=points[:0])
    assert "22 (the 22 joints of HumanML3D and SMPL), 24" in broken(tmp_path, "a.npy", positions=points[:, :7])
    assert "without pickle" in broken(tmp_path, "a.npy", positions=np.array([{}], dtype=object))
    assert "(T, J, 3), got <U1" in broken(tmp_path, "a.npz", positions=np.full((2, 22, 3), "x"))
    assert "no array of positions among data, more; known: positions" in broken(tmp_path, "a.npz", data=[1], more=[2])
    assert "as many different names, got 2" in broken(tmp_path, "a.npz", positions=points, names=["a", "b"])
    names = [f"n{k}" for k in range(22)]
    assert "parents must be 22 indices" in broken(tmp_path, "a.npz", positions=points, names=names, parents=[0, 1])
    assert "joint names need `parents`" in broken(tmp_path, "a.npz", positions=points, names=names)
    ring = np.roll(np.arange(22), 1)
    assert "ring" in broken(tmp_path, "a.npz", positions=points, names=names, parents=ring)
    assert "one positive number" in broken(tmp_path, "a.npz", positions=points, fps=0)
    assert "rotations must be (4, 22, 4) or (4, 22, 3, 3), got (4, 2, 4)" in broken(
        tmp_path, "a.npz", positions=points, rotations=np.zeros((4, 2, 4))
    )
    assert "no rotation" in broken(tmp_path, "a.npz", positions=points, rotations=np.zeros((4, 22, 4)))
    points[2, 5, 1] = np.nan
    assert "frame 2, joint 'right_knee' is not finite" in broken(tmp_path, "a.npy", positions=points)


def test_text_or_half_a_file_called_an_array_is_refused(tmp_path):
    for name in ("a.npy", "a.npz"):
        (tmp_path / name).write_text("hello")
        with pytest.raises(MotionError, match=r"not a readable (array file|\.npz)"):
            read_motion(tmp_path / name)
    np.savez(tmp_path / "whole.npz", positions=np.zeros((50, 22, 3)))
    (tmp_path / "a.npz").write_bytes((tmp_path / "whole.npz").read_bytes()[:2000])
    with pytest.raises(MotionError, match=r"not a readable (array file|\.npz)"):
        read_motion(tmp_path / "a.npz")


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 30))
def test_a_sorted_tree_is_the_same_tree(seed, joints):
    rng = np.random.default_rng(seed)
    parents = np.array([-1, *(int(rng.integers(0, joint)) for joint in range(1, joints))])
    shuffle = rng.permutation(joints)
    place = np.argsort(shuffle)
    shuffled = np.where(parents[shuffle] < 0, -1, place[parents[shuffle]])
    found, order = sorted_tree(shuffled)
    assert np.all(found < np.arange(joints))
    original = shuffle[order]
    assert [-1 if p < 0 else original[p] for p in found] == list(parents[original])


@pytest.mark.parametrize(
    ("arrays", "sentence"),
    [
        ({"positions": np.zeros((3, 22, 3))}, "all joints are at one place"),
        ({"positions": np.full((3, 22, 3), 1e200) * np.arange(22)[:, None]}, "not within 1e\\+07 of its parent"),
        ({"positions": np.ones((3, 22, 3)), "fps": 1e-300}, "from 0.01 to 10000"),
        ({"positions": np.ones((3, 22, 3)), "fps": 1e300}, "from 0.01 to 10000"),
        ({"poses": np.full((3, 156), 1e300)}, "more than 1000"),
    ],
)
def test_sizes_rates_and_turns_that_no_motion_has_are_refused(arrays, sentence, tmp_path):
    np.savez(tmp_path / "a.npz", **arrays)
    with pytest.raises(MotionError, match=sentence):
        read_motion(tmp_path / "a.npz")
