"""Files that are broken or hold nonsense end in a sentence: never in a traceback, never in a number that is used."""

import json
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from made_trajectories import wander

from robot_retarget.actuators.map import load_map
from robot_retarget.base.errors import (
    MatchError,
    MotionError,
    RobotError,
    RobotRetargetError,
    ServoError,
    TrajectoryError,
)
from robot_retarget.base.files import SAMPLES
from robot_retarget.formats import import_motion
from robot_retarget.graph.edits import read_edits
from robot_retarget.human.match import match
from robot_retarget.human.read import read_motion
from robot_retarget.judge.verdict import read_thresholds
from robot_retarget.live.sources import load_calibration, save_calibration
from robot_retarget.robot import load_robot
from robot_retarget.robot.catalog import read_limits
from robot_retarget.servo.judgement import require_judged
from robot_retarget.tools.batch.filters import read_filters
from robot_retarget.trajectory import load_trajectory

OP3 = load_robot("op3")
WAVE = read_motion(SAMPLES / "wave.bvh")
NESTED = 6000


def trajectory_file(folder: Path) -> Path:
    return wander(OP3).save(folder / "t.npz")


def calibration_file(folder: Path) -> Path:
    save_calibration(WAVE.frames(0, 5), folder / "c.npz")
    return folder / "c.npz"


READERS = {"trajectory": (trajectory_file, load_trajectory), "calibration": (calibration_file, load_calibration)}


@pytest.mark.parametrize("kind", READERS)
def test_flipped_bits_and_cut_files_are_read_or_refused_in_a_sentence(kind: str, tmp_path: Path) -> None:
    made, read = READERS[kind]
    whole, rng = made(tmp_path).read_bytes(), np.random.default_rng(0)
    broken = tmp_path / "broken.npz"
    for case in range(300):
        data = bytearray(whole)
        if case % 3 == 0:
            data = data[: rng.integers(len(data))]
        for place in rng.integers(len(data) or 1, size=rng.integers(1, 4)) if data else ():
            data[place] ^= 1 << int(rng.integers(8))
        broken.write_bytes(data)
        try:
            read(broken)
        except RobotRetargetError as error:
            assert str(broken) in str(error) and "\n" not in str(error)


def altered(path: Path, **values: Any) -> Path:
    """The same file with other arrays; None leaves one out."""
    with np.load(path) as archive:
        arrays: dict[str, Any] = {name: value for name, value in (dict(archive) | values).items() if value is not None}
    np.savez(path, **arrays)
    return path


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"fps": "thirty"}, "fps must be of kind number"),
        ({"fps": [30.0, 30.0]}, "fps must be (), got (2,)"),
        ({"fps": 1e-308}, "fps must be in 0.01"),
        ({"fps": 1e308}, "fps must be in 0.01"),
        ({"format_version": "two"}, "format_version must be of kind integer"),
        ({"format_version": [2, 2]}, "format_version must be ()"),
        ({"qpos": np.zeros(27)}, "qpos must be (T, nq)"),
        ({"qpos": np.full((3, 27), "0")}, "qpos must be of kind number"),
        ({"qpos": np.zeros((40, 27))}, "quaternion has norm 0 at frame 0"),
        ({"qpos": np.full((40, 27), 1e9)}, "qpos is 1e+09 rad, more than 100, at frame 0, column 7"),
        ({"qpos": np.zeros((40, 5))}, "qpos has 5 columns for 20 joints"),
        ({"joint_names": ["a"] * 20}, "joint_names has 'a' twice"),
        ({"joint_names": np.arange(20)}, "joint_names must be of kind text"),
        ({"goals": "all"}, "goals must be of kind number"),
        ({"goals_rate": "fast"}, "goals_rate must be of kind number"),
        ({"robot": None}, "no key 'robot'"),
    ],
)
def test_a_trajectory_of_nonsense_is_refused_by_key(wrong: dict[str, Any], message: str, tmp_path: Path) -> None:
    with pytest.raises(TrajectoryError) as refused:
        load_trajectory(altered(trajectory_file(tmp_path), **wrong))
    assert message in str(refused.value)


def test_goals_beyond_sixteen_turns_are_refused(tmp_path: Path) -> None:
    goals = {"goals": np.full((300, 20), 3e5), "goals_rate": 125.0, "goals_lead_in": 0.0, "goals_lead_out": 0.0}
    with pytest.raises(TrajectoryError, match=r"goals is 300000 rad, more than 100, at row 0, column 0"):
        load_trajectory(altered(trajectory_file(tmp_path), **goals, goals_servos=""))


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"fps": "fast"}, "fps must be of kind number"),
        ({"fps": 1e-308}, "fps must be in 1 … 1000"),
        ({"positions": np.full((5, 1, 3), 0.0)}, "positions must be (5, 27, 3)"),
        ({"offsets": 1e9}, "offsets must be (27, 3)"),
        ({"parents": 0.5}, "parents must be of kind integer"),
        ({"names": None}, "no key 'names'"),
    ],
)
def test_a_calibration_of_nonsense_is_refused_by_key(wrong: dict[str, Any], message: str, tmp_path: Path) -> None:
    with pytest.raises(MotionError) as refused:
        load_calibration(altered(calibration_file(tmp_path), **wrong))
    assert message in str(refused.value)


def test_joints_at_a_million_kilometres_are_refused(tmp_path: Path) -> None:
    with pytest.raises(MotionError, match=r"positions must be in -10000 … 10000, got 1e\+09 at \[0, 0, 0\]"):
        load_calibration(altered(calibration_file(tmp_path), positions=np.full(WAVE.frames(0, 5).positions.shape, 1e9)))


def test_rotations_that_are_no_quaternions_are_refused(tmp_path: Path) -> None:
    with pytest.raises(MotionError, match="rotations must be unit quaternions"):
        load_calibration(altered(calibration_file(tmp_path), rotations=np.zeros((5, len(WAVE.skeleton), 4))))


def test_a_header_of_a_thousand_million_rows_takes_no_memory(tmp_path: Path) -> None:
    path = trajectory_file(tmp_path)
    header = b"{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000, 27), }"
    huge = b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header + bytes(64)
    with zipfile.ZipFile(path) as archive:
        rest = {name: archive.read(name) for name in archive.namelist() if name != "qpos.npy"}
    with zipfile.ZipFile(path, "w") as archive:
        for name, data in (rest | {"qpos.npy": huge}).items():
            archive.writestr(name, data)
    with pytest.raises(TrajectoryError, match="states 216000000000 bytes"):
        load_trajectory(path)


MANY_DIGITS = "1" + "0" * 400
"""Of an integer that no float holds."""
TOML_READERS = {
    "limits": (read_limits, RobotError),
    "map": (lambda path: match(WAVE, OP3, path), MatchError),
    "servos": (load_map, ServoError),
    "edits": (read_edits, RobotRetargetError),
    "thresholds": (read_thresholds, RobotRetargetError),
    "filters": (read_filters, RobotRetargetError),
}


@pytest.mark.parametrize("kind", TOML_READERS)
@pytest.mark.parametrize(
    "text",
    [
        f"a = {'[' * NESTED}{']' * NESTED}",
        "a = ",
        "\x00",
        "range = 3",
        "edge = [1]",
        f"[speed]\nl_knee = {MANY_DIGITS}",
    ],
    ids=range(6),
)
def test_toml_that_is_none_is_refused_by_its_file(kind: str, text: str, tmp_path: Path) -> None:
    read, error = TOML_READERS[kind]
    path = tmp_path / "file.toml"
    path.write_text(text)
    with pytest.raises(error, match=r"file\.toml"):
        read(path)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("range = 3", r"range must be a table, \[range\], got 3"),
        ("[speed]\nl_knee = 0", r"l_knee must be a number, got 0 \(over 0, at most 1000 rad/s\)"),
        ("[speed]\nl_knee = true", "l_knee must be a number, got"),
        ("[torque]\nl_knee = 0.0", "l_knee must be a number, got"),
        ("[torque]\nl_knee = nan", "l_knee must be a number, got"),
        (
            "[range]\nl_knee = [nan, 1.0]",
            r"l_knee must be \[lower, upper\], got .* \(radians within ±6.28; more looks like degrees\)",
        ),
        ("[range]\nl_knee = [-1e9, 1e9]", r"l_knee must be \[lower, upper\]"),
    ],
)
def test_limits_of_nonsense_are_refused(text: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "limits.toml").write_text(text)
    with pytest.raises(RobotError, match=message):
        read_limits(tmp_path / "limits.toml")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[human]\nl_hand = -1", "l_hand must be"),
        ("[human]\nl_hand = [1]", "l_hand must be"),
        ('[robot]\nl_hand = ["l_el_link", 1e9, 0, 0]', "within 10 m"),
        ('[robot]\nl_hand = ["l_el_link", nan, 0, 0]', "within 10 m"),
        ('[robot]\nl_hand = ["l_el_link", "0", 0, 0]', "within 10 m"),
        ("[robot]\nforward = [inf, 0, 0]", "forward must be"),
        ("human = 3", r"human must be a table, \[human\], got 3"),
    ],
)
def test_maps_of_nonsense_are_refused(text: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "map.toml").write_text(text)
    with pytest.raises(MatchError, match=message):
        match(WAVE, OP3, tmp_path / "map.toml")


@pytest.mark.parametrize("text", ["[" * 100_000, "{", json.dumps(["a"]), "\x00", '{"figures": 3}'])
def test_a_report_that_is_none_is_refused(text: str, tmp_path: Path) -> None:
    path = trajectory_file(tmp_path)
    (tmp_path / "report.json").write_text(text)
    with pytest.raises(ServoError, match="report"):
        require_judged(path, load_trajectory(path), load_map("op3"), "op3")


@pytest.mark.parametrize(
    ("text", "read"),
    [
        ('{"Loop": "none", "Frames": [[%s, 1, 2]]}', read_motion),
        ('{"fps": %s, "frames": [{"landmarks": [[0, 0, 0]]}]}', read_motion),
        ("joint_names: [a]\npoints: [{positions: [%s], time_from_start: {sec: 1}}]", lambda p: import_motion(p, OP3)),
        ("joint_names: [a]\npoints: [{positions: [1], time_from_start: {sec: %s}}]", lambda p: import_motion(p, OP3)),
    ],
    ids=range(4),
)  # fmt: skip
def test_an_integer_that_no_float_holds_is_refused(text: str, read: Any, tmp_path: Path) -> None:
    path = tmp_path / "file.json"
    path.write_text(text % MANY_DIGITS)
    with pytest.raises(RobotRetargetError, match=r"file\.json"):
        read(path)


@pytest.mark.parametrize("length", [1, 1989, 1990, 1991, 30_000])
def test_no_message_is_longer_than_a_page_and_both_its_ends_are_there(length: int) -> None:
    said = str(RobotRetargetError(f"begin {'x' * length} end"))
    assert len(said) == min(length + 10, 1999) if length > 1990 else len(said) == length + 10
    assert said.startswith("begin ") and said.endswith(" end")
    assert (" … " in said) == (length > 1990)
