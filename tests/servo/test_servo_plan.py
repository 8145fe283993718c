"""A plan is the chosen part of the trajectory at the chosen speed, with smooth approaches before and after."""

import numpy as np
import pytest
from emulated import ARM
from hypothesis import given
from hypothesis import strategies as st

from robot_retarget.actuators.goals import Goals
from robot_retarget.actuators.map import Limits
from robot_retarget.base.errors import ServoError
from robot_retarget.servo.performance import MADE_UP, ticks_to_skip
from robot_retarget.servo.plan import glide, goal_plan, part_of, plain_plan
from robot_retarget.trajectory import Trajectory

RAMP = Trajectory(np.linspace(0, 1, 101)[:, None] * np.ones(4), 50, ARM.joints, "arm")
"""Half a radian a second, for two seconds."""


def test_a_part_is_played_at_its_speed() -> None:
    plan = plain_plan(part_of(RAMP, speed=0.5, start=0.4, stop=1.2), ARM, 100.0)
    assert plan.duration == pytest.approx(1.6)
    assert plan.angles[[0, 80, 160], 0] == pytest.approx([0.2, 0.4, 0.6])
    assert plan.top_speed == pytest.approx(0.25)


def test_what_ends_where_it_began_is_looped() -> None:
    times = np.arange(0, 1.001, 0.02)[:, None]
    waves = Trajectory(0.3 * np.sin(2 * np.pi * times) * np.ones(4), 50, ARM.joints, "arm")
    plan = plain_plan(part_of(waves, loops=3), ARM, 200.0)
    assert plan.duration == pytest.approx(3)
    assert plan.angles[[50, 250, 450], 1] == pytest.approx([0.3] * 3, abs=2e-3)


@given(st.floats(0.3, 3.0), st.floats(11.0, 300.0))
def test_a_plan_at_another_rate_is_the_same_path(speed: float, rate: float) -> None:
    plan = plain_plan(part_of(RAMP, speed), ARM, rate)
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


@pytest.mark.parametrize(
    ("wish", "message"),
    [
        ({"loops": 2}, "its end is 1.00 rad from its beginning"),
        ({"loops": 0}, "--loop 0"),
        ({"speed": 9.0}, "--speed 9 is not in"),
        ({"start": 1.5, "stop": 1.0}, r"--from 1.5 --to 1 is no part of 0…2 s"),
        ({"stop": 3.0}, r"--to 3 is no part"),
    ],
)
def test_a_part_that_cannot_be_played_is_refused(wish: dict[str, float], message: str) -> None:
    with pytest.raises(ServoError, match=message):
        part_of(RAMP, **wish)  # pyright: ignore[reportArgumentType]


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
