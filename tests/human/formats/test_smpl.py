"""The SMPL family: turns of the joints on a mean skeleton, or on that of the user's body model."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from robot_retarget.base.errors import MotionError, UsageError
from robot_retarget.base.keypoints import KEYPOINTS
from robot_retarget.human.capture import Request
from robot_retarget.human.read import read_motion
from robot_retarget.human.readers import smpl
from robot_retarget.human.readers.smpl import NAMES, PARENTS, mean_skeleton
from robot_retarget.human.recognition import recognise

T = 12
RNG = np.random.default_rng(35)


def turns(joints: int) -> np.ndarray:
    return RNG.normal(0, 0.3, (T, 3 * joints))


def saved(tmp_path: Path, **arrays) -> Path:
    np.savez(tmp_path / "clip.npz", **arrays)
    return tmp_path / "clip.npz"


def expected(rotvecs: np.ndarray, trans: np.ndarray, offsets: np.ndarray) -> np.ndarray:
    """(T, 22, 3) by products of matrices along each chain."""
    places = np.zeros((T, 22, 3))
    for t in range(T):
        matrices: list[np.ndarray] = []
        for joint in range(22):
            local = np.eye(4)
            local[:3, :3] = Rotation.from_rotvec(rotvecs[t, 3 * joint : 3 * joint + 3]).as_matrix()
            local[:3, 3] = offsets[joint] + (trans[t] if joint == 0 else 0)
            matrices.append(local if joint == 0 else matrices[PARENTS[joint]] @ local)
            places[t, joint] = matrices[-1][:3, 3]
    return places


@pytest.mark.parametrize("joints", [22, 24, 52, 55])
def test_amass_of_any_width_turns_the_first_22_joints(tmp_path, joints):
    poses, trans = turns(joints), RNG.normal(0, 1, (T, 3))
    path = saved(tmp_path, poses=poses, trans=trans, betas=np.zeros(16), mocap_framerate=120.0, gender="neutral")
    capture = smpl.read(path, Request())
    assert capture.fps == 120 and capture.skeleton.names == NAMES
    skeleton, _ = mean_skeleton(None)
    assert capture.positions[:, :22] == pytest.approx(expected(poses, trans, np.array(skeleton.offsets)), abs=1e-9)


def test_every_spelling_of_the_same_pose_is_the_same_motion(tmp_path):
    poses, trans = turns(22), RNG.normal(0, 1, (T, 3))
    whole = smpl.read(saved(tmp_path, poses=poses, trans=trans), Request()).positions
    root, body = poses[:, :3], poses[:, 3:]
    matrices = Rotation.from_rotvec(poses.reshape(-1, 3)).as_matrix().reshape(T, 22, 3, 3)
    for arrays in (
        {"root_orient": root, "pose_body": body, "trans": trans},
        {"global_orient": root, "body_pose": body, "transl": trans, "betas": np.zeros((T, 10))},
        {"global_orient": root[:, None], "body_pose": body.reshape(T, 21, 3), "transl": trans},
        {"global_orient": matrices[:, :1], "body_pose": matrices[:, 1:], "transl": trans},
        {"global_orient": matrices[:, 0], "body_pose": matrices[:, 1:], "transl": trans},
        {"pose_world": poses, "trans_world": trans},
        {
            "smpl_params_global/global_orient": root,
            "smpl_params_global/body_pose": body,
            "smpl_params_global/transl": trans,
            "smpl_params_incam/global_orient": root + 1,
        },
    ):
        assert smpl.read(saved(tmp_path, **arrays), Request()).positions == pytest.approx(whole, abs=1e-9), list(arrays)


@pytest.mark.parametrize("up", ["+y", "+z"])
def test_a_standing_body_is_human_upright_and_as_tall_as_its_shape_says(tmp_path, up):
    poses = np.zeros((T, 66))
    if up == "+z":
        poses[:, 0] = np.pi / 2
    for beta in (-2.0, 0.0, 2.0):
        motion = read_motion(saved(tmp_path, poses=poses, trans=np.zeros((T, 3)), betas=[beta, 9.0]))
        recognition = recognise(motion.skeleton, motion.positions)
        assert recognition.keypoints == KEYPOINTS
        tall = np.ptp(recognition.place(motion.positions)[0, :, 2])
        assert tall == pytest.approx(0.9 * (1.66 + 0.1 * beta), rel=0.01), "toes to the head's joint"
        left = motion.positions[0, NAMES.index("left_hip")] - motion.positions[0, NAMES.index("right_hip")]
        ahead = motion.positions[0, NAMES.index("left_foot")] - motion.positions[0, NAMES.index("left_ankle")]
        assert np.cross(left, ahead)[2] < 0, "ahead × left is up"


def test_a_body_model_gives_its_own_joints(tmp_path):
    vertices = RNG.normal(0, 1, (40, 3))
    regressor = RNG.dirichlet(np.ones(40), 24)
    shapes = RNG.normal(0, 0.1, (40, 3, 10))
    np.savez(tmp_path / "SMPL.npz", J_regressor=regressor, v_template=vertices, shapedirs=shapes)
    betas = RNG.normal(0, 1, 10)
    path = saved(tmp_path, poses=np.zeros((T, 72)), trans=np.zeros((T, 3)), betas=betas)
    capture = smpl.read(path, Request(body_model=tmp_path / "SMPL.npz"))
    joints = np.einsum("jv,vd->jd", regressor, vertices + np.einsum("vdb,b->vd", shapes, betas))
    assert capture.positions[0, :22] == pytest.approx(joints[:22], abs=1e-12)
    np.savez(tmp_path / "SMPL.npz", v_template=vertices)
    with pytest.raises(MotionError, match=r"SMPL\.npz: a body model needs the array 'J_regressor'; it has v_template"):
        smpl.read(path, Request(body_model=tmp_path / "SMPL.npz"))
    np.savez(tmp_path / "p.npz", positions=np.zeros((4, 22, 3)))
    with pytest.raises(UsageError, match=r"p\.npz \(joint positions\): it has its own skeleton"):
        read_motion(tmp_path / "p.npz", body_model=tmp_path / "SMPL.npz")


def test_pickles_beside_the_parameters_are_left_out(tmp_path):
    """As AMASS files of SMPL-X have them."""
    path = saved(
        tmp_path, poses=turns(55), trans=np.zeros((T, 3)), markers_latent_vids=np.array({"a": 1}, dtype=object)
    )
    assert len(smpl.read(path, Request()).positions) == T


def test_a_field_of_another_width_is_named(tmp_path):
    trans = np.zeros((T, 3))
    for arrays, message in (
        ({"poses": np.zeros((T, 63)), "trans": trans}, r"poses: expected 66 numbers a frame or more, .*\(12, 63\)"),
        ({"poses": np.zeros((T, 67)), "trans": trans}, r"poses: expected 66 numbers a frame or more"),
        (
            {"poses": np.zeros((T, 66)), "trans": trans[1:]},
            r"trans: expected finite numbers \(12, 3\), got .*\(11, 3\)",
        ),
        ({"poses": np.full((T, 66), np.nan), "trans": trans}, "poses: frame 0 is not finite"),
        ({"body_pose": np.zeros((T, 60)), "global_orient": trans}, r"body_pose: expected 63 numbers"),
        ({"body_pose": np.zeros((T, 63)), "global_orient": trans[1:]}, "global_orient has 11 frames, body_pose 12"),
        ({"poses": np.zeros((T, 66)), "betas": np.array(["x"])}, "betas: expected finite numbers"),
        ({"poses": np.zeros((T, 66)), "fps": 0}, "fps must be one positive number"),
    ):
        with pytest.raises(MotionError, match=message):
            read_motion(saved(tmp_path, **arrays))
    still = smpl.read(saved(tmp_path, poses=np.zeros((T, 66))), Request())
    assert any("the body stays in place" in note for note in still.notes)
