"""Exported files read back as the solved motion; a motion that does not fit is refused before a file appears."""

import csv

import numpy as np
import pytest
from made_trajectories import RAIL, hold, robot_of, wander

from robot_retarget.base.errors import OutputError, TrajectoryError, UsageError
from robot_retarget.formats import FORMATS, export
from robot_retarget.robot import load_robot
from robot_retarget.trajectory import Trajectory


@pytest.fixture(scope="module")
def op3():
    return load_robot("op3")


@pytest.fixture
def rail(tmp_path):
    return robot_of(RAIL, tmp_path / "rail.xml")


def read_csv(path):
    with path.open(newline="", encoding="utf-8") as stream:
        header, *rows = csv.reader(stream)
    return header, np.array(rows, dtype=float)


def test_csv_reads_back_as_the_same_configurations(op3, tmp_path):
    trajectory = wander(op3)
    header, rows = read_csv(export(trajectory, op3, "csv", tmp_path / "t.csv"))
    assert header[:9] == [
        "time [s]", "root_x [m]", "root_y [m]", "root_z [m]",
        "root_qw [-]", "root_qx [-]", "root_qy [-]", "root_qz [-]", "head_pan [rad]",
    ]  # fmt: skip
    assert [name.removesuffix(" [rad]") for name in header[8:]] == [
        *op3.joint_names,
        "left_foot_contact [-]",
        "right_foot_contact [-]",
    ]
    np.testing.assert_allclose(rows[:, 1:-2], trajectory.qpos, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(rows[:, 0], np.arange(len(trajectory)) / trajectory.fps, rtol=1e-9)


def test_csv_names_slides_in_metres_and_quotes_commas(rail, tmp_path):
    trajectory = Trajectory(np.array([[0.1, 0.2, 0.3]]), 10, rail.joint_names, rail.name)
    header, rows = read_csv(export(trajectory, rail, "csv", tmp_path / "t.csv"))
    assert header == ["time [s]", "travel [m]", "lift [m]", "shoulder, left [rad]"]
    np.testing.assert_allclose(rows, [[0, 0.1, 0.2, 0.3]])


def test_unitree_rows_are_position_quaternion_xyzw_and_joints(op3, tmp_path):
    trajectory = wander(op3, fps=30)
    rows = np.loadtxt(export(trajectory, op3, "unitree", tmp_path / "t.csv"), delimiter=",")
    assert rows.shape == (len(trajectory), 7 + len(op3.joint_names))
    np.testing.assert_allclose(rows[:, :3], trajectory.qpos[:, :3], atol=1e-8)
    np.testing.assert_allclose(rows[:, 7:], trajectory.qpos[:, 7:], atol=1e-8)
    same = np.abs(np.einsum("ti,ti->t", rows[:, [6, 3, 4, 5]], trajectory.qpos[:, 3:7]))
    np.testing.assert_allclose(same, 1, atol=1e-7)


@pytest.mark.parametrize("fps", [24.0, 50.0, 120.0])
def test_unitree_runs_at_thirty_frames_per_second(op3, tmp_path, fps):
    trajectory = wander(op3, frames=61, fps=fps)
    rows = np.loadtxt(export(trajectory, op3, "unitree", tmp_path / "t.csv"), delimiter=",")
    assert len(rows) == int(60 / fps * 30 + 1e-9) + 1
    np.testing.assert_allclose(rows[:, 0] - rows[0, 0], 0.3 * np.arange(len(rows)) / 30, atol=1e-8)


def test_unitree_quaternions_never_jump_to_their_negative(op3, tmp_path):
    trajectory = wander(op3, frames=150, fps=50)
    flipped = trajectory.qpos.copy()
    flipped[::3, 3:7] *= -1
    flipped = Trajectory(flipped, 50, op3.joint_names, op3.name)
    rows = np.loadtxt(export(flipped, op3, "unitree", tmp_path / "t.csv"), delimiter=",")
    assert (np.einsum("ti,ti->t", rows[1:, 3:7], rows[:-1, 3:7]) > 0.9).all()


def test_unitree_refuses_a_root_that_is_not_free(rail, tmp_path):
    with pytest.raises(UsageError, match="free root"):
        export(hold(rail), rail, "unitree", tmp_path / "t.csv")
    assert not (tmp_path / "t.csv").exists()


def test_an_unknown_format_is_refused_with_the_known_ones(op3, tmp_path):
    with pytest.raises(UsageError, match="'fbx'; known: " + ", ".join(FORMATS)):
        export(hold(op3), op3, "fbx", tmp_path / "t.fbx")


def test_a_trajectory_of_another_robot_is_refused_by_its_first_foreign_joint(op3, tmp_path):
    names = (*op3.joint_names[:4], "tail", *op3.joint_names[5:])
    foreign = Trajectory(hold(op3).qpos, 50, names, "lizard")
    with pytest.raises(TrajectoryError, match=f"'lizard'.*joint 4 is 'tail', here '{op3.joint_names[4]}'"):
        export(foreign, op3, "csv", tmp_path / "t.csv")
    short = Trajectory(hold(op3).qpos[:, :-1], 50, op3.joint_names[:-1], "op3")
    with pytest.raises(TrajectoryError, match="19 joints, here 20"):
        export(short, op3, "csv", tmp_path / "t.csv")
    rootless = Trajectory(hold(op3).qpos[:, 7:], 50, op3.joint_names, "op3")
    with pytest.raises(TrajectoryError, match="20 coordinates, here 27"):
        export(rootless, op3, "csv", tmp_path / "t.csv")


def test_a_folder_that_is_not_there_leaves_nothing(op3, tmp_path):
    with pytest.raises(OutputError, match="missing"):
        export(hold(op3), op3, "csv", tmp_path / "missing" / "t.csv")
    assert not list(tmp_path.iterdir())
