"""Joint columns are matched by name with and without suffixes, and a file none of whose columns match is refused."""

import csv

import numpy as np
import pytest
from format_moves import motion_of, robot_called

from robot_retarget.base.errors import TrajectoryError
from robot_retarget.formats import FormatOptions, export, import_motion
from robot_retarget.formats.source import sidecar_path


@pytest.fixture(scope="module")
def op3():
    return robot_called("op3")


def renamed(path, rename):
    """The table with other names in its header; without the JSON file that stood beside it."""
    with path.open(encoding="utf-8", newline="") as stream:
        header, *rows = csv.reader(stream)
    with path.open("w", encoding="utf-8", newline="") as stream:
        csv.writer(stream, lineterminator="\n").writerows([[rename(name) for name in header], *rows])
    sidecar_path(path).unlink(missing_ok=True)
    return path


@pytest.mark.parametrize("suffix", ["_dof", "", "_joint", "_joint_dof"])
def test_soma_columns_are_matched_with_and_without_suffix(suffix: str, op3, tmp_path) -> None:
    motion = motion_of("op3", 120.0)
    path = export(motion, op3, "soma", tmp_path / "a.csv")
    renamed(path, lambda name: name.removesuffix("_dof") + suffix if name.endswith("_dof") else name)
    np.testing.assert_allclose(import_motion(path, op3).qpos, motion.qpos, atol=1e-9)


@pytest.mark.parametrize("format", ["soma", "csv", "servo-ticks"])
def test_a_table_of_which_no_joint_column_matches_is_refused(format: str, op3, tmp_path) -> None:
    path = export(motion_of("op3", 120.0), op3, format, tmp_path / "a.csv")
    joints = {name + end for name in op3.joint_names for end in ("_dof", " [rad]", " [tick]")}
    foreign = renamed(path, lambda name: "not_" + name if name in joints else name)
    with pytest.raises(TrajectoryError, match="'not_"):
        import_motion(foreign, op3, format)


@pytest.mark.parametrize("format", ["soma", "csv", "servo-ticks"])
def test_a_table_without_joint_columns_is_refused(format: str, op3, tmp_path) -> None:
    path = export(motion_of("op3", 120.0), op3, format, tmp_path / "a.csv")
    with path.open(encoding="utf-8", newline="") as stream:
        header, *rows = csv.reader(stream)
    kept = [k for k, name in enumerate(header) if not any(name.startswith(joint) for joint in op3.joint_names)]
    path.write_text("\n".join(",".join(row[k] for k in kept) for row in [header, *rows]) + "\n", encoding="utf-8")
    sidecar_path(path).unlink(missing_ok=True)
    with pytest.raises(TrajectoryError, match=r"no column of a joint|no 'time"):
        import_motion(path, op3, format)


def test_all_columns_left_out_by_the_user_is_refused(op3, tmp_path) -> None:
    path = export(motion_of("op3", 30.0), op3, "unitree", tmp_path / "a.csv")
    with pytest.raises(TrajectoryError, match="no column of a joint"):
        import_motion(path, op3, options=FormatOptions(joints=("_",) * 20))


def test_named_columns_of_radians_are_matched_with_and_without_suffix(op3, tmp_path) -> None:
    motion = motion_of("op3")
    path = export(motion, op3, "csv", tmp_path / "a.csv")
    renamed(path, lambda name: name.replace(" [rad]", "_joint [rad]"))
    np.testing.assert_allclose(import_motion(path, op3).qpos, motion.qpos, atol=1e-9)


def test_a_soma_table_that_skips_frames_is_refused(op3, tmp_path) -> None:
    path = export(motion_of("op3", 120.0), op3, "soma", tmp_path / "a.csv")
    lines = path.read_text(encoding="utf-8").splitlines()
    path.write_text("\n".join([*lines[:4], *lines[6:]]) + "\n", encoding="utf-8")
    sidecar_path(path).unlink()
    with pytest.raises(TrajectoryError, match="frame 5 follows frame 2"):
        import_motion(path, op3)
