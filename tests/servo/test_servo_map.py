"""Ticks and radians agree, a map survives its file, and other projects' files become maps."""

import json
from collections.abc import Sequence
from math import pi
from pathlib import Path

import numpy as np
import pytest
from emulated import ARM
from forked import run
from hypothesis import given
from hypothesis import strategies as st

from robot_retarget.actuators.map import Servo, ServoMap, dump_map, load_map, shipped_maps
from robot_retarget.base.errors import ServoError
from robot_retarget.robot import load_robot
from robot_retarget.servo.foreign import read_foreign
from robot_retarget.servo.plan import plain_plan
from robot_retarget.trajectory import Trajectory

SERVOS = st.builds(
    Servo,
    st.just("joint"),
    st.integers(0, 252),
    st.just("XM430-W350"),
    st.sampled_from([-1, 1]),
    st.integers(0, 4095),
    st.floats(0.2, 5),
    st.floats(-3, -0.1),
    st.floats(0.1, 3),
)


@given(SERVOS, st.integers(-8192, 8192))
def test_a_tick_becomes_an_angle_and_the_same_tick(servo: Servo, ticks: int) -> None:
    assert servo.ticks(servo.radians(ticks)) == ticks


@given(SERVOS, st.floats(-3, 3))
def test_rounding_loses_at_most_half_a_tick(servo: Servo, angle: float) -> None:
    assert abs(servo.radians(servo.ticks(angle)) - angle) <= pi / 4096 / servo.gear + 1e-12


@given(SERVOS)
def test_a_turn_is_4096_ticks_times_the_gear_in_the_servo_s_sense(servo: Servo) -> None:
    assert servo.ticks(0) == servo.zero
    assert servo.ticks(2 * pi) - servo.zero == servo.sign * round(4096 * servo.gear)


@given(SERVOS)
def test_the_tick_range_is_inside_the_joint_s_and_one_turn(servo: Servo) -> None:
    low, high = servo.tick_range
    assert low >= 0 and high <= 4095
    for ticks in {low, high} if low <= high else ():
        assert servo.lower - 0.001 / servo.gear <= servo.radians(ticks) <= servo.upper + 0.001 / servo.gear


def test_a_map_comes_back_from_its_file(tmp_path: Path) -> None:
    path = tmp_path / "arm.toml"
    path.write_text(dump_map(ARM), encoding="utf-8")
    assert load_map(path) == ARM


def test_the_shipped_maps_load_and_name_their_robot() -> None:
    assert "op3" in shipped_maps()
    for name in shipped_maps():
        assert load_map(name).robot == name


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "at least one servo"),
        ("[servo.a]\nid = 1", "a: missing 1 required positional argument: 'model'"),
        ("[servo.a]\nid = 1\nmodel = 'XM430-W350'\nspin = 2", "a: no key 'spin'; .*known: .*zero"),
        ("[servo.a]\nid = 1\nmodel = 'RX-28'", "no servo model 'RX-28'"),
        ("[servo.a]\nid = 300\nmodel = 'XM430-W350'", "id 300 is not in"),
        ("[servo.a]\nid = 1\nmodel = 'XM430-W350'\n[servo.b]\nid = 1\nmodel = 'XM430-W350'", "id 1 stands twice"),
        ("[servo.a]\nid = '1'\nmodel = 'XM430-W350'", "a: id cannot be '1'"),
        ("[stop.pose]\nb = 1.0\n[servo.a]\nid = 1\nmodel = 'XM430-W350'", "names 'b', which has no servo; known: a"),
        ("baud = 31250\n[servo.a]\nid = 1\nmodel = 'XM430-W350'", "baud 31250 is not a rate"),
        ("[servo.a\n", "Expected"),
    ],
)
def test_a_map_that_means_nothing_is_refused_by_name(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "bad.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ServoError, match=message) as caught:
        load_map(path)
    assert str(path) in str(caught.value)


WELL: str = """robot = "arm"
baud = 1000000
[limits]
speed = 4.0
approach_speed = 0.8
approach_time = 2.0
jump = 0.5
temperature = 70.0
current = 2.0
min_voltage = 10.0
max_voltage = 14.8
watchdog = 0.1
silence = 0.1
[stop.pose]
elbow = 0.1
[servo.elbow]
id = 7
model = "XM430-W350"
sign = 1
zero = 2048
gear = 1.0
lower = -1.5
upper = 1.5
"""
NUMBERS = [line.partition(" = ")[0] for line in WELL.splitlines() if " = " in line and '"' not in line]
NO_NUMBER = ["nan", "+inf", "-inf", "1e300", "-1e300", "'4'", "true", "[]", "{}"]
IMPLAUSIBLE = {
    "speed": "-4",
    "jump": "0",
    "approach_time": "-1",
    "temperature": "-5",
    "watchdog": "60",
    "silence": "1e6",
}
IMPLAUSIBLE |= {"gear": "-1.0", "sign": "2", "zero": "1000000", "id": "253", "lower": "1.6", "elbow": "1.51"}
IMPLAUSIBLE |= {"min_voltage": "15", "baud": "31250", "current": "0", "approach_speed": "1e-9"}


@pytest.mark.parametrize(
    ("name", "value"), [*((n, v) for n in NUMBERS for v in NO_NUMBER), *IMPLAUSIBLE.items()], ids=str
)
def test_a_number_that_cannot_be_is_refused_by_file_line_and_name(tmp_path: Path, name: str, value: str) -> None:
    lines: list[str] = WELL.splitlines()
    assert load_map(written(tmp_path, lines)).limits.speed == 4
    place = next(k for k, line in enumerate(lines) if line.startswith(f"{name} = "))
    lines[place] = f"{name} = {value}"
    path = written(tmp_path, lines)
    with pytest.raises(ServoError) as caught:
        load_map(path)
    assert str(caught.value).startswith(f"{path}:{place + 1}: ") and name in str(caught.value)


def written(folder: Path, lines: Sequence[str]) -> Path:
    path = folder / "map.toml"
    path.write_text("\n".join(lines), encoding="utf-8")
    return path


def test_a_range_beyond_the_servo_s_turn_is_refused(tmp_path: Path) -> None:
    lines = [line.replace("zero = 2048", "zero = 8000") for line in WELL.splitlines()]
    with pytest.raises(ServoError, match=r"map\.toml:20: elbow: .* is outside the one turn of its servo"):
        load_map(written(tmp_path, lines))


OP3 = """[ control info ]
control_cycle = 8   # [ms]
[ port info ]
/dev/ttyUSB0 | 2000000 | r_sho_pitch
[ device info ]
# TYPE | PORT | ID | MODEL | PROTOCOL | DEV NAME | BULK READ ITEMS
dynamixel | /dev/ttyUSB0 | 1 | XM430-W350 | 2.0 | r_sho_pitch | present_position, position_p_gain
dynamixel | /dev/ttyUSB0 | 2 | XM430-W350 | 2.0 | l_sho_pitch | present_position
sensor | /dev/ttyUSB0 | 200 | OPEN-CR | 2.0 | open-cr | button
"""


def test_an_op3_robot_file_with_offsets_becomes_a_map(tmp_path: Path) -> None:
    (tmp_path / "OP3.robot").write_text(OP3)
    (tmp_path / "offset.yaml").write_text("offset:\n  r_sho_pitch: 0.1  # rad\n  l_sho_pitch: 0\ninit:\n  x: 3\n")
    read = read_foreign(tmp_path / "OP3.robot", tmp_path / "offset.yaml")
    assert (read.baud, read.ids, read.joints) == (2_000_000, (1, 2), ("r_sho_pitch", "l_sho_pitch"))
    assert [s.zero for s in read.servos] == [2048 + 65, 2048]
    for angle in ("nan", "inf", "much"):
        (tmp_path / "bad.yaml").write_text(f"offset:\n  r_sho_pitch: {angle}\n")
        with pytest.raises(ServoError, match=r"bad\.yaml:2: .* is no joint with an angle"):
            read_foreign(tmp_path / "OP3.robot", tmp_path / "bad.yaml")
    (tmp_path / "OP3.robot").write_text(OP3.replace("XM430-W350", "XM-430"))
    assert {s.model for s in read_foreign(tmp_path / "OP3.robot").servos} == {"XM430-W350"}


def test_a_lerobot_calibration_becomes_a_map(tmp_path: Path) -> None:
    path = tmp_path / "arm.json"
    entry = {"id": 1, "drive_mode": 1, "homing_offset": -100, "range_min": 1024, "range_max": 3048}
    path.write_text(json.dumps({"shoulder_pan": entry}))
    with pytest.raises(ServoError, match="names no servo model"):
        read_foreign(path)
    (servo,) = read_foreign(path, model="XL430-W250").servos
    assert (servo.sign, servo.zero, servo.type.name) == (-1, 2148, "XL430-W250")
    assert servo.lower == pytest.approx(-1000 * 2 * pi / 4096) and servo.upper == pytest.approx(pi / 2)


def test_a_pypot_configuration_becomes_a_map(tmp_path: Path) -> None:
    path = tmp_path / "poppy.json"
    motor = {"id": 11, "type": "XM430-W350-T", "orientation": "indirect", "offset": 90.0, "angle_limit": [-30, 28]}
    path.write_text(json.dumps({"controllers": {}, "motorgroups": {}, "motors": {"r_hip_x": motor}}))
    (servo,) = read_foreign(path).servos
    assert (servo.id, servo.sign, servo.zero, servo.model) == (11, -1, 1024, "XM430-W350")
    assert (servo.lower, servo.upper) == pytest.approx((-118 * pi / 180, -60 * pi / 180)), "limits of the servo itself"


def test_an_imported_map_takes_the_signs_and_zeros_that_fit_the_model_and_others_are_named(tmp_path: Path) -> None:
    """The joints of Poppy's URDF turn as their servos do; pypot's angles have orientations and offsets of their own."""
    motors = {
        name: {"id": k, "type": "MX-28", "orientation": sense, "offset": offset, "angle_limit": limits}
        for k, (name, sense, offset, limits) in enumerate(
            [
                ("r_knee", "indirect", 0.0, [-134, 4]),
                ("l_knee", "direct", 0.0, [-4, 134]),
                ("arm", "direct", 90.0, [-120, 155]),
            ]
        )
    }
    (tmp_path / "a.json").write_text(json.dumps({"controllers": {}, "motorgroups": {}, "motors": motors}))
    bodies = "".join(
        f'<body pos="0 {m["id"]} 1"><joint name="{name}" axis="0 1 0" range="{m["angle_limit"][0]} {m["angle_limit"][1]}"/>'
        '<geom size=".05"/></body>'
        for name, m in motors.items()
    )
    (tmp_path / "a.xml").write_text(f"<mujoco><worldbody>{bodies}</worldbody></mujoco>")
    done = run("servos", "import", tmp_path / "a.json", "--robot", tmp_path / "a.xml", "-o", tmp_path / "a.toml")
    assert done.returncode == 0, done.stderr
    found = load_map(tmp_path / "a.toml")
    assert [(s.sign, s.zero) for s in found.servos] == [(1, 2048)] * 3
    assert np.degrees(found["r_knee"].lower) == pytest.approx(-134) and np.degrees(found["arm"].upper) == pytest.approx(
        155
    )
    assert not any("servo map" in note for note in load_robot(tmp_path / "a.xml", servos=tmp_path / "a.toml").notes)
    (tmp_path / "b.toml").write_text(dump_map(read_foreign(tmp_path / "a.json")))
    (note,) = (n for n in load_robot(tmp_path / "a.xml", servos=tmp_path / "b.toml").notes if "servo map" in n)
    assert "r_knee by -134 … 4° and by -4 … 134°" in note and "l_knee" not in note


def test_a_toddlerbot_configuration_becomes_a_map_of_motors_that_turn_their_own_joints(tmp_path: Path) -> None:
    path = tmp_path / "toddler.json"
    drive = {"is_passive": False, "transmission": "gear", "id": 3, "type": "dynamixel", "spec": "XC330"}
    drive |= {"gear_ratio": 0.9, "kp_real": 1500.0, "init_pos": pi, "lower_limit": -1, "upper_limit": 1.5}
    driven = {"is_passive": True, "transmission": "gear", "lower_limit": -0.9, "upper_limit": 1.35}
    joints = {"neck_yaw_drive": drive, "neck_yaw_driven": driven}
    path.write_text(json.dumps({"general": {"dynamixel_baudrate": 1_000_000}, "joints": joints}))
    read = read_foreign(path)
    (servo,) = read.servos
    assert (servo.joint, servo.zero, servo.gear, servo.upper) == ("neck_yaw_drive", 2048, 1.0, 1.5)
    assert (servo.type.name, servo.motor.p_gain, read.baud) == ("XC330-T288", 1500, 1_000_000)
    assert read.passive == ("neck_yaw_driven",)
    again = tmp_path / "again.toml"
    again.write_text(dump_map(read), encoding="utf-8")
    assert load_map(again) == read


def test_a_toddlerbot_list_of_motors_numbers_them_in_order(tmp_path: Path) -> None:
    path = tmp_path / "config_motors.json"
    path.write_text(json.dumps({name: {"motor": "2XC430", "init_pos": pi / 2} for name in ("hip", "knee")}))
    assert [(s.joint, s.id, s.zero, s.model, s.range_exceeds_turn) for s in read_foreign(path).servos] == [
        ("hip", 0, 1024, "2XC430-W250", True),
        ("knee", 1, 1024, "2XC430-W250", True),
    ]


def test_a_passive_joint_needs_no_servo() -> None:
    trajectory = Trajectory(np.array([[0.1, 0.2]] * 3), 50, ("j", "rod"), "arm")
    servos = (Servo("j", 1, "XM430-W350"),)
    with pytest.raises(ServoError, match="does not cover rod"):
        plain_plan(trajectory, ServoMap("arm", servos))
    assert plain_plan(trajectory, ServoMap("arm", servos, passive=("rod",)), 50).angles.tolist() == [[0.1]] * 3


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{}", "neither OP3"),
        ("{", "Expecting"),
        ("hello", "no dynamixel stands"),
        ('{"joints": {"a": {}}}', "'lower_limit'"),
    ],
)
def test_what_is_none_of_these_is_refused(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "strange.json"
    path.write_text(text)
    with pytest.raises(ServoError, match=message):
        read_foreign(path)
