"""The programs themselves read what is written, where they are installed, or their repositories are clones in the folder that
the environment names THEIR_REPOSITORIES."""

import importlib.util
import os
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from format_moves import motion_of, robot_called

from robot_retarget.formats import export, import_motion


def their_file(path: str) -> ModuleType:
    """A file of a clone, as a module by itself."""
    file = Path(os.environ.get("THEIR_REPOSITORIES", "")) / path
    if "THEIR_REPOSITORIES" not in os.environ or not file.is_file():
        pytest.skip(f"no {path} in THEIR_REPOSITORIES")
    spec = importlib.util.spec_from_file_location(file.stem, file)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_gmr_loads_its_pickle(tmp_path) -> None:
    loader = their_file("GMR/general_motion_retargeting/data_loader.py")
    robot, motion = robot_called("op3"), motion_of("op3")
    _, fps, place, turn, angles, bodies, names = loader.load_robot_motion(
        export(motion, robot, "gmr", tmp_path / "a.pkl")
    )
    assert fps == motion.fps and bodies.shape[:2] == (len(motion), len(names))
    np.testing.assert_allclose(np.concatenate([place, turn, angles], axis=1), motion.qpos, atol=1e-9)


def test_mimickit_loads_its_motion(tmp_path) -> None:
    loader = their_file("MimicKit/mimickit/anim/motion.py")
    robot, motion = robot_called("op3"), motion_of("op3")
    loaded = loader.load_motion(export(motion, robot, "mimickit", tmp_path / "a.pkl"))
    assert loaded.loop_mode is loader.LoopMode.CLAMP and loaded.get_length() == pytest.approx(motion.duration)
    np.testing.assert_allclose(loaded.frames[:, 6:], motion.qpos[:, 7:], atol=1e-6)


def test_isaac_lab_loads_its_amp_archive(tmp_path) -> None:
    folder = "IsaacLab/source/isaaclab_tasks/isaaclab_tasks/direct/humanoid_amp/motions"
    loader = their_file(f"{folder}/motion_loader.py")
    robot, motion = robot_called("op3"), motion_of("op3")
    loaded = loader.MotionLoader(str(export(motion, robot, "isaaclab-amp", tmp_path / "a.npz")), "cpu")
    assert loaded.dof_names == list(robot.joint_names) and loaded.dt == pytest.approx(1 / motion.fps)
    np.testing.assert_allclose(loaded.dof_positions.numpy(), motion.qpos[:, 7:], atol=1e-6)
    np.testing.assert_allclose(loaded.body_positions[:, 0].numpy(), motion.qpos[:, :3], atol=1e-6)


def test_mjlab_loads_its_archive(tmp_path) -> None:
    commands = pytest.importorskip("mjlab.tasks.tracking.mdp.commands", reason="mjlab is not installed")
    torch = pytest.importorskip("torch")
    robot, motion = robot_called("op3"), motion_of("op3")
    path = export(motion, robot, "mjlab", tmp_path / "a.npz")
    loaded = commands.MotionLoader(str(path), torch.arange(robot.model.nbody - 1))
    assert loaded.time_step_total == len(motion)
    np.testing.assert_allclose(loaded.joint_pos.numpy(), motion.qpos[:, 7:], atol=1e-6)


def test_locomujoco_loads_its_trajectory(tmp_path) -> None:
    theirs = pytest.importorskip("loco_mujoco.trajectory.dataclasses", reason="loco-mujoco is not installed")
    robot, motion = robot_called("op3"), motion_of("op3")
    loaded = theirs.Trajectory.load(str(export(motion, robot, "locomujoco", tmp_path / "a.npz")), backend=np)
    np.testing.assert_array_equal(loaded.data.qpos, motion.qpos)
    assert loaded.info.frequency == 50 and loaded.info.joint_names[1:] == list(robot.joint_names)


def test_the_keyframe_editor_opens_its_file(tmp_path) -> None:
    kit = pytest.importorskip("robot_keyframe_kit", reason="robot-keyframe-kit is not installed")
    robot, motion = robot_called("op3"), motion_of("op3")
    path = export(motion, robot, "keyframe-kit", tmp_path / "a.lz4")
    editor = kit.ViserKeyframeEditor(str(robot.path), data_path=str(path))
    np.testing.assert_array_equal(editor.qpos_replay, motion.qpos)
    assert [name for name, _ in editor.sequence_list] == [keyframe.name for keyframe in editor.keyframes]


def test_holosoma_converts_its_archive(tmp_path) -> None:
    """Its MotionLoader, constructed as its converter does, on the file as it is written: every frame at 30 a second."""
    convert = pytest.importorskip("holosoma_retargeting.data_conversion.convert_data_format_mj", reason="not installed")
    robot, motion = robot_called("op3"), motion_of("op3", 30.0)
    path = export(motion, robot, "omniretarget", tmp_path / "a.npz")
    loader = convert.MotionLoader(str(path), 30, 30, "cpu", None, False, False)
    assert loader.duration == pytest.approx(motion.duration)
    np.testing.assert_allclose(loader.motion_base_rots_input.numpy(), motion.qpos[:, 3:7], atol=1e-6)


def test_lerobot_loads_its_data_set_and_batches_it(tmp_path, monkeypatch) -> None:
    monkeypatch.setenv("HF_HUB_OFFLINE", "1")
    datasets = pytest.importorskip("lerobot.datasets.lerobot_dataset", reason="lerobot is not installed")
    torch = pytest.importorskip("torch")
    robot, motion = robot_called("op3"), motion_of("op3")
    path = export(motion, robot, "lerobot", tmp_path / "a")
    loaded = datasets.LeRobotDataset("local/a", root=path, delta_timestamps={"action": [0.0, 0.02]})
    assert (len(loaded), loaded.num_episodes, loaded.fps) == (len(motion), 1, 50)
    assert loaded.features["action"]["names"] == [f"{joint}.pos" for joint in robot.joint_names]
    batch = next(iter(torch.utils.data.DataLoader(loaded, batch_size=len(motion))))
    np.testing.assert_allclose(batch["observation.state"].numpy(), motion.qpos[:, 7:], atol=1e-6)
    np.testing.assert_allclose(batch["action"][:-1, 0].numpy(), motion.qpos[1:, 7:], atol=1e-6)
    assert batch["task"] == ["made"] * len(motion) and not batch["action_is_pad"][0].any()
    np.testing.assert_allclose(loaded.meta.stats["action"]["max"][0], motion.qpos[1:, 7].max(), atol=1e-6)


def test_a_data_set_that_lerobot_wrote_gives_its_first_episode(tmp_path, monkeypatch) -> None:
    monkeypatch.setenv("HF_HUB_OFFLINE", "1")
    datasets = pytest.importorskip("lerobot.datasets.lerobot_dataset", reason="lerobot is not installed")
    robot, motion = robot_called("op3"), motion_of("op3")
    names = [f"{joint}.pos" for joint in reversed(robot.joint_names)]
    features = {"observation.state": {"dtype": "float32", "shape": (len(names),), "names": names}}
    made = datasets.LeRobotDataset.create("local/b", fps=50, features=features, root=tmp_path / "b", use_videos=False)
    for episode in (motion.qpos[:, 7:], -motion.qpos[:, 7:]):
        for angles in episode[:, ::-1].astype("f4"):
            made.add_frame({"observation.state": angles, "task": "move"})
        made.save_episode()
    made.finalize()
    read = import_motion(tmp_path / "b", robot)
    np.testing.assert_allclose(read.qpos[:, 7:], motion.qpos[:, 7:], atol=1e-6)
    assert any("first of 2 episodes" in note for note in read.notes)


def test_pytorch_loads_a_motion_of_protomotions_as_plain_tensors(tmp_path) -> None:
    torch = pytest.importorskip("torch", reason="torch is not installed")
    robot, motion = robot_called("op3"), motion_of("op3")
    loaded = torch.load(export(motion, robot, "protomotions", tmp_path / "a.motion"), weights_only=True)
    np.testing.assert_allclose(loaded["dof_pos"].numpy(), motion.qpos[:, 7:], atol=1e-6)
    assert loaded["rigid_body_contacts"].dtype == torch.bool and loaded["fps"] == motion.fps


def test_protomotions_loads_its_motion_into_its_library(tmp_path) -> None:
    lib = pytest.importorskip("protomotions.components.motion_lib", reason="ProtoMotions is not on the path")
    torch = pytest.importorskip("torch")
    robot, motion = robot_called("op3"), motion_of("op3")
    path = export(motion, robot, "protomotions", tmp_path / "a.motion")
    loaded = lib.MotionLib(lib.MotionLibConfig(motion_file=str(path)))
    state = loaded.get_motion_state(torch.tensor([0]), torch.tensor([3 / motion.fps]))
    np.testing.assert_allclose(state.dof_pos[0].numpy(), motion.qpos[3, 7:], atol=1e-5)
    np.testing.assert_allclose(state.rigid_body_pos[0, 0].numpy(), motion.qpos[3, :3], atol=1e-5)
