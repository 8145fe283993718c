"""Simulated servos run, stall, heat and hold as their datasheets and a DC motor's equations say."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from made_trajectories import hold, robot_of, swing

from robot_retarget.actuators.motors import IDENTIFIED, MOTORS, PUBLISHED
from robot_retarget.base.errors import RobotError, ServoError
from robot_retarget.judge.build import build_plant
from robot_retarget.judge.playback import Playback, roll_out
from robot_retarget.judge.rollout import simulate
from robot_retarget.judge.servo_model import HEAT_RISE, Drives, drives, drives_of
from robot_retarget.robot import load_robot

OP3 = load_robot("op3")
WHEEL = """<mujoco><option timestep="0.001" gravity="0 0 0"/><worldbody><body><joint name="wheel" axis="0 1 0"/>
<geom type="cylinder" size=".02 .01" mass=".01"/></body></worldbody></mujoco>"""
LISTED = ("XM430-W350", "XM430-W210", "XL430-W250", "XC330-T288", "2XC430-W250", "XM540-W270")


def smooth(servo: Drives) -> Drives:
    """The motor alone: gears without friction and drag."""
    none = np.zeros_like(servo.friction)
    return replace(servo, friction=none, damping=none)


def wheel(tmp_path, name: str, **options):
    robot = robot_of(WHEEL, tmp_path / "wheel.xml")
    return robot, smooth(drives([MOTORS[name]], np.ones(1), **options))


@pytest.mark.parametrize("name", LISTED)
def test_a_free_wheel_runs_at_the_datasheets_speed_without_load(tmp_path, name):
    robot, servo = wheel(tmp_path, name)
    plant = build_plant(robot, "pinned", servo)
    data = mujoco.MjData(plant.model)
    data.ctrl[:] = 1e3  # far ahead: full duty
    mujoco.mj_step(plant.model, data, 3000)
    assert data.qvel[0] == pytest.approx(MOTORS[name].no_load_speed, rel=1e-3)
    assert servo.current(data.actuator_force, data.qvel) == pytest.approx(0, abs=2e-3)


@pytest.mark.parametrize(
    ("name", "gears"), [(name, gears) for name, own in PUBLISHED.items() for gears in own.values()]
)
def test_published_gears_cost_a_free_servo_at_most_a_quarter_of_its_datasheets_speed(name, gears):
    """The speed of a data sheet is that of the shaft: most of what the gears cost is in it already."""
    motor = MOTORS[name]
    speed = (motor.stall_torque - gears.friction) / (motor.back_emf + gears.damping)
    assert 0.75 * motor.no_load_speed < speed < motor.no_load_speed


@pytest.mark.parametrize(("name", "error"), [("XM430-W350", 0.217), ("XL330-M288", 0.434)])
def test_full_duty_is_reached_at_the_error_that_gain_and_divisor_say(tmp_path, name, error):
    """duty 1 = P / divisor · error · 651.9 / 885: 885 · 128 / 800 / 651.9 for the XM430, twice that for the XL330."""
    _, servo = wheel(tmp_path, name)
    assert servo.stall_torque / servo.stiffness == pytest.approx(error, abs=1e-3)


@pytest.mark.parametrize("name", LISTED)
def test_a_blocked_servo_gives_stall_torque_and_draws_stall_current(tmp_path, name):
    _, servo = wheel(tmp_path, name)
    force, still = servo.stall_torque, np.zeros(1)
    motor = MOTORS[name]
    assert servo.shaft_torque(force, still) == pytest.approx(motor.stall_torque)
    assert servo.current(force, still) == pytest.approx(motor.stall_current)
    assert servo.power(force, still) == pytest.approx(motor.voltage * motor.stall_current)


def test_the_servo_moves_as_mujocos_own_dc_motor_does(tmp_path):
    """The same step answered by MuJoCo's `dcmotor`: K from the line, kd = K²/R undoes the back-EMF it feeds forward."""
    robot, servo = wheel(tmp_path, "XM430-W350")
    plant = build_plant(robot, "pinned", servo)
    if not hasattr(mujoco.MjsActuator, "set_to_dcmotor"):
        pytest.skip("this MuJoCo has no dcmotor actuator")
    motor = MOTORS["XM430-W350"]
    constant = motor.voltage / motor.no_load_speed
    resistance = constant * motor.voltage / motor.stall_torque
    spec = mujoco.MjSpec.from_string(WHEEL)
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.joints[0].armature = float(servo.armature[0])
    actuator = spec.add_actuator(name="motor", target="wheel", trntype=mujoco.mjtTrn.mjTRN_JOINT)
    gains = [float(servo.stiffness[0]), 0, constant**2 / resistance, 0, 0, motor.voltage]
    actuator.set_to_dcmotor(motorconst=[constant, 0], resistance=resistance, controller=gains, ctrlspec=1)
    theirs = spec.compile()
    paths = []
    for model in (plant.model, theirs):
        data, path = mujoco.MjData(model), []
        data.ctrl[:] = 1.0
        for _ in range(1500):
            mujoco.mj_step(model, data)
            path.append(data.qpos[0])
        paths.append(path)
    assert max(paths[0]) > 1.05 or abs(paths[0][-1] - 1) < 0.01  # it moved, and came to where it was sent
    np.testing.assert_allclose(paths[0], paths[1], atol=2e-3)


def test_the_stiffness_is_that_of_the_p_gain_register():
    """Full duty, 885, at the published 0.217 rad of error at P = 800."""
    servo = drives_of(OP3)
    assert servo is not None
    np.testing.assert_allclose(servo.stall_torque / servo.stiffness, 0.217, rtol=2e-3)


@pytest.mark.parametrize("name", ["op3", "toddler_class"])
def test_an_ankle_of_a_shipped_robot_is_stiffer_than_its_weight_tips(name: str) -> None:
    """On one foot the robot is a pendulum of height h on the ankle's servo: below m g h it tips over open loop."""
    robot, data = load_robot(name), mujoco.MjData(load_robot(name).model)
    data.qpos[:] = robot.standing()
    mujoco.mj_forward(robot.model, data)
    tips = robot.model.body_mass.sum() * robot.gravity * data.subtree_com[robot.root_body][2]
    servo = drives_of(robot)
    assert servo is not None
    ankles = [k for k, joint in enumerate(robot.joint_names) if "ank" in joint]
    assert len(ankles) == 4 and servo.stiffness[ankles].min() > 1.5 * tips


def test_a_gain_of_the_map_is_that_of_the_simulation_and_makes_another_report_necessary() -> None:
    assert OP3.servo_map is not None
    doubled = replace(OP3.servo_map, servos=tuple(replace(s, p_gain=1600) for s in OP3.servo_map.servos))
    usual, stiff = drives_of(OP3), drives_of(replace(OP3, servo_map=doubled))
    assert usual is not None and stiff is not None
    np.testing.assert_allclose(stiff.stiffness, 2 * usual.stiffness)
    assert doubled.fingerprint != OP3.servo_map.fingerprint


def test_a_gear_trades_speed_for_torque():
    direct, geared = (drives([MOTORS["XC330-T288"]], np.array([g])) for g in (1.0, 3.0))
    assert geared.stall_torque / direct.stall_torque == pytest.approx(3)
    assert geared.no_load_speed / direct.no_load_speed == pytest.approx(1 / 3)
    assert geared.armature / direct.armature == pytest.approx(9)
    assert geared.tick / direct.tick == pytest.approx(1 / 3)


def test_the_robots_identified_damping_is_back_emf_and_gears_together():
    servo = drives_of(OP3)
    assert servo is not None
    np.testing.assert_allclose(servo.back_emf + servo.damping, OP3.model.dof_damping[OP3.dof_index], rtol=1e-3)
    np.testing.assert_allclose(servo.armature, OP3.model.dof_armature[OP3.dof_index])
    np.testing.assert_allclose(servo.friction, OP3.model.dof_frictionloss[OP3.dof_index])


def test_the_continuous_current_for_ever_warms_by_the_rated_rise_and_stall_by_25_times_that():
    servo = drives([MOTORS["XM430-W350"]], np.ones(1))
    lasting = np.full((6000, 1), 0.2 * servo.stall_torque[0])
    still = np.zeros_like(lasting)
    assert servo.temperature_rise(lasting, still, 1.0) == pytest.approx(HEAT_RISE, rel=0.01)
    brief = np.full((10, 1), servo.stall_torque[0])
    assert servo.temperature_rise(brief, still[:10], 0.1) == pytest.approx(25 * HEAT_RISE / 300, rel=0.01)


def test_goals_come_in_ticks_at_the_playbacks_rate_and_late(tmp_path):
    """A ramp as a 1 N m/rad servo feels it: stairs of one goal interval, each a whole number of ticks, delayed."""
    ramp = swing(OP3, "l_el", 0.5, 0.5, 1.0)
    plant = build_plant(OP3, "pinned", drives_of(OP3))
    goals = plant.controls(ramp.qpos[:, OP3.qpos_index])
    ticks = goals[:, plant.servos] * 4096 / (2 * np.pi)
    np.testing.assert_allclose(ticks, np.round(ticks), atol=1e-6)
    assert np.abs(goals[:, plant.servos] - ramp.qpos[:, OP3.qpos_index]).max() <= np.pi / 4096 + 1e-9
    soon, late = (roll_out(plant, ramp, "pinned", Playback(delay=d)) for d in (0.0, 0.04))
    elbow = OP3.joint_names.index("l_el")
    shifted = np.interp(soon.times - 0.04, soon.times, soon.hinges[:, elbow])
    np.testing.assert_allclose(late.hinges[:, elbow], shifted, atol=2e-3)


def test_the_models_own_actuators_stay_where_they_are_asked_for():
    own = simulate(swing(OP3, "l_el", 0.4, 0.4, 1.0), OP3, drives=None, others=False).figures
    servos = simulate(swing(OP3, "l_el", 0.4, 0.4, 1.0), OP3, others=False).figures
    assert own["plain_lag_s"] < servos["plain_lag_s"]  # 21.1 N m/rad in the model, 18.9 by the register


def test_unknown_servos_are_said_and_grown_from_a_known_one():
    assert "XM540-W270" not in IDENTIFIED
    servo = drives([MOTORS["XM540-W270"]], np.ones(1))
    assert "XM540-W270" in servo.notes[0]
    assert servo.friction[0] == pytest.approx(0.03 * 10.6 / 4.1)


def test_a_joint_without_a_servo_in_the_file_is_named(tmp_path):
    path = robot_of(WHEEL, tmp_path / "wheel.xml").path
    assert drives_of(load_robot(path)) is None
    (tmp_path / "servos.toml").write_text('[servo.other]\nid = 1\nmodel = "XM430-W350"\n')
    with pytest.raises(RobotError, match="no servo for the joint 'wheel'; known: other"):
        load_robot(path)
    (tmp_path / "servos.toml").write_text('[servo.wheel]\nid = 1\nmodel = "RX-28"\n')
    with pytest.raises(ServoError, match=r"servos\.toml:3: wheel: no servo model 'RX-28'; .*known: XM430-W350"):
        load_robot(path)
    (tmp_path / "servos.toml").write_text('passive = ["wheel"]\n[servo.other]\nid = 1\nmodel = "XM430-W350"\n')
    with pytest.raises(RobotError, match="no servo for the joint 'wheel'"):
        drives_of(load_robot(path))


def test_the_same_rollout_twice_is_the_same():
    plant = build_plant(OP3, "free", drives_of(OP3))
    first, second = (roll_out(plant, hold(OP3, 0.3), "free") for _ in range(2))
    assert np.array_equal(first.qpos, second.qpos)
