"""Goals are in range, within the speed limit and near the joints, for any target and any position."""

import numpy as np
from emulated import ARM
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from robot_retarget.servo.cycle import Guard
from robot_retarget.servo.link import JointScale

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
