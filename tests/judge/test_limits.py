"""Each number of the verdict holds on both sides of its limit. The limits stand here once more, from docs/simulation.md."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from robot_retarget.judge.rollout import simulate
from robot_retarget.judge.verdict import Thresholds, at_edge, badge_of, cures, judge, near_limits
from robot_retarget.robot import load_robot
from robot_retarget.scores.likeness import unlikeness
from robot_retarget.trajectory import Trajectory

CALM: dict[str, Any] = {
    "mode": "free", "unstable_s": None, "fall_s": None, "fall_body": None, "self_contacts": [], "tracked_self_contacts": [],
    "self_contact_depth_m": 0.0, "between_frames_depth_m": 0.0, "between_frames_s": 1.0, "between_frames_bodies": ["a", "b"],
    "worst_joint": "knee", "saturated_joint": "knee", "hottest_joint": "knee", "speed_ratio_joint": "knee",
    "range_excess_joint": "knee", "goal_step_joint": "knee", "draws": 10, "lost_contact": "hand leaves box", "limb_rad": 0.1,
}  # fmt: skip
"""Figures of a simulation in which nothing happens."""
FAILS = {
    "worst_joint_rms_rad": 0.2, "speed_ratio": 2.0, "saturated_share": 0.5, "temperature_rise_K": 40.0, "foot_slip_m": 0.01,
    "body_contacts_lost": 0.3, "fallen_share": 0.1, "range_excess_rad": 0.01, "between_frames_depth_m": 0.01,
}  # fmt: skip
UNLIKE = {
    "limb_rad_arms": 0.2, "limb_rad_trunk": 0.2, "limb_rad_legs": 0.4, "limbs_far_share": 0.05, "slowdown": 2.5,
    "contacts_lost": 0.3, "steps_shortened": 0.6, "path_off": 0.6, "heading_off_rad": 0.6, "steps_lost": 0.5,
    "unfinished_share": 0.25,
}  # fmt: skip


def judged(**figures: Any) -> tuple[str, ...]:
    return judge({**CALM, **figures}, Thresholds())


def pair(depth: float) -> list[Mapping[str, Any]]:
    return [{"bodies": ["arm", "hip"], "depth_m": depth, "frames": 3}]


@pytest.mark.parametrize(("figure", "limit"), FAILS.items())
def test_a_figure_fails_beyond_its_limit_and_passes_at_it(figure: str, limit: float) -> None:
    assert not judged(**{figure: 0.999 * limit}) and len(judged(**{figure: 1.001 * limit})) == 1
    assert cures({**CALM, figure: 1.001 * limit}, Thresholds()), "a fail names what helps"


@pytest.mark.parametrize(("figure", "limit"), UNLIKE.items())
def test_a_figure_is_unlike_beyond_its_limit_and_alike_at_it(figure: str, limit: float) -> None:
    assert not unlikeness({**CALM, figure: 0.999 * limit}, Thresholds())
    assert len(unlikeness({**CALM, figure: 1.001 * limit}, Thresholds())) == 1


@pytest.mark.parametrize(("figure", "limit"), [("self_contacts", 0.001), ("tracked_self_contacts", 0.002)])
def test_links_overlap_beyond_their_limit(figure: str, limit: float) -> None:
    assert not judged(**{figure: pair(0.99 * limit)}) and len(judged(**{figure: pair(1.01 * limit)})) == 1


def test_goals_are_held_back_beyond_the_limit_of_the_servo_map() -> None:
    assert not judged(goal_step_rad=0.5, goal_step_limit_rad=0.5)
    assert len(judged(goal_step_rad=0.501, goal_step_limit_rad=0.5)) == 1


@pytest.mark.parametrize("part", ["arms", "trunk", "legs"])
def test_an_angle_that_ranges_of_joints_cost_is_not_unlike(part: str) -> None:
    limit = UNLIKE[f"limb_rad_{part}"]
    near = {f"limb_rad_{part}": 0.3 + 0.99 * limit, f"limb_rad_{part}_best": 0.3}
    assert not unlikeness(near, Thresholds())
    assert unlikeness({**near, f"limb_rad_{part}_best": 0.28}, Thresholds())


def test_a_pass_whose_plan_has_less_than_seven_millimetres_of_margin_is_at_the_edge() -> None:
    """Whatever the simulation has: it is near 0 in every landing."""
    for margin, edge in ((0.0069, True), (0.0071, False), (None, False)):
        figures = {**CALM, "plan_margin_m": margin, "zmp_margin_m": 0.0}
        assert at_edge(figures, Thresholds()) == edge
        badge = badge_of((), (), {**figures, "at_edge": edge})
        how = "free" if margin is None else "free, margin 7 mm"
        assert badge.text == (f"pass, at the edge ({how})" if edge else f"pass ({how})")


def test_a_reason_at_an_equal_figure_states_the_difference() -> None:
    close = judge({**CALM, "worst_joint": "l_knee", "worst_joint_rms_rad": 0.20001}, Thresholds(tracking_rms=0.2))
    assert close == ("l_knee tracks 11.5° off (rms), more than 11.5° by 0.000573°",)
    far = judge({**CALM, "worst_joint": "l_knee", "worst_joint_rms_rad": 0.3}, Thresholds(tracking_rms=0.2))
    assert far == ("l_knee tracks 17.2° off (rms), more than 11.5°",)


@pytest.mark.parametrize(("share", "told"), [(0.89, False), (0.91, True), (1.09, True), (1.11, False)])
def test_a_figure_within_a_tenth_of_its_limit_says_so(share: float, told: bool) -> None:
    assert bool(near_limits({**CALM, "foot_slip_m": 0.01 * share}, Thresholds())) == told
    assert bool(near_limits({**CALM, "limb_rad_legs": 0.4 * share}, Thresholds())) == told


def test_a_fall_has_no_slip_and_no_drawn_worlds_to_judge() -> None:
    assert len(judged(fall_s=1.0, fall_body="hand", foot_slip_m=1.0, fallen_share=1.0)) == 1


def test_a_joint_is_simulated_in_the_range_that_a_limits_file_states(tmp_path: Path) -> None:
    link = '<body><joint name="j" axis="0 1 0" range="-1 0"/><geom type="capsule" size=".02 .1" mass=".1"/></body>'
    model = f'<mujoco><compiler angle="radian"/><worldbody>{link}</worldbody></mujoco>'
    (tmp_path / "arm.xml").write_text(model)
    (tmp_path / "limits.toml").write_text("[range]\nj = [0.0, 1.0]\n")
    robot = load_robot(tmp_path / "arm.xml")
    held = Trajectory(np.full((30, 1), 0.5), 30.0, robot.joint_names, robot.name)
    report = simulate(held, robot, mode="pinned", others=False)
    assert np.abs(report.series["measured"] - 0.5).max() < 0.05
