"""Readers that know nothing of this package find the robot where it was: every body, every format, every robot."""

import mujoco
import numpy as np
import pytest
from format_moves import THERE, motion_of, robot_called
from restated_readers import READERS, Pose

from robot_retarget.formats import FORMATS, export


def forward(model: mujoco.MjModel, pose: Pose) -> np.ndarray:
    """(T, B, 3) where MuJoCo puts the bodies."""
    data, places = mujoco.MjData(model), []
    for t in range(len(pose.position)):
        data.qpos[:3], data.qpos[3:7] = pose.position[t], pose.wxyz[t]
        for name, angles in pose.joints.items():
            data.joint(name).qpos[0] = angles[t]
        mujoco.mj_kinematics(model, data)
        places.append(data.xpos.copy())
    return np.array(places)


def truth(name: str, fps: float) -> np.ndarray:
    motion, model = motion_of(name, fps), robot_called(name).model
    data, places = mujoco.MjData(model), []
    for qpos in motion.qpos:
        data.qpos[:] = qpos
        mujoco.mj_kinematics(model, data)
        places.append(data.xpos.copy())
    return np.array(places)


@pytest.mark.parametrize("name", THERE)
@pytest.mark.parametrize("format", READERS)
def test_an_independent_reader_puts_every_body_where_it_was(format: str, name: str, tmp_path) -> None:
    kind, robot = FORMATS[format], robot_called(name)
    fps = kind.fps or 50.0
    path = export(motion_of(name, fps), robot, format, tmp_path / f"m{kind.suffix}")
    pose, expected = READERS[format](path, robot.model), truth(name, fps)
    assert pose.fps == pytest.approx(fps, rel=1e-6)
    if not kind.root:  # what the file cannot hold is given
        pose.position, pose.wxyz = motion_of(name, fps).qpos[:, :3], motion_of(name, fps).qpos[:, 3:7]
    if format == "bvh":
        found = np.stack([(pose.bodies or {})[robot.model.body(b).name] for b in range(1, robot.model.nbody)], axis=1)
        np.testing.assert_allclose(found, expected[:, 1:], atol=1e-6)
    else:
        assert set(pose.joints) == set(robot.joint_names)
        np.testing.assert_allclose(forward(robot.model, pose), expected, atol=1e-6)


def in_root(model: mujoco.MjModel, pose: Pose, places: np.ndarray) -> np.ndarray:
    turn = np.empty((len(places), 9))
    for row, wxyz in zip(turn, pose.wxyz, strict=True):
        mujoco.mju_quat2Mat(row, wxyz)
    return np.einsum("tji,tj->ti", turn.reshape(-1, 3, 3), places - pose.position)


@pytest.mark.parametrize("name", THERE)
@pytest.mark.parametrize(
    "format",
    [
        "gmr",
        "beyondmimic",
        "mjlab",
        "omniretarget-training",
        "locomujoco",
        "keyframe-kit",
        "mcap",
        "isaaclab-amp",
        "sonic",
        "protomotions",
    ],
)
def test_bodies_in_a_file_stand_where_the_joints_put_them(format: str, name: str, tmp_path) -> None:
    robot, fps = robot_called(name), FORMATS[format].fps or 50.0
    pose = READERS[format](export(motion_of(name, fps), robot, format, tmp_path / "m"), robot.model)
    expected = truth(name, fps)
    assert pose.bodies and set(pose.bodies) <= {robot.model.body(b).name for b in range(robot.model.nbody)}
    assert len(pose.bodies) >= robot.model.nbody - 1
    for body, places in pose.bodies.items():
        wanted = expected[:, robot.model.body(body).id]
        wanted = in_root(robot.model, pose, wanted) if format == "gmr" else wanted
        np.testing.assert_allclose(places, wanted, atol=1e-6)
