"""Flights: where no foot of the human is on the ground and the body falls, the robot's root falls freely in the same time."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.constants import g

import robot_retarget as rr
from robot_retarget.base.files import SAMPLES
from robot_retarget.graph.describe import RobotGraph, graph_of

BEGIN, TIME = 0.7, 0.4
"""Of a hop [s]."""


@cache
def hop(robot: str, acceleration: float = g) -> RobotGraph:
    """A squat that is lifted from the floor for `TIME` by a parabola."""
    motion = rr.read_motion(SAMPLES / "wave.bvh")
    since = np.arange(len(motion)) / motion.fps - BEGIN
    rise = acceleration * np.clip(since * (TIME - since), 0, None) / 2
    lifted = replace(motion, positions=motion.positions + rise[:, None, None] * [0.0, 0.0, 1.0])
    return rr.describe(lifted, robot)


@pytest.mark.parametrize("robot", ["op3", "g1_class"])
def test_the_path_of_a_robot_of_any_size_falls_freely_in_the_humans_time(robot: str) -> None:
    graph = hop(robot)
    first, last = (round((BEGIN + share * TIME) * graph.fps) for share in (0.15, 0.85))
    height = graph.pelvis[:, 2]
    fall = np.diff(height, 2)[first - 1 : last - 1] * graph.fps**2
    np.testing.assert_allclose(fall, -g, rtol=0.05)
    assert height.max() - height[: first // 2].max() == pytest.approx(g * TIME**2 / 8, rel=0.2)


def test_the_centre_of_mass_falls_freely_whatever_the_legs_do() -> None:
    """Shanks and feet, and the knee ends of thighs, are 0.222 of the body [Winter2009]. They rise so that its mass falls at g, its pelvis at 0.7 g."""
    motion = rr.read_motion(SAMPLES / "wave.bvh")
    since = np.arange(len(motion)) / motion.fps - BEGIN
    rise = g * np.clip(since * (TIME - since), 0, None) / 2
    legs = [any(part in name for part in ("Knee", "Ankle", "Toe")) for name in motion.skeleton.names]
    lifts = rise[:, None] * (0.7 + 0.3 / 0.222 * np.array(legs))
    tucked = replace(motion, positions=motion.positions + lifts[..., None] * [0.0, 0.0, 1.0])
    graph = rr.describe(tucked, "g1_class")
    first, last = (round((BEGIN + share * TIME) * graph.fps) for share in (0.15, 0.85))
    fall = np.diff(graph.pelvis[:, 2], 2)[first - 1 : last - 1] * graph.fps**2
    np.testing.assert_allclose(fall, -g * (1 - 0.3 * graph.match.leg_ratio), rtol=0.05)


@pytest.mark.parametrize("robot", ["op3", "g1_class"])
def test_the_ground_gives_back_the_speed_that_a_flight_takes(robot: str) -> None:
    """The sum of second differences is the change of the speed, that of the path."""
    graph = hop(robot)
    track = graph.kinds["smoothness"]
    bend = track.lower[1:-1, track.ends.index(("root 2", "second difference"))]
    speed = np.diff(graph.pelvis[:, 2])
    assert bend.sum() == pytest.approx(speed[-1] - speed[0], abs=1e-9)
    flight = slice(*(round((BEGIN + share * TIME) * graph.fps) for share in (0.2, 0.8)))
    np.testing.assert_allclose(bend[flight] * graph.fps**2, -g, rtol=0.1)


def test_the_jerk_of_the_root_is_that_of_its_bounce_and_of_no_other_direction() -> None:
    graph = hop("g1_class")
    target, names = graph.kinds["jerk"].lower, [end for end, _ in graph.kinds["jerk"].ends]
    bend = graph.kinds["smoothness"].lower[1:-1, names.index("root 2")]
    np.testing.assert_allclose(target[1:-2, names.index("root 2")], np.diff(bend), atol=1e-12)
    assert not np.delete(target, names.index("root 2"), axis=1).any()


def test_the_ground_has_no_flights() -> None:
    falls = rr.describe(SAMPLES / "walk.bvh", "op3").human.falls
    assert falls is not None and not falls.any()


@pytest.mark.parametrize("acceleration", [0.3 * g, 2.5 * g])
def test_a_body_that_rises_otherwise_than_in_free_fall_keeps_its_scaled_path(acceleration: float) -> None:
    graph = hop("op3", acceleration)
    assert graph.human.falls is not None and not graph.human.falls.any()


def test_the_solved_robot_falls_freely_between_take_off_and_landing() -> None:
    """The root within 5 % of g, by the parabola that fits its height best."""
    graph = hop("g1_class")
    first, last = (round((BEGIN + share * TIME) * graph.fps) for share in (0.1, 0.9))
    solved = rr.solve(graph.frames(first - 15, last + 15)).trajectory.qpos[15 : 15 + last - first, 2]
    acceleration = 2 * np.polyfit(np.arange(len(solved)) / graph.fps, solved, 2)[0]
    assert acceleration == pytest.approx(-g, rel=0.05)


@pytest.mark.parametrize("robot", ["op3", "g1_class"])
def test_balance_keeps_the_scaled_human_in_flights_and_the_users_edits(robot: str) -> None:
    """The free fall of a small robot would be a jump that no playback on its feet has."""
    graph = hop(robot)
    assert graph.human.falls is not None
    scaled = graph_of(graph.motion, replace(graph.human, falls=None), graph.robot, graph.weights)
    balanced = graph.with_priority("path", 2.0).balanced(1.0)
    np.testing.assert_allclose(balanced.pelvis, scaled.pelvis, atol=1e-12)
    for name in ("path", "foothold", "smoothness"):
        for found, expected in zip(balanced.kinds[name].intervals, scaled.kinds[name].intervals, strict=True):
            np.testing.assert_allclose(found, expected, atol=1e-12)
    np.testing.assert_array_equal(balanced.kinds["path"].priority, 2.0 * scaled.kinds["path"].priority)
