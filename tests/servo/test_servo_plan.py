"""A plan is the trajectory at the chosen speed, with smooth approaches before and after."""

import numpy as np
import pytest
from emulated import ARM
from hypothesis import given
from hypothesis import strategies as st

from robot_retarget.actuators.goals import Goals
from robot_retarget.actuators.map import Limits
from robot_retarget.base.errors import ServoError
from robot_retarget.servo.performance import MADE_UP, ticks_to_skip
from robot_retarget.servo.plan import at_speed, glide, goal_plan, plain_plan
from robot_retarget.trajectory import Trajectory

RAMP = Trajectory(np.linspace(0, 1, 101)[:, None] * np.ones(4), 50, ARM.joints, "arm")
"""Half a radian a second, for two seconds."""


@given(st.floats(0.3, 3.0), st.floats(11.0, 300.0))
def test_a_plan_at_another_rate_is_the_same_path(speed: float, rate: float) -> None:
    plan = plain_plan(at_speed(RAMP, speed), ARM, rate)
    straight = 0.5 * speed * np.arange(len(plan.angles)) / rate
    assert plan.angles[:, 2] == pytest.approx(np.minimum(straight, 1.0), abs=1e-9)
    assert abs(plan.duration - 2 / speed) <= 0.5 / rate + 1e-9


def test_goals_are_played_as_they_are_stored_in_the_order_of_the_map() -> None:
    rng = np.random.default_rng(2)
    goals = Goals(rng.uniform(-1, 1, (301, 4)), 125.0, 0.2, 0.2)
    told = Trajectory(RAMP.qpos, 50, ARM.joints[::-1], "arm", goals=goals)
    plan = goal_plan(told, ARM)
    assert plan.rate == 125.0 and (plan.angles == goals.angles[:, ::-1]).all()
    with pytest.raises(ServoError, match="has no goals"):
        goal_plan(RAMP, ARM)


def test_a_speed_that_cannot_be_played_is_refused() -> None:
    with pytest.raises(ServoError, match="--speed 9 is not in"):
        at_speed(RAMP, 9.0)


@given(st.lists(st.floats(-3, 3), min_size=4, max_size=4), st.lists(st.floats(-3, 3), min_size=4, max_size=4))
def test_a_glide_goes_from_pose_to_pose_within_its_speed(start: list[float], end: list[float]) -> None:
    limits = Limits(approach_speed=0.8, approach_time=1.0)
    way = glide(np.array(start), np.array(end), 100.0, limits)
    assert way.duration >= 1.0 - 0.01
    assert way.top_speed <= 0.8 * 1.02
    assert way.angles[0] == pytest.approx(start) and way.angles[-1] == pytest.approx(end)
    speeds = np.abs(np.diff(way.angles, axis=0))
    assert speeds[[0, -1]].max() <= speeds.max() / 5 + 1e-12


@given(st.floats(0.0, 2.0), st.floats(0.002, 0.1))
def test_after_a_delay_the_next_tick_is_soon_due_and_a_short_one_costs_none(elapsed: float, period: float) -> None:
    left_out = ticks_to_skip(elapsed, period)
    behind = elapsed - (1 + left_out) * period
    assert behind < max(period, MADE_UP) + 1e-9
    assert left_out == 0 or behind >= -1e-9
    assert elapsed > period + MADE_UP or left_out == 0
