"""`export`, `import` and `convert` as a user types them."""

from pathlib import Path

import numpy as np
import pytest
from forked import run
from format_moves import motion_of, robot_called

from robot_retarget.formats import FORMATS, export
from robot_retarget.trajectory import load_trajectory


def test_the_list_names_every_format_and_its_readers() -> None:
    done = run("export", "--list")
    assert done.returncode == 0, done.stderr
    for name in FORMATS:
        assert name in done.stdout
    assert "whole_body_tracking" in done.stdout


def test_import_finds_the_format_and_convert_goes_through(tmp_path: Path) -> None:
    motion = motion_of("op3")
    given = export(motion, robot_called("op3"), "gmr", tmp_path / "a.pkl")
    done = run("import", given, "--robot", "op3", "-o", tmp_path / "a.npz")
    assert done.returncode == 0 and "14 frames at 50 frames per second" in done.stdout, done.stderr
    np.testing.assert_array_equal(load_trajectory(tmp_path / "a.npz").qpos, motion.qpos)
    done = run("convert", given, "--robot", "op3", "--to", "kimodo", "--fps", "50", "-o", tmp_path / "b.csv")
    assert done.returncode == 0, done.stderr
    rows = np.loadtxt(tmp_path / "b.csv", delimiter=",")
    np.testing.assert_allclose(rows, motion.qpos, atol=1e-9)


def test_joints_come_from_a_list_or_a_file(tmp_path: Path) -> None:
    robot = robot_called("op3")
    given = export(motion_of("op3"), robot, "native", tmp_path / "a.npz")
    (tmp_path / "names.txt").write_text("head_tilt\nhead_pan\n")
    for number, joints in enumerate(("head_tilt,head_pan", str(tmp_path / "names.txt"))):
        out = tmp_path / f"{number}.csv"
        done = run("export", given, "--robot", "op3", "-f", "soma", "--joints", joints, "-o", out)
        assert done.returncode == 0, done.stderr
        assert out.read_text().splitlines()[0].endswith("root_rotateZ,head_tilt_dof,head_pan_dof")
    done = run("import", tmp_path / "0.csv", "--robot", "op3", "-o", tmp_path / "b.npz")
    assert done.returncode == 0 and "No column for l_sho_pitch" in done.stderr, done.stderr


@pytest.mark.parametrize("words, parts", [
    (["-f", "fbx"], ["fbx", "known: native, csv"]),
    ([], ["a.csv may be unitree or kimodo or protomotions-csv", "--format"]),
    (["-f", "unitree", "--joints", "tail"], ["1 joint names for 20 joint columns"]),
    (["-f", "mjlab"], ["a.csv as 'mjlab': no array 'joint_pos'"]),
    (["-f", "unitree", "--fps", "0"], ["positive"]),
    (["-f", "servo-ticks"], ["a.csv as 'servo-ticks'"]),
])  # fmt: skip
def test_mistakes_end_in_a_sentence_and_leave_nothing(tmp_path: Path, words: list[str], parts: list[str]) -> None:
    given = export(motion_of("op3"), robot_called("op3"), "unitree", tmp_path / "a.csv")
    (tmp_path / "a.csv.json").unlink()
    done = run("import", given, "--robot", "op3", *words, "-o", tmp_path / "out.npz")
    assert done.returncode == 2 and done.stderr.startswith("error: "), done.stderr
    assert "Traceback" not in done.stderr and all(part in done.stderr for part in parts), done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["a.csv"]
