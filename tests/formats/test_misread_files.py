"""Files that were refused or misread: each is read as its program means it, or refused with the reason."""

import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from format_moves import THERE, motion_of, robot_called
from made_trajectories import wander

from robot_retarget.base.errors import TrajectoryError
from robot_retarget.base.files import plain_cell
from robot_retarget.formats import export, import_motion

pytestmark = pytest.mark.skipif("g1" not in THERE, reason="needs the G1")


def test_bodies_that_the_joints_do_not_put_there_are_refused_whatever_the_format_is_called(tmp_path: Path) -> None:
    robot, path = robot_called("g1"), tmp_path / "a.npz"
    export(motion_of("g1"), robot, "beyondmimic", path)
    arrays = dict(np.load(path))
    assert len(import_motion(path, robot, "beyondmimic")) == len(motion_of("g1"))
    shuffled = np.random.default_rng(0).permutation(len(robot.joint_names))
    np.savez(path, **{**arrays, "joint_pos": arrays["joint_pos"][:, shuffled]})
    with pytest.raises(TrajectoryError, match=r"bodies are up to .* m from where the joints put them"):
        import_motion(path, robot, "beyondmimic")
    del arrays["joint_names"]
    np.savez(path, **{**arrays, "joint_pos": arrays["joint_pos"][:, shuffled]})
    with pytest.raises(TrajectoryError, match=r"bodies are up to .* m from where"):
        import_motion(path, robot, "beyondmimic")


def test_the_enumeration_in_a_motion_of_protomotions_is_its_word(tmp_path: Path) -> None:
    """Their files name `StateConversion`, an enumeration of text, beside the tensors."""
    robot, plain, theirs = robot_called("g1"), tmp_path / "a.motion", tmp_path / "b.motion"
    export(motion_of("g1"), robot, "protomotions", plain)
    called = b"cprotomotions.simulator.base_simulator.simulator_state\nStateConversion\n(X\x06\x00\x00\x00commontR"
    with zipfile.ZipFile(plain) as old, zipfile.ZipFile(theirs, "w") as new:
        for name in old.namelist():
            data = old.read(name)
            if name.endswith("data.pkl"):
                data = data.removesuffix(b"u.") + b"X\x10\x00\x00\x00state_conversion" + called + b"u."
            new.writestr(name, data)
    found, expected = import_motion(theirs, robot), import_motion(plain, robot)
    np.testing.assert_array_equal(found.qpos, expected.qpos)


def test_the_metadata_of_sonic_name_the_motion(tmp_path: Path) -> None:
    moved = replace(motion_of("g1"), source="clips/dance.bvh")
    export(moved, robot_called("g1"), "sonic", tmp_path / "out")
    assert (tmp_path / "out" / "metadata.txt").read_text().startswith("Metadata for: dance\n")


def test_a_heading_that_a_spreadsheet_would_run_is_text_and_reads_back(tmp_path: Path) -> None:
    import robot_retarget as rr

    model = tmp_path / "a.xml"
    joints = "".join(
        f'<body pos="0 0 {k}"><joint name="{name}" axis="0 1 0" range="-1 1"/><geom size=".1"/></body>'
        for k, name in enumerate(("=1+1", "@SUM(1)", "-a", "plain"))
    )
    model.write_text(f'<mujoco><compiler angle="radian"/><worldbody>{joints}</worldbody></mujoco>')
    robot = rr.load_robot(model)
    made = wander(robot, frames=5)
    export(made, robot, "csv", tmp_path / "a.csv")
    heading = (tmp_path / "a.csv").read_text().splitlines()[0].split(",")
    assert heading[1:] == ["'=1+1 [rad]", "'@SUM(1) [rad]", "'-a [rad]", "plain [rad]"]
    np.testing.assert_allclose(import_motion(tmp_path / "a.csv", robot, "csv").qpos, made.qpos, atol=1e-9)
    assert plain_cell("plain") == "plain"
