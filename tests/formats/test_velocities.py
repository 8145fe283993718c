"""Velocities in files equal those that the programs of the format compute, and those of the bodies."""

import mujoco
import numpy as np
import pytest
from format_moves import THERE, motion_of, robot_called

from robot_retarget.formats import FormatOptions, export
from robot_retarget.trajectory import Trajectory

TRACKING = ("beyondmimic", "mjlab", "omniretarget-training")


def product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    out = np.empty_like(a)
    for row, left, right in zip(out, a, b, strict=True):
        mujoco.mju_mulQuat(row, left, right)
    return out


def so3_derivative(wxyz: np.ndarray, fps: float) -> np.ndarray:
    """csv_to_npz's: axis-angle of q_next q_prev⁻¹ over two frames, first and last repeated."""
    relative = product(wxyz[2:], wxyz[:-2] * [1, -1, -1, -1])
    half = np.arccos(np.clip(relative[:, :1], -1, 1))
    omega = relative[:, 1:] / np.sin(half) * 2 * half * fps / 2
    return np.concatenate([omega[:1], omega, omega[-1:]])


def gradient(values: np.ndarray, fps: float) -> np.ndarray:
    """torch.gradient's: central inside, one-sided at the ends."""
    inner = (values[2:] - values[:-2]) * fps / 2
    return np.concatenate([(values[1:2] - values[:1]) * fps, inner, (values[-1:] - values[-2:-1]) * fps])


@pytest.mark.parametrize("name", THERE)
@pytest.mark.parametrize("format", TRACKING)
def test_root_and_joints_move_as_csv_to_npz_moves_them(format: str, name: str, tmp_path) -> None:
    motion, robot = motion_of(name), robot_called(name)
    data = np.load(export(motion, robot, format, tmp_path / "a.npz"))
    root = 1 if format == "omniretarget-training" else 0
    np.testing.assert_allclose(data["body_ang_vel_w"][:, root], so3_derivative(motion.qpos[:, 3:7], 50), atol=1e-9)
    joints = data["joint_vel"][:, 6:] if root else data["joint_vel"]
    names = list(data["joint_names"])
    order = [robot.joint_names.index(joint) for joint in names]
    np.testing.assert_allclose(joints, gradient(motion.qpos[:, 7:], 50)[:, order], atol=1e-9)
    if format == "mjlab":  # its frame is the link's; the others' is the centre of mass
        np.testing.assert_allclose(data["body_lin_vel_w"][:, root], gradient(motion.qpos[:, :3], 50), atol=1e-9)


@pytest.mark.parametrize("format", TRACKING)
def test_bodies_move_as_their_positions_do(format: str, tmp_path) -> None:
    """Linear velocities of origins, or of centres of mass, are the slopes of their paths, in a finely sampled motion."""
    robot, fps = robot_called("op3"), 2000.0
    times = np.arange(9)[:, None] / fps
    qpos = np.tile(robot.standing(), (9, 1))
    qpos[:, :3] += times * [0.4, -0.3, 0.2]
    qpos[:, 3:7] = np.hstack([np.cos(times), 0 * times, 0.6 * np.sin(times), 0.8 * np.sin(times)])
    qpos[:, 7:] += np.sin(times * np.linspace(1, 3, 20))
    motion = Trajectory(qpos, fps, robot.joint_names, robot.name)
    data = np.load(export(motion, robot, format, tmp_path / "a.npz", FormatOptions(fps=fps)))
    places = data["body_pos_w"]
    if format != "mjlab":
        ids = [robot.model.body(str(body)).id for body in data["body_names"]]
        turns = np.empty((*places.shape[:2], 9))
        for t, b in np.ndindex(*places.shape[:2]):
            mujoco.mju_quat2Mat(turns[t, b], data["body_quat_w"][t, b])
        turns = turns.reshape(*places.shape[:2], 3, 3)
        places = places + np.einsum("tbij,bj->tbi", turns, robot.model.body_ipos[ids])
    slope = (places[2:] - places[:-2]) * fps / 2
    np.testing.assert_allclose(data["body_lin_vel_w"][1:-1], slope, atol=2e-5)


def test_locomujoco_qvel_leads_from_frame_to_frame(tmp_path) -> None:
    motion, robot = motion_of("op3"), robot_called("op3")
    data = np.load(export(motion, robot, "locomujoco", tmp_path / "a.npz"))
    for t in range(1, len(motion) - 1):
        between = np.zeros(robot.model.nv)
        mujoco.mj_differentiatePos(robot.model, between, 2 / 50, motion.qpos[t - 1], motion.qpos[t + 1])
        np.testing.assert_allclose(data["qvel"][t, :3], between[:3], atol=1e-9)
        np.testing.assert_allclose(data["qvel"][t, 6:], between[6:], atol=1e-9)
        assert np.linalg.norm(data["qvel"][t, 3:6]) == pytest.approx(np.linalg.norm(between[3:6]), abs=1e-9)
