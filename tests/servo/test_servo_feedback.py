"""Feedback on the emulated bus: OpenCR's registers, the player's loop, and what becomes of a sensor at fault."""

import os
import pty
import re
import time
from collections.abc import Callable
from dataclasses import replace
from itertools import cycle
from pathlib import Path

import mujoco
import numpy as np
import pytest
from emulated import emulated, until
from made_trajectories import hold
from scipy.spatial.transform import Rotation

import robot_retarget as rr
from robot_retarget.actuators.balance_tables import STANDARD_GRAVITY, Balance, Imu
from robot_retarget.actuators.feedback import Feedback
from robot_retarget.actuators.inertial import (
    LEVEL,
    LeanTest,
    Monitor,
    Reading,
    VirtualImu,
    fallen,
    rest_faults,
    tilt_of,
)
from robot_retarget.actuators.map import ServoMap, load_map
from robot_retarget.base.errors import ServoError
from robot_retarget.base.files import MODELS as SHIPPED
from robot_retarget.servo.bus import Bus
from robot_retarget.servo.outcome import PlaybackEnd, PlaybackOptions
from robot_retarget.servo.plan import ServoPlan, goal_plan
from robot_retarget.servo.play import play
from robot_retarget.servo.watch import Balancer, LineSensor, OpenCr, decoded, encoded

OP3, OP3_MAP = rr.load_robot("op3"), load_map("op3")
IMU = OP3_MAP.imu or Imu()
DT = 0.008


def rested(imu: Imu = IMU, count: int = 50, seed: int = 1) -> list[Reading]:
    sensor = VirtualImu(imu, DT, seed)
    return [sensor.read(LEVEL) for _ in range(count)]


def test_a_reading_survives_the_registers_in_every_mounting() -> None:
    reading = Reading(np.array([0.5, -1.0, 2.0]), np.array([1.0, -2.0, 9.0]))
    for axes in (("x", "y", "z"), ("-x", "-y", "z"), ("y", "-x", "z"), ("z", "x", "y")):
        mounting = Imu(axes=axes).mounting
        found = decoded(encoded(reading, mounting), mounting)
        assert np.allclose(found.gyro, reading.gyro, atol=1e-3) and np.allclose(found.accel, reading.accel, atol=1e-3)


def test_registers_have_the_makers_units_and_signs() -> None:
    """ROBOTIS's open_cr_module: 16.4 units for a degree a second, 16384 for g, and x and y reversed on the OP3."""
    words = np.frombuffer(encoded(Reading(np.radians([10, 20, 30]), LEVEL.accel), IMU.mounting), dtype="<i2")
    assert words.tolist() == [-164, -328, 492, 0, 0, 16384]


@pytest.mark.parametrize("options", [(), ("--physics",)], ids=["on a table", "held by its trunk"])
def test_the_emulated_board_answers_a_level_robot(options: tuple[str, ...], tmp_path: Path) -> None:
    with emulated(tmp_path, "op3", *options) as robot, Bus(robot.port, OP3_MAP.baud) as bus:
        until(lambda: bus.ping(IMU.id) is not None)
        readings = []
        for _ in range(20):
            time.sleep(DT)
            readings += [reading for reading in [OpenCr(bus, IMU).read()] if reading is not None]
    assert len(readings) > 10 and rest_faults(readings, IMU, np.zeros(2)) == []


def test_the_player_does_what_the_simulation_judged_with_feedback(tmp_path: Path) -> None:
    report = rr.simulate(hold(OP3, 1.0), OP3, mode="free", draws=0, others=False, feedback=True)
    assert report.trajectory is not None
    plan = goal_plan(report.trajectory, OP3_MAP)
    assert plan.feedback is not None
    with emulated(tmp_path, "op3", "--physics", "--lockstep", str(plan.rate)) as robot:
        outcome = play(plan, OP3_MAP, robot.port, PlaybackOptions(end_pose=False, lockstep=True), tmp_path / "play.npz")
        body = robot.do("state")["body"]
    assert outcome.ended is PlaybackEnd.FINISHED, outcome.reason
    assert body["upright"] > 0.99 and outcome.warnings == ()
    with np.load(tmp_path / "play.npz") as log:
        playing = log["phase"] == list(log["phases"]).index("play")
        added = log["goal"][playing] - plan.angles
    assert 1e-4 < np.abs(added).max() < 0.1


def test_a_board_that_does_not_answer_is_refused_before_anything_moves(tmp_path: Path) -> None:
    report = rr.simulate(hold(OP3, 0.2), OP3, mode="free", draws=0, others=False, feedback=True)
    assert report.trajectory is not None
    plan = goal_plan(report.trajectory, OP3_MAP)
    steps = ("--lockstep", str(plan.rate))
    with emulated(tmp_path, "op3", *steps, "--fault", f"after 0 silent {IMU.id}") as robot:
        with pytest.raises(ServoError, match=r"does not answer .*--no-feedback"):
            play(plan, OP3_MAP, robot.port, PlaybackOptions(lockstep=True))
        servos = robot.do("state")["servos"]
    assert not any(servo["torque_enable"] for servo in servos.values())


def test_a_sensor_lost_on_the_way_fades_out_and_the_motion_ends(tmp_path: Path) -> None:
    report = rr.simulate(hold(OP3, 1.0), OP3, mode="free", draws=0, others=False, feedback=True)
    assert report.trajectory is not None
    plan = goal_plan(report.trajectory, OP3_MAP)
    steps = ("--lockstep", str(plan.rate))
    with emulated(tmp_path, "op3", *steps, "--fault", f"after 2.5 silent {IMU.id}") as robot:
        how = PlaybackOptions(end_pose=False, test_lean=False, lockstep=True)
        outcome = play(plan, OP3_MAP, robot.port, how)
    assert outcome.ended is PlaybackEnd.FINISHED, outcome.reason
    assert any("does not answer: feedback fades out" in text for text in outcome.warnings)


def test_a_stand_on_straight_legs_is_not_leant_and_the_motion_plays(tmp_path: Path) -> None:
    """Straight legs move the trunk sideways by their knees alone: a lean of 3° would bend them by 71°."""
    straight = np.array(OP3.standing())
    bent = [name.endswith(("_hip_pitch", "_knee", "_ank_pitch")) for name in OP3.joint_names]
    straight[OP3.qpos_index[bent]] *= 0.04
    report = rr.simulate(hold(OP3, 0.2, qpos=straight), OP3, mode="free", draws=0, others=False, feedback=True)
    assert report.trajectory is not None
    plan = goal_plan(report.trajectory, OP3_MAP)
    with emulated(tmp_path, "op3", "--lockstep", str(plan.rate)) as robot:
        outcome = play(plan, OP3_MAP, robot.port, PlaybackOptions(end_pose=False, lockstep=True), tmp_path / "play.npz")
    assert outcome.ended is PlaybackEnd.FINISHED, outcome.reason
    assert [text for text in outcome.warnings if re.search("no test lean: it would turn ._knee by .*straight", text)]
    with np.load(tmp_path / "play.npz") as log:
        assert not (log["phase"] == list(log["phases"]).index("lean")).any()


def mounted(*axes: str) -> ServoMap:
    """The OP3's map with another mounting of its sensor."""
    return replace(OP3_MAP, imu=replace(IMU, axes=axes))


WRONG = {
    "turned by 180 degrees": (mounted("x", "y", "z"), "accelerometer .* wrong sign: roll is reversed"),
    "turned by 90 degrees": (mounted("-y", "x", "z"), "measures pitch where the robot leans in roll"),
}


@pytest.mark.parametrize(("real", "message"), WRONG.values(), ids=WRONG)
def test_a_test_lean_finds_a_wrong_mounting(real: ServoMap, message: str, tmp_path: Path) -> None:
    report = rr.simulate(hold(OP3, 0.2), OP3, mode="free", draws=0, others=False, feedback=True)
    assert report.trajectory is not None
    plan, model = goal_plan(report.trajectory, OP3_MAP), str(SHIPPED / "op3" / "scene.xml")
    physics = ("--physics", "--model", model, "--lockstep", str(plan.rate))
    with emulated(tmp_path, real, *physics) as robot:
        outcome = play(plan, OP3_MAP, robot.port, PlaybackOptions(end_pose=False, lockstep=True))
        body = robot.do("state")["body"]
    assert outcome.ended is PlaybackEnd.FAULT and re.search(message, outcome.reason), outcome.reason
    assert body["upright"] > 0.99


def leant(test: LeanTest, wrong: Callable[[Reading], Reading], imu: Imu = IMU) -> list[str]:
    """What a test lean finds with a sensor that alters its readings; the robot follows the goals 0.05 s later."""
    sensor = VirtualImu(replace(imu, gyro_bias=0.0), DT, seed=3)
    path = np.concatenate([np.zeros((6, 2)), test.goals[:-6]])
    for tick, (angles, speeds) in enumerate(zip(path, np.asarray(np.gradient(path, DT, axis=0)), strict=True)):
        up = Rotation.from_euler("YX", angles[::-1]).inv().apply(LEVEL.accel)
        test.note(tick, wrong(sensor.read(Reading(np.array([*speeds, 0.0]), np.asarray(up)))))
    return test.faults()


def turned(signs: tuple[int, int, int], order: tuple[int, int, int] = (0, 1, 2)) -> Callable[[Reading], Reading]:
    return lambda r: Reading(np.array(signs) * r.gyro[list(order)], np.array(signs) * r.accel[list(order)])


LEANS = {
    "right": (turned((1, 1, 1)), []),
    "x": (turned((-1, 1, 1)), ["gyroscope .* wrong sign: roll", "accelerometer .* wrong sign: pitch"]),
    "y": (turned((1, -1, 1)), ["accelerometer .* wrong sign: roll", "gyroscope .* wrong sign: pitch"]),
    "swapped": (turned((1, 1, 1), (1, 0, 2)), ["measures pitch where the robot leans in roll"]),
    "gyroscope only": (lambda r: Reading(-r.gyro, r.accel), ["gyroscope .* roll", "gyroscope .* pitch"]),
    "gyroscope dead": (lambda r: Reading(0 * r.gyro, r.accel), ["gyroscope measures 0.000 rad|-0.000 rad"]),
}


@pytest.mark.parametrize(("wrong", "messages"), LEANS.values(), ids=LEANS)
def test_a_test_lean_names_sensor_and_axis(wrong: Callable[[Reading], Reading], messages: list[str]) -> None:
    found = leant(LeanTest(np.zeros(2), np.eye(2), 1 / DT), wrong)
    assert bool(found) == bool(messages)
    assert all(re.search(message, "; ".join(found)) for message in messages), found


@pytest.mark.parametrize(("more", "late"), [(0.0, False), (0.03, False), (0.092, True)])
def test_a_test_lean_finds_a_sensor_that_is_100_ms_late(more: float, late: bool) -> None:
    found = leant(
        LeanTest(np.zeros(2), np.eye(2), 1 / DT, IMU.delay), lambda r: r, replace(IMU, delay=IMU.delay + more)
    )
    assert bool(found) == late
    assert all(re.search(r"0\.1\d s late: its delay is not that of \[imu\]", fault) for fault in found)


FAULTS = {
    "dead": ([], "does not answer"),
    "frozen": ([LEVEL] * 50, "frozen"),
    "gyroscope bias": (rested(replace(IMU, gyro_bias=0.9), seed=2), "gyroscope turns"),
    "units": ([Reading(r.gyro, r.accel / STANDARD_GRAVITY) for r in rested()], "wrong units"),
    "ten times the noise": (rested(replace(IMU, gyro_noise=0.02, accel_noise=0.8)), "noise"),
    "upside down": ([Reading(r.gyro, -r.accel) for r in rested()], "axes"),
    "swapped axes": ([Reading(r.gyro[[0, 2, 1]], r.accel[[0, 2, 1]]) for r in rested()], "axes"),
}


@pytest.mark.parametrize(("readings", "message"), FAULTS.values(), ids=FAULTS)
def test_faults_are_found_at_rest(readings: list[Reading], message: str) -> None:
    assert any(message in fault for fault in rest_faults(readings, IMU, np.zeros(2)))


BOX = """<mujoco><worldbody><geom type="plane" size="2 2 .1"/><body name="trunk" pos="0 0 .2" euler="{}"><freejoint/>
<geom type="box" size=".1 .1 .1"/><site name="imu"/></body></worldbody><sensor><gyro site="imu"/><accelerometer site="imu"/></sensor></mujoco>"""
LAID = {
    "0 -90 0": "its back",
    "0 90 0": "its front",
    "90 0 0": "its right side",
    "-90 0 0": "its left side",
    "180 0 0": "its head",
}


@pytest.mark.parametrize(("turned", "side"), LAID.items())
def test_a_robot_that_fell_is_said_to_lie_and_on_which_side(turned: str, side: str) -> None:
    """MuJoCo's own sensors on a box that rests on a floor."""
    model = mujoco.MjModel.from_xml_string(BOX.format(turned))
    data, readings = mujoco.MjData(model), []
    for _ in range(800):
        mujoco.mj_step(model, data)
        readings.append(Reading(data.sensordata[:3].copy(), data.sensordata[3:].copy()))
    moving = [Reading(r.gyro + 0.9, r.accel * (0.79 + 0.02 * (k % 2))) for k, r in enumerate(readings[-50:])]
    for found in (rest_faults(readings[-50:], IMU, np.zeros(2)), rest_faults(moving, IMU, still=False)):
        (fault,) = found
        assert fault.startswith(f"the robot lies on {side}: set it on its feet") and "play again" in fault
    assert fallen([LEVEL]) is None
    assert not any("lies" in fault for fault in rest_faults(readings[-50:], IMU, tilt_of(readings[-1].accel)))


def test_sound_sensors_have_no_faults() -> None:
    for seed in range(20):
        assert rest_faults(rested(seed=seed), IMU, np.zeros(2)) == []


@pytest.mark.parametrize(
    ("later", "message"),
    [(None, "does not answer"), (LEVEL, "same reading"), (Reading(np.full(3, 40.0), LEVEL.accel), "same|saturated")],
)
def test_a_fault_on_the_way_is_found_within_56_ms(later: Reading | None, message: str) -> None:
    monitor = Monitor(IMU, DT)
    assert not any(monitor.step(reading) for reading in rested())
    found = [monitor.step(later) for _ in range(8)]
    assert found[0] is None and found[7] is not None
    assert re.search(message, found[7])


def test_a_sensor_that_prints_lines_is_read_to_the_newest_whole_one() -> None:
    board, port = pty.openpty()
    sensor = LineSensor(Imu(kind="lines", port=os.ttyname(port), axes=("y", "-x", "z")))
    assert sensor.read() is None
    os.write(board, b"noise\n0 0 0 0 0 9.8\n1, 2, 3, 4, 5, 6\n7 8")
    time.sleep(0.05)
    reading = sensor.read()
    assert reading is not None
    assert reading.gyro.tolist() == [2, -1, 3] and reading.accel.tolist() == [5, -4, 6]
    os.write(board, b" 9 1 1 1\n")
    time.sleep(0.05)
    newer = sensor.read()
    assert newer is not None and newer.gyro.tolist() == [8, -7, 9]


def test_a_port_that_is_not_there_is_named() -> None:
    with pytest.raises(ServoError, match="no_such_port"):
        LineSensor(Imu(kind="lines", port="/dev/no_such_port"))


@pytest.mark.parametrize("axes", [("x", "y", "z"), ("-y", "x", "z"), ("z", "x", "y")])
def test_registers_of_a_board_hold_a_reading_however_it_is_mounted(axes: tuple[str, str, str]) -> None:
    mounting, reading = Imu(axes=axes).mounting, Reading(np.array([0.1, -0.2, 0.3]), np.array([1.0, -2.0, 9.0]))
    found = decoded(encoded(reading, mounting), mounting)
    np.testing.assert_allclose(found.gyro, reading.gyro, atol=2e-3)
    np.testing.assert_allclose(found.accel, reading.accel, atol=1e-3)


@pytest.mark.parametrize("shake", [0.0, 0.3])
def test_a_trunk_that_shakes_on_the_way_to_the_first_pose_has_no_fault(shake: float) -> None:
    """The noise of a sensor shows at rest alone: on the way, the readings are those of a body that moves."""
    joints, signs = len(OP3.joint_names), cycle((1.0, -1.0))
    zeros = np.zeros((joints, 2))
    feedback = Feedback(
        zeros, zeros, zeros[:, 0] - 3, zeros[:, 0] + 3, np.zeros((1, 4)), 0.1, 1.0, 5.0, 1, 2.0, 0.2, np.ones(2),
        zeros[:, 0], zeros, np.zeros((joints, 2)), np.zeros((1, 2)),
    )  # fmt: skip
    plan = ServoPlan(np.zeros((1, joints)), 125.0, up=np.array([[0.0, 0.0, 1.0]]), feedback=feedback)
    sensor = VirtualImu(IMU, DT, 1)

    class Shaken:
        def read(self) -> Reading:
            return sensor.read(Reading(shake * next(signs) * np.ones(3), LEVEL.accel))

    balancer = Balancer(feedback, plan, Shaken(), IMU, OP3_MAP.balance or Balance(), lambda text: None)
    for _ in range(50):
        balancer.listen(plan.angles[0])
    balancer.ready()
    assert balancer.trusted
