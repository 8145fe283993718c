"""The model of the servos predicts the states of a log from its goals: exactly with the right constants, worse with others."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from emulated import QUICK, emulated
from forked import run as call

import robot_retarget as rr
from robot_retarget.actuators.map import Identified, Servo, ServoMap, dump_map
from robot_retarget.base.errors import ServoError
from robot_retarget.servo.outcome import PlaybackOptions
from robot_retarget.servo.plan import ServoPlan
from robot_retarget.servo.play import play
from robot_retarget.servo.played import ServoLog, read_play_log
from robot_retarget.servo.predict import predict

STEP = 2 * np.pi / 4096
MODELS = ("XM430-W350", "MX-28(2.0)", "XL430-W250")
BENCH = ServoMap(
    "bench",
    tuple(
        Servo(f"j{k}", k, model, sign, 2048, lower=-1.5, upper=1.5)
        for k, (model, sign) in enumerate(zip(MODELS, (1, -1, 1), strict=True), 1)
    ),
    1_000_000,
    replace(QUICK, speed=8.0),
)
LOAD = 0.3 * 0.02**2
"""Inertia of the emulated pendulum of 0.3 kg at 2 cm [kg m²], whose weight of 0.06 N m hardly bends a servo."""


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A playback of two sines on the emulator, whose servos have the published mechanics."""
    folder = tmp_path_factory.mktemp("log")
    times = np.arange(500)[:, None] / 125
    path = np.sin(2 * np.pi * 0.7 * times) * (0.5, 0.4, 0.3) + 0.1 * np.sin(2 * np.pi * 2.3 * times)
    with emulated(folder, BENCH, "--pendulum", "0.3,0.02", "--lockstep", "125") as emulator:
        options = PlaybackOptions(lockstep=True, end_pose=False)
        play(ServoPlan(path, 125.0), BENCH, emulator.port, options, folder / "play.npz")
    return folder / "play.npz"


def test_the_states_are_predicted_within_two_steps_and_ten_times_better_than_by_the_goals(log: Path) -> None:
    read = read_play_log(log)
    for rounded in (1 - 1e-9, 1, 1 + 1e-9):  # a rate is found from times
        found = predict(replace(read, rate=125 * rounded), BENCH, LOAD)
        assert [one.joint for one in found] == ["j1", "j2", "j3"] and read.rate == pytest.approx(125)
        for one in found:
            assert one.error < 2 * STEP and one.error_of_goals > 10 * one.error, one.joint


def test_other_constants_than_those_of_the_log_show_in_the_joint_that_has_them(log: Path) -> None:
    stiff = Identified(damping=1.0, friction=0.2, armature=0.02)
    wrong = predict(read_play_log(log), replace(BENCH, identified={"XM430-W350": stiff}), LOAD)
    assert wrong[0].error > 10 * STEP and max(one.error for one in wrong[1:]) < 2 * STEP


def test_a_lerobot_data_set_in_degrees_is_predicted_by_the_command(log: Path, tmp_path: Path) -> None:
    (tmp_path / "servos.toml").write_text(dump_map(BENCH))
    model = "".join(f'<body><joint name="{s.joint}"/><geom size=".1"/></body>' for s in BENCH.servos)
    (tmp_path / "bench.xml").write_text(f"<mujoco><worldbody>{model}</worldbody></mujoco>")
    with np.load(log) as ticks:
        present = ticks["present"][ticks["phase"] == 1]
    robot = rr.load_robot(tmp_path / "bench.xml")
    rr.export(
        rr.Trajectory(np.degrees(present), 125, robot.joint_names, robot.name), robot, "lerobot", tmp_path / "set"
    )
    words = ("servos", "predict", tmp_path / "set", "--map", tmp_path / "servos.toml", "--unit", "deg")
    done = call(*words, "--picture", tmp_path / "predict.svg")
    assert done.returncode == 0, done.stderr
    assert "j2" in done.stdout and "MX-28(2.0)" in done.stdout
    assert (tmp_path / "predict.svg").read_text().startswith("<svg")


def test_a_log_of_other_joints_or_shapes_is_refused(tmp_path: Path) -> None:
    rows = np.zeros((5, 1))
    with pytest.raises(ServoError, match=r"the log has no joint of the map: .*elbow"):
        predict(ServoLog(("elbow",), 50.0, rows, rows), BENCH)
    with pytest.raises(ServoError, match="finite goals and angles"):
        ServoLog(("elbow",), 50.0, rows * np.nan, rows)
    (tmp_path / "play.npz").write_bytes(b"nothing")
    with pytest.raises(ServoError, match="is no log of `play`"):
        read_play_log(tmp_path / "play.npz")
