"""Goals are in range, within the speed limit and near the joints, for any target and position; readings beyond a limit stop."""

import re
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pytest
from emulated import ARM
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from robot_retarget.actuators.map import ServoMap
from robot_retarget.servo.cycle import Guard, Judge
from robot_retarget.servo.link import JointScale
from robot_retarget.servo.outcome import FaultError

SCALE, LIMITS = JointScale(ARM), ARM.limits
WISHES = arrays(float, (6, 4), elements=st.floats(-9, 9) | st.sampled_from([np.nan, np.inf, -np.inf]))
PLACES = arrays(float, (6, 4), elements=st.floats(-1.49, 1.49))
ROUNDING = 1e-9


@given(WISHES, PLACES, st.floats(0.001, 0.1))
def test_goals_stay_in_range_under_the_speed_and_near_the_joints(targets, presents, dt: float) -> None:
    guard = Guard(SCALE, LIMITS, presents[0])
    for target, present in zip(targets, presents, strict=True):
        last, aim = guard.goal, guard.aim(target, dt)
        assert (np.abs(aim - last) <= LIMITS.speed * dt + ROUNDING).all()
        goal = guard.admit(aim, present)
        guard.record(goal, target, aim, dt)
        assert np.isfinite(goal).all()
        assert (SCALE.lower <= goal).all() and (goal <= SCALE.upper).all()
        assert (np.abs(SCALE.radians(SCALE.ticks(goal)) - present) <= LIMITS.jump).all()


@given(PLACES, st.floats(0.001, 0.1))
def test_a_goal_made_ready_is_sent_as_it_is_where_the_joints_are_near(places, dt: float) -> None:
    here, target = places[0], places[1]
    guard = Guard(SCALE, LIMITS, here)
    aim = guard.aim(target, dt)
    near = (np.abs(aim - here) < LIMITS.jump - 0.002).all()
    assert not near or guard.admit(aim, here) is aim
    guard.record(guard.admit(aim, here), target, aim, dt)
    assert (guard.limited == (np.abs(target - guard.goal) > ROUNDING)).all()


@given(st.lists(st.tuples(st.booleans(), st.floats(0.001, 0.1)), min_size=1, max_size=12))
def test_a_goal_has_been_capped_since_the_last_tick_that_was_not(ticks: list[tuple[bool, float]]) -> None:
    guard, aim = Guard(SCALE, LIMITS, np.zeros(4)), np.full(4, 0.2)
    for capped, dt in ticks:
        guard.record(aim - capped * np.array([0.0, 0.1, 0.0, 0.0]), aim, aim, dt)
    since = next((k for k in range(len(ticks), 0, -1) if not ticks[k - 1][0]), 0)
    np.testing.assert_allclose(guard.capped_for, [0.0, sum(dt for _, dt in ticks[since:]), 0.0, 0.0], atol=1e-12)


@dataclass(frozen=True)
class Readings:
    """What a link has read of four servos that are well."""

    map: ServoMap = ARM
    missed: np.ndarray = field(default_factory=lambda: np.zeros(4, int))
    age: np.ndarray = field(default_factory=lambda: np.zeros(4))
    error: np.ndarray = field(default_factory=lambda: np.zeros(4, int))
    hardware: np.ndarray = field(default_factory=lambda: np.zeros(4, int))
    torque: np.ndarray = field(default_factory=lambda: np.ones(4, bool))
    limp: np.ndarray = field(default_factory=lambda: np.zeros(4, bool))
    voltage: np.ndarray = field(default_factory=lambda: np.full(4, 12.0))
    temperature: np.ndarray = field(default_factory=lambda: np.full(4, 40.0))
    current: np.ndarray = field(default_factory=lambda: np.zeros(4))


def stopped(readings: Any, capped_for: np.ndarray | None = None, since: float = 0.0) -> str:
    """Why these readings stop playback when they have lasted for a time [s]; empty if they do not."""
    judge, capped = Judge(readings), np.zeros(4) if capped_for is None else capped_for
    try:
        judge.judge(10.0, capped)
        judge.judge(10.0 + since, capped)
    except FaultError as error:
        return str(error)
    return ""


def second(value: float, usual: float) -> np.ndarray:
    """(4,) with a value of the second servo."""
    return np.array([usual, value, usual, usual])


@given(
    arrays(int, 4, elements=st.integers(0, 4)),
    arrays(float, 4, elements=st.sampled_from([0.0, 0.99, 1.0, 2.0])),
)
def test_a_servo_is_silent_after_two_misses_and_its_time_and_all_are_gone_when_nobody_answers(missed, ages) -> None:
    said = stopped(replace(Readings(), missed=missed, age=ages * LIMITS.silence))
    gone = missed >= 2
    silent = [f"j{k + 1} (servo {k + 1})" for k in range(4) if gone[k] and ages[k] >= 1]
    expected = "no servo answers any more (power, cable)" if gone.all() else f"{', '.join(silent)} no longer answers"
    assert said == (expected if silent else "")


@pytest.mark.parametrize(
    ("name", "limit", "sign", "usual", "said"),
    [
        ("voltage", LIMITS.max_voltage, 1, 12.0, "supply is"),
        ("voltage", LIMITS.min_voltage, -1, 12.0, "supply is"),
        ("temperature", LIMITS.temperature, 1, 40.0, r"j2 \(servo 2\) is .* hot"),
        ("current", LIMITS.current, 1, 0.0, r"j2 \(servo 2\) draws"),
        ("current", -LIMITS.current, -1, 0.0, r"j2 \(servo 2\) draws"),
        ("capped_for", 0.3, 1, 0.0, r"j2 \(servo 2\) does not follow"),
    ],
)
def test_a_reading_stops_playback_beyond_its_limit_and_not_before(
    name: str, limit: float, sign: int, usual: float, said: str
) -> None:
    def said_of(value: float, since: float) -> str:
        capped = second(value, usual) if name == "capped_for" else None
        readings = Readings() if name == "capped_for" else replace(Readings(), **{name: second(value, usual)})
        return stopped(readings, capped, since)

    assert not said_of(limit - sign * 1e-6, 1.0)
    assert re.search(said, said_of(limit + sign * 1e-6, 0.51))
    if name == "current":
        assert not said_of(2 * limit, 0.49)
