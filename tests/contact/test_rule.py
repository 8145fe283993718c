"""The rule of contact on both sides of each of its thresholds."""

import numpy as np
import pytest

from robot_retarget.contact.rule import (
    JOINTS,
    SOLES,
    CausalContacts,
    ContactRule,
    contact_schedule,
    entered_runs,
    on_surface,
    standing,
    touching_down,
)


@pytest.mark.parametrize(
    ("rule", "enter", "leave", "low", "high"), [(JOINTS, 0.3, 0.4, 0.08, 0.10), (SOLES, 0.1, 0.2, 0.015, 0.025)]
)
def test_a_point_enters_below_one_threshold_and_leaves_above_another(
    rule: ContactRule, enter: float, leave: float, low: float, high: float
) -> None:
    """Between the two it stands only next to frames in which it entered: without hysteresis a foot that creeps flickers."""
    stands = [False, False, False, True, True, True, False]

    def ups_and_downs(inside: float, between: float, outside: float) -> np.ndarray:
        return np.array([outside, between, outside, between, inside, between, outside])

    speed = ups_and_downs(enter - 0.001, (enter + leave) / 2, leave + 0.001)
    height = ups_and_downs(low - 0.001, (low + high) / 2, high + 0.001)
    assert entered_runs(*rule.triggers(speed, np.zeros(7))).tolist() == stands
    assert entered_runs(*rule.triggers(np.zeros(7), height)).tolist() == stands


def test_the_floor_lies_under_all_but_two_in_a_hundred_heights() -> None:
    """A body that crouches for a twentieth of the time stands on the floor of the crouch, and one outlier is none."""
    crouch = np.r_[np.zeros(5), np.ones(95)]
    assert JOINTS.floor_height(crouch) == pytest.approx(0.0)
    assert JOINTS.floor_height(np.r_[[-1.0], np.ones(99)]) == pytest.approx(1.0)


def test_the_lowest_of_some_points_is_on_a_surface_until_it_is_higher_than_where_it_came() -> None:
    heights = np.array([0.11, 0.09, 0.07, 0.09, 0.11, 0.09])
    assert on_surface(np.stack([heights, heights + 1.0], axis=1)).tolist() == [False, True, True, True, False, False]


@pytest.mark.parametrize("seed", range(5))
def test_a_point_that_lands_touches_where_two_steps_in_a_row_are_slow_at_30_frames_a_second(seed: int) -> None:
    step = np.random.default_rng(seed).uniform(0.0, 0.9, 60)  # [leg lengths / s]
    points = np.zeros((61, 3))
    points[1:, 0] = np.cumsum(step) / 30
    slowest = [min(step[k : k + 2].mean() for k in range(max(t - 2, 0), min(t, 58) + 1)) for t in range(61)]
    enter, stay = np.array(slowest) < JOINTS.enter_speed, np.array(slowest) < JOINTS.leave_speed
    np.testing.assert_array_equal(touching_down(points, np.zeros(61), 30.0), entered_runs(enter, stay))
    assert enter.any() and not stay.all()


def test_a_contact_too_short_for_the_averaged_speed_stands_throughout_and_a_longer_one_while_it_is_slow() -> None:
    """At 30 frames a second: speeds are averaged over three frames, and a foot that lands or leaves is too fast for them."""
    for frames, least, most in ((4, 4, 4), (20, 15, 19)):
        x = np.r_[np.arange(-12, 0), np.zeros(frames), np.arange(1, 13)] * 0.03  # 0.9 leg lengths a second around it
        points = np.stack([x, 0 * x, np.where(x == 0, 0.0, 0.2)], axis=1)
        found = np.flatnonzero(standing(points, points[:, 2], 30.0))
        assert least <= len(found) <= most and np.ptp(found) == len(found) - 1 and 12 <= found[0] < 12 + frames


def test_a_foot_is_in_the_air_where_neither_its_toe_nor_its_ankle_nor_another_foot_is_down() -> None:
    still, up = np.zeros((30, 3)), np.r_[np.zeros(10), 0.4 * np.ones(10), np.zeros(10)]
    points = {name: still + [[0.0, 0.0, 1.0]] * up[:, None] for name in ("l_toe", "l_ankle", "r_toe", "r_ankle")}
    air = contact_schedule(points, 1.0, 30.0).flying
    assert len(air) == 30 and air[12:18].all() and not air[:8].any() and not air[22:].any()
    for name in points:
        assert not contact_schedule(points | {name: still}, 1.0, 30.0).flying.any()
    assert not contact_schedule({"head": still + 1.5}, 1.0, 30.0).flying.any()


def test_a_stream_holds_a_contact_and_a_gap_for_the_shortest_time() -> None:
    """A toe slips by 1/45 of a leg in every third frame: its averaged speed passes both thresholds within two frames."""
    dt = 1 / 60
    contacts = CausalContacts(("l_toe", "l_ankle"), 1.0, np.zeros((20, 2, 3)))
    toes = [np.array([[k // 3 / 45, 0.0, 0.0], [0.0, 0.0, 0.0]]) for k in range(120)]
    stands = np.array([contacts.step(toe, dt).stands[0, 0, 0] for toe in toes])
    changes = np.flatnonzero(np.diff(stands))
    assert len(changes) >= 5 and np.diff(changes).min() * dt >= JOINTS.shortest


def test_at_a_threshold_itself_a_point_neither_enters_nor_stays() -> None:
    for rule in (JOINTS, SOLES):
        speed = np.array([rule.enter_speed, rule.leave_speed, 0.0, 0.0])
        height = np.array([0.0, 0.0, rule.enter_height, rule.leave_height])
        enter, stay = rule.triggers(speed, height)
        assert enter.tolist() == [False] * 4 and stay.tolist() == [True, False, True, False]
