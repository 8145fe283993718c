"""Loading robots: names, files, roots of every kind, limits, and what goes wrong."""

from pathlib import Path

import numpy as np
import pytest

from robot_retarget.base.errors import RobotError
from robot_retarget.robot import load_robot, shipped_robots

ARM = """<mujoco><worldbody><body name="base">{root}<geom size=".1" mass="1"/>
<body name="upper" pos="0 0 .2"><joint name="shoulder" {range}/><geom size=".1" mass="1"/></body></body></worldbody></mujoco>"""


def write(folder: Path, root: str = "<freejoint/>", limits: str = 'range="-60 60"') -> Path:
    path = folder / "arm.xml"
    path.write_text(ARM.format(root=root, range=limits))
    return path


def test_a_shipped_robot_is_loaded_by_name() -> None:
    robot = load_robot("op3")
    assert (robot.name, len(robot.joint_names), robot.floating) == ("op3", 20, True)
    assert robot.neutral().shape == (27,)


def test_an_unknown_name_lists_the_known_ones() -> None:
    with pytest.raises(
        RobotError, match=rf"unknown robot 'op4'; did you mean 'op3'\? known: {', '.join(shipped_robots())}"
    ):
        load_robot("op4")


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(RobotError, match=r"there is no file .*nobody\.xml"):
        load_robot(tmp_path / "nobody.xml")


def test_a_broken_mjcf_is_named_with_mujocos_reason(tmp_path: Path) -> None:
    broken = tmp_path / "broken.xml"
    broken.write_text("<mujoco><worldbody><body></worldbody></mujoco>")
    with pytest.raises(RobotError, match=r"broken\.xml: MuJoCo does not load it"):
        load_robot(broken)


def test_a_model_without_hinges_is_refused(tmp_path: Path) -> None:
    stone = tmp_path / "stone.xml"
    stone.write_text('<mujoco><worldbody><body><freejoint/><geom size=".1"/></body></worldbody></mujoco>')
    with pytest.raises(RobotError, match="has no hinge joint"):
        load_robot(stone)


@pytest.mark.parametrize(
    ("root", "count"),
    [
        ("<freejoint/>", 1),
        ("", 0),
        (
            '<joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 1 0"/><joint type="slide" axis="0 0 1"/>'
            '<joint axis="0 0 1"/><joint axis="0 1 0"/><joint axis="1 0 0"/>',
            6,
        ),
    ],
    ids=["free", "fixed", "six single joints"],
)
def test_the_root_is_not_among_the_hinges(tmp_path: Path, root: str, count: int) -> None:
    robot = load_robot(write(tmp_path, root))
    assert robot.joint_names == ("shoulder",)
    assert robot.root_joints.size == count


def test_ranges_come_from_the_model_in_radians(tmp_path: Path) -> None:
    robot = load_robot(write(tmp_path))
    assert np.allclose([robot.lower, robot.upper], np.radians([[-60], [60]]))


def test_a_side_file_fills_missing_ranges(tmp_path: Path) -> None:
    path = write(tmp_path, limits="")
    assert "no range given for shoulder" in load_robot(path).notes[0]
    (tmp_path / "arm.limits.toml").write_text('[range]\nshoulder = [-0.5, 1.5]\n[speed]\n"*" = 4.8\n')
    robot = load_robot(path)
    assert (robot.lower[0], robot.upper[0], robot.max_speed[0], robot.notes) == (-0.5, 1.5, 4.8, ())


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[range]\nelbow = [0, 1]", r"my\.toml: arm\.xml has no joint 'elbow'; known: shoulder"),
        (
            "[ranges]\nshoulder = [0, 1]",
            r"unknown table \[ranges\]; did you mean 'range'\? known: range, speed, torque",
        ),
        ("[range]\nshoulder = 1", r"\[range\] shoulder must be \[lower, upper\], got 1"),
        ("[range]\nshoulder = [1, 0]", "lower above upper"),
        ("[range]\nshoulder = [-20, 90]", r"got \[-20, 90\] \(radians within ±6\.28; more looks like degrees\)"),
        ("[range", "not TOML"),
    ],
)
def test_a_wrong_limits_file_says_what_is_wrong(tmp_path: Path, text: str, message: str) -> None:
    limits = tmp_path / "my.toml"
    limits.write_text(text)
    with pytest.raises(RobotError, match=message):
        load_robot(write(tmp_path), limits)


def test_limits_are_read_only() -> None:
    with pytest.raises(ValueError, match="read-only"):
        load_robot("op3").lower[0] = 0.0
