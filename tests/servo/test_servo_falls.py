"""A robot that fell, or whose joint did not follow, was not played to the end."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from emulated import ARM, QUICK, emulated
from made_trajectories import hold

import robot_retarget as rr
from robot_retarget.actuators.balance_tables import Balance, Imu
from robot_retarget.actuators.inertial import LEVEL, Reading
from robot_retarget.actuators.map import load_map
from robot_retarget.servo.outcome import FaultError, PlaybackEnd, PlaybackOptions
from robot_retarget.servo.plan import ServoPlan, plain_plan
from robot_retarget.servo.play import play
from robot_retarget.servo.watch import FallGuard

OP3, OP3_MAP = rr.load_robot("op3"), load_map("op3")
QUICK_OP3 = replace(OP3_MAP, limits=replace(OP3_MAP.limits, approach_time=0.2))
LOCKSTEP = PlaybackOptions(lockstep=True)


def toppling() -> ServoPlan:
    """A plan with a level trunk, whose ankles tip the robot over once the emulator has let go of it."""
    plan = plain_plan(hold(OP3, 2.5), OP3_MAP)
    angles, rise = plan.angles.copy(), np.clip((np.arange(len(plan.angles)) / plan.rate - 0.8) / 0.5, 0, 1)
    for side, sign in (("l", 1), ("r", -1)):
        angles[:, OP3_MAP.joints.index(f"{side}_ank_pitch")] -= sign * 0.6 * rise
    return replace(plan, angles=angles)


@pytest.mark.parametrize("held", [False, True])
def test_a_fall_without_feedback_stops_the_motion(held: bool, tmp_path: Path) -> None:
    plan = toppling().held() if held else toppling()
    with emulated(tmp_path, "op3", "--physics", "--lockstep", str(plan.rate)) as robot:
        outcome = play(plan, QUICK_OP3, robot.port, LOCKSTEP)
        assert robot.do("state")["body"]["upright"] < 0.85
    assert (outcome.ended, outcome.exit_code) == ((PlaybackEnd.FINISHED, 0) if held else (PlaybackEnd.FAULT, 1))
    assert held or "fell" in outcome.reason


def test_a_robot_that_falls_as_its_motion_ends_fell(tmp_path: Path) -> None:
    plan = toppling()
    short = replace(plan, angles=plan.angles[:140], up=None if plan.up is None else plan.up[:140])
    with emulated(tmp_path, "op3", "--physics", "--lockstep", str(plan.rate)) as robot:
        outcome = play(short, QUICK_OP3, robot.port, LOCKSTEP)
    assert (outcome.ended, outcome.exit_code) == (PlaybackEnd.FAULT, 1), outcome.reason


def test_a_sensor_that_does_not_answer_is_noted_and_stops_nothing(tmp_path: Path) -> None:
    plan = plain_plan(hold(OP3, 0.3), OP3_MAP)
    with emulated(tmp_path, "op3", "--lockstep", str(plan.rate), "--fault", "after 0 silent 200") as robot:
        outcome = play(plan, QUICK_OP3, robot.port, PlaybackOptions(lockstep=True))
    assert outcome.ended is PlaybackEnd.FINISHED
    assert outcome.warnings == ("the inertial sensor does not answer: a fall stops nothing",)


def test_a_lean_that_is_planned_is_no_fall() -> None:
    """The vertical turns by 90° on the plan and on the robot; a robot that stays level is off by then."""
    turn = np.linspace(0, np.pi / 2, 126)
    up = np.stack([-np.sin(turn), 0 * turn, np.cos(turn)], axis=1)
    plan = ServoPlan(np.zeros((126, 1)), 125.0, up=up)
    readings: list[Reading] = []

    class Follows:
        def read(self) -> Reading:
            return readings[-1]

    guards = [FallGuard(plan, Follows(), Imu(), Balance(), lambda text: None) for _ in range(2)]
    noise = np.random.default_rng(0)
    for row, vertical in enumerate(up):
        spin = np.array([0.0, np.pi / 2, 0.0]) + 1e-3 * noise.standard_normal(3)
        readings.append(Reading(spin, LEVEL.accel[2] * vertical))
        guards[0].goal(row, plan.angles[row])
    with pytest.raises(FaultError, match=r"fell: its trunk is 0\.5\d rad from the plan"):
        for row in range(126):
            readings.append(Reading(1e-3 * noise.standard_normal(3), LEVEL.accel))
            guards[1].goal(row, plan.angles[row])


def test_a_joint_that_lags_below_its_step_cap_was_not_played(tmp_path: Path) -> None:
    """A jam that errs by 0.4 rad of a cap of 0.5, for less time than the servo takes to report an overload."""
    patient = replace(ARM, limits=replace(QUICK, current=5.0))
    ramp = np.linspace(0, 0.4, 41)[:, None] * np.array([0.0, 1.0, 0.0, 0.0])
    plan = ServoPlan(np.concatenate([ramp, np.repeat(ramp[-1:], 120, axis=0)]), 200.0)
    with emulated(tmp_path, ARM, "--lockstep", str(plan.rate)) as robot:

        def say(text: str) -> None:
            if text.startswith("playing"):
                robot.do("jam 2")

        outcome = play(plan, patient, robot.port, PlaybackOptions(end_pose=False, lockstep=True), say=say)
    assert (outcome.ended, outcome.exit_code) == (PlaybackEnd.ASTRAY, 1), outcome.sentence
    assert outcome.reason.startswith("j2 stood still while its plan moved by 0.4")
    late = replace(outcome, ended=PlaybackEnd.FINISHED, figures=outcome.figures | {"still_rad": {}}).compared(0.2)
    assert late.ended is PlaybackEnd.ASTRAY and late.reason.startswith("j2 was 0."), "or moved, too far off"


def test_a_gyroscope_that_turns_at_rest_tips_nobody_over() -> None:
    """Its bias is measured on the way to the first pose; it would look like a lean of 0.14 rad."""
    plan, noise, said = ServoPlan(np.zeros((1, 1)), 125.0, up=np.array([[0.0, 0.0, 1.0]])), np.random.default_rng(0), []

    class Biased:
        def read(self) -> Reading:
            return Reading(np.array([0.05, -0.05, 0.0]) + 1e-3 * noise.standard_normal(3), LEVEL.accel)

    guard = FallGuard(plan, Biased(), Imu(), Balance(stop_roll=0.05, stop_pitch=0.05, fusion=2.0), said.append)
    for _ in range(50):
        guard.listen(plan.angles[0])
    guard.ready()
    for _ in range(1250):
        guard.goal(0, plan.angles[0])
    assert guard.trusted and not said


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize(("roll", "pitch"), [(0.2, 0.5), (0.5, 0.2)])
def test_without_feedback_a_lean_stops_at_the_smaller_of_both_limits(roll: float, pitch: float, axis: int) -> None:
    """It is an angle to the plan, about any axis: 0.18 rad are within 0.2, 0.22 are not."""
    plan, noise = ServoPlan(np.zeros((1, 1)), 125.0, up=np.array([[0.0, 0.0, 1.0]])), np.random.default_rng(0)

    def guarded(lean: float) -> None:
        up = np.array([0.0, np.sin(lean), np.cos(lean)] if axis == 0 else [-np.sin(lean), 0.0, np.cos(lean)])

        class Leans:
            def read(self) -> Reading:
                return Reading(1e-3 * noise.standard_normal(3), LEVEL.accel[2] * up)

        guard = FallGuard(plan, Leans(), Imu(), Balance(stop_roll=roll, stop_pitch=pitch), lambda text: None)
        for _ in range(250):
            guard.goal(0, plan.angles[0])

    guarded(0.18)
    with pytest.raises(FaultError, match=r"fell: its trunk is 0\.2\d rad from the plan"):
        guarded(0.22)
