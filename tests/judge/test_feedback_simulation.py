"""The feedback law in the simulation: joints that it changes, joints that it keeps, and figures of the verdict."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from made_trajectories import hold, swing
from scipy.spatial.transform import Rotation

from robot_retarget.actuators.balance_tables import Balance
from robot_retarget.actuators.inertial import tilt_of
from robot_retarget.actuators.map import load_map
from robot_retarget.base.errors import ServoError, UsageError
from robot_retarget.judge.compensate import compensated
from robot_retarget.judge.feedback import WINDOW, oscillation, with_feedback
from robot_retarget.judge.playback import Playback, Rollout, plain_goals, roll_out
from robot_retarget.judge.rollout import plant_of, rollouts, simulate
from robot_retarget.judge.worlds import Draw, drawn
from robot_retarget.robot import Robot, load_robot

OP3 = load_robot("op3")
STAND = hold(OP3, 1.0)


def with_gains(gains: dict[str, dict[str, float]], **changes: float) -> Robot:
    """The OP3 with other gains than those that ship."""
    assert OP3.servo_map is not None
    return replace(OP3, servo_map=replace(OP3.servo_map, balance=Balance(joints=gains, **changes)))  # type: ignore[arg-type]


def final_tilt(rollout: Rollout, gravity: np.ndarray) -> np.ndarray:
    """(2,) roll and pitch of the trunk against gravity at the end [rad]."""
    turns = Rotation.from_quat(rollout.qpos[-25:, 3:7], scalar_first=True)
    return tilt_of(turns.inv().apply(-gravity)).mean(axis=0)


def test_gains_of_zero_are_open_loop_bit_by_bit() -> None:
    plant = plant_of(with_gains({}), "free")
    goals = plain_goals(plant, STAND)
    closed = roll_out(plant, STAND, "free", command=with_feedback(plant, STAND, goals))
    assert np.array_equal(closed.qpos, roll_out(plant, STAND, "free", command=goals).qpos)
    assert closed.added is not None and not closed.added.any()


@pytest.mark.parametrize("world", [Draw(pitch=0.05), Draw(roll=-0.05)], ids=["uphill", "sideways"])
def test_on_a_tilted_floor_feedback_brings_the_trunk_nearer_to_upright(world: Draw) -> None:
    ankles = {f"{side}_ank_{axis}": {"tilt": 1.0} for side in "lr" for axis in ("pitch", "roll")}
    plant = plant_of(with_gains(ankles | {f"{side}_hip_roll": {"tilt": 1.0} for side in "lr"}), "free")
    goals = plain_goals(plant, STAND)
    closed = with_feedback(plant, STAND, goals)
    gravity = drawn(plant, world, Playback())[0].model.opt.gravity
    leaning, upright = (rollouts(plant, STAND, [world], command=command)[0] for command in (goals, closed))
    axis = 0 if world.roll else 1
    before, after = (abs(final_tilt(r, gravity)[axis]) for r in (leaning, upright))
    assert after < 0.8 * before


BARE = """[imu]
delay = 0.005
[balance.joints]
"""
"""A map without servos, up to its gains."""


def on_own_actuators(folder: Path, gains: str) -> Robot:
    """The OP3 on its model's actuators, with a sensor and gains alone."""
    path = folder / "sensor.toml"
    path.write_text(BARE + gains)
    return load_robot("op3", servos=str(path))


def test_gains_of_zero_leave_goals_of_own_actuators_as_they_are(tmp_path: Path) -> None:
    robot = on_own_actuators(tmp_path, "l_knee = { rate = 0.0 }")
    plant, moving = plant_of(robot, "free"), swing(robot, "l_sho_pitch", 0.5, 2.0, 1.0)
    goals = compensated(plant, moving, "free")
    closed = roll_out(plant, moving, "free", command=with_feedback(plant, moving, goals))
    assert closed.added is not None
    assert np.array_equal(closed.qpos, roll_out(plant, moving, "free", command=goals).qpos)


def test_own_actuators_bring_the_trunk_nearer_to_upright_too(tmp_path: Path) -> None:
    robot = on_own_actuators(tmp_path, "l_ank_pitch = { tilt = 1.0 }\nr_ank_pitch = { tilt = 1.0 }")
    plant, world = plant_of(robot, "free"), Draw(pitch=0.05)
    assert plant.drives is None
    goals = plain_goals(plant, STAND)
    gravity = drawn(plant, world, Playback())[0].model.opt.gravity
    commands = goals, with_feedback(plant, STAND, goals)
    before, after = (abs(final_tilt(rollouts(plant, STAND, [world], command=c)[0], gravity)[1]) for c in commands)
    assert after < 0.8 * before


def test_a_map_without_servos_moves_none_and_names_joints_of_the_robot(tmp_path: Path) -> None:
    on_own_actuators(tmp_path, "l_knee = { rate = 0.1 }")
    with pytest.raises(ServoError, match="no servos: its feedback acts in simulation alone"):
        load_map(tmp_path / "sensor.toml")
    with pytest.raises(ServoError, match="'l_kneee', which is not among the joints; did you mean 'l_knee'"):
        on_own_actuators(tmp_path, "l_kneee = { rate = 0.1 }")


@pytest.mark.parametrize(("asked", "closed"), [(None, True), (True, True), (False, False)])
def test_a_free_robot_with_a_sensor_has_feedback_unless_it_is_switched_off(asked: bool | None, closed: bool) -> None:
    report = simulate(STAND, OP3, mode="free", draws=0, others=False, feedback=asked)
    assert report.trajectory is not None and report.trajectory.goals is not None
    assert (report.trajectory.goals.feedback is not None) == closed
    assert report.badge.text == f"pass, likeness not judged (free{', with feedback' if closed else ''})"


def test_pinned_goals_have_no_feedback() -> None:
    report = simulate(STAND, OP3, mode="pinned", others=False, feedback=None)
    assert report.trajectory is not None and report.trajectory.goals is not None
    assert report.trajectory.goals.feedback is None
    with pytest.raises(UsageError, match="only mode 'free' has balance"):
        simulate(STAND, OP3, mode="pinned", feedback=True)


def test_a_robot_without_a_sensor_is_told_so() -> None:
    assert OP3.servo_map is not None
    blind = replace(OP3, servo_map=replace(OP3.servo_map, imu=None, balance=None))
    with pytest.raises(UsageError, match=r"no \[imu\] and \[balance\]"):
        simulate(STAND, blind, mode="free", draws=0, feedback=True)


def test_the_report_says_how_much_was_added_and_keeps_what_was_judged() -> None:
    report = simulate(STAND, OP3, mode="free", draws=0, others=False, feedback=True)
    assert report.verdict == "pass", report.reasons
    assert 0 <= report.figures["feedback_max_rad"] < 0.1
    assert report.trajectory is not None and report.trajectory.goals is not None
    assert report.trajectory.goals.feedback is not None


def test_gains_that_oscillate_fail_with_the_joint_and_the_frequency() -> None:
    wild = with_gains({f"{side}_hip_pitch": {"rate": 1.0, "tilt": 5.0} for side in "lr"})
    report = simulate(hold(OP3, 3.0), wild, mode="free", draws=0, others=False, feedback=True)
    assert report.verdict == "fail"
    assert any("oscillates" in r and "hip_pitch" in r and "Hz" in r for r in report.reasons), report.reasons


def test_two_joints_that_swing_alike_oscillate_whichever_is_the_stronger_in_a_window() -> None:
    rate, times = 125.0, np.arange(500) / 125.0
    stronger = 0.1 + 1e-6 * np.sign(np.sin(2 * np.pi * times / (2 * WINDOW)))
    both = np.column_stack([stronger, 0.2 - stronger]) * np.sin(2 * np.pi * 6 * times)[:, None]
    found = oscillation(both, ["left", "right"], rate)
    assert found is not None and found.amplitude == pytest.approx(0.1, rel=0.2)


def test_an_oscillation_is_told_from_noise_and_from_a_single_push() -> None:
    rate, times = 125.0, np.arange(500) / 125.0
    noise = np.random.default_rng(0).normal(0, 0.02, (500, 1))
    push = np.exp(-((times - 2) ** 2) / 0.02)[:, None]
    assert oscillation(noise, ["ankle"], rate) is None
    assert oscillation(0.2 * push, ["ankle"], rate) is None
    found = oscillation(noise + 0.1 * np.sin(2 * np.pi * 6 * times)[:, None], ["ankle"], rate)
    assert found is not None and found.joint == "ankle"
    assert found.frequency == pytest.approx(6, abs=0.5) and found.amplitude == pytest.approx(0.1, rel=0.2)
