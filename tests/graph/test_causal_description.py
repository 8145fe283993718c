"""Targets of a stream equal those of the whole clip, except where these depend on later frames."""

import numpy as np
import pytest

from robot_retarget.base.files import SAMPLES
from robot_retarget.graph.describe import CausalTargets, RobotGraph, describe
from robot_retarget.graph.footholds import CLOSING, SWERVE
from robot_retarget.graph.track import HARD, Role, columns_of, ordered
from robot_retarget.human.causal import LEAP, CausalFeatures
from robot_retarget.human.read import read_motion
from robot_retarget.robot import load_robot
from robot_retarget.solver.limits import targets_of

CLIPS = ("walk", "squat", "wave", "clap", "hips_and_bow")


@pytest.fixture(scope="module", params=CLIPS)
def graph(request: pytest.FixtureRequest) -> RobotGraph:
    return describe(read_motion(SAMPLES / f"{request.param}.bvh"), load_robot("op3"), fps=30)


def asked(graph: RobotGraph) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(T, E) bounds and π, frame by frame; the robot's soles are where the human's way has them."""
    human, all_targets, motion = (
        CausalFeatures(graph.human),
        CausalTargets(graph),
        graph.motion,
    )
    soles = graph.kinds["foothold"].lower.reshape(len(graph), -1, 4, 3)
    found = []
    for t, positions in enumerate(motion.positions):
        turns = None if motion.rotations is None else motion.rotations[t]
        frame = all_targets.at(human.step(positions, turns, 1 / graph.fps), soles[t], 1 / graph.fps)
        found.append([np.array(each) for each in frame])
    lower, upper, priority, _ = (np.array(each) for each in zip(*found, strict=True))
    return lower, upper, priority


def test_frame_by_frame_the_same_is_asked_as_of_the_whole(graph: RobotGraph) -> None:
    (lower, upper, priority), whole, columns = asked(graph), targets_of(graph.tracks), columns_of(ordered(graph.tracks))
    for track in graph.tracks:
        edges = columns[track.name]
        if track.role is not Role.COST or track.name == "foothold" or track.stencil[-1] > 0:
            continue
        on = whole.priority[:, edges] > 0
        assert np.abs(lower[:, edges] - whole.lower[:, edges])[on].max(initial=0.0) < 1e-6, track.name
        assert np.abs(upper[:, edges] - whole.upper[:, edges])[on].max(initial=0.0) < 1e-6, track.name
        if track.name != "touch":
            assert np.allclose(priority[:, edges], whole.priority[:, edges], rtol=1e-9), track.name


def test_soles_stand_where_the_whole_clip_has_them_stand_but_for_moments(graph: RobotGraph) -> None:
    track = graph.kinds["foothold"]
    first = sum(len(other) for other in graph.tracks[: graph.tracks.index(track)])
    between = 1.01 * np.sqrt(HARD * graph.weights.swing)  # a foot that lands or leaves has more, or less
    standing = asked(graph)[2][:, first : first + len(track) : 3] > between
    whole = track.priority[:, ::3] >= HARD
    assert (standing == whole).mean() > 0.85


@pytest.mark.parametrize("yaw", [-1.5, -0.4, 0.4, 1.5])
def test_a_foot_lands_as_the_robots_heads_and_turns_slowly_to_the_humans(yaw: float) -> None:
    """A standing human; the robot's feet are turned by `yaw` about their middles."""
    graph, turn = describe(read_motion(SAMPLES / "squat.bvh"), load_robot("op3"), fps=30), [np.cos(yaw), np.sin(yaw)]
    track, soles = graph.kinds["foothold"], graph.kinds["foothold"].lower[0].reshape(-1, 4, 3)
    first = sum(len(other) for other in graph.tracks[: graph.tracks.index(track)])
    middle = soles.mean(axis=1, keepdims=True)
    corners = middle + (soles - middle) @ np.array([[turn[0], turn[1], 0.0], [-turn[1], turn[0], 0.0], [0.0, 0.0, 1.0]])
    human, all_targets, found = CausalFeatures(graph.human), CausalTargets(graph), []
    for t, positions in enumerate(graph.motion.positions[:60]):
        turns = None if graph.motion.rotations is None else graph.motion.rotations[t]
        lower, _, priority, _ = all_targets.at(human.step(positions, turns, 1 / 30), corners, 1 / 30)
        edges = slice(first, first + len(track))
        if priority[edges][0] > track.priority[0, 0] / 2:
            places = lower[edges].reshape(soles.shape)
            found.append([headed(place) - headed(sole) for place, sole in zip(places, soles, strict=True)])
    away = (np.array(found) + np.pi) % (2 * np.pi) - np.pi
    assert len(away) > 30
    assert np.abs(np.diff(away, axis=0)).max() <= CLOSING / 30 + 1e-9
    assert np.abs(away[-1] - np.clip(yaw, -SWERVE, SWERVE)).max() < 0.05
    assert (
        np.abs(away[0] - yaw).max() < 4 * CLOSING / 30
    )  # a foot counts as standing here when it has gained its priority


def headed(sole: np.ndarray) -> float:
    """The direction from mid-heel to mid-toes of corners (4, 3) along the floor [rad]."""
    ahead = sole[:2].mean(axis=0) - sole[2:].mean(axis=0)
    return float(np.arctan2(ahead[1], ahead[0]))


def test_a_touch_comes_on_within_its_time_and_no_faster(graph: RobotGraph) -> None:
    track = graph.kinds["touch"]
    first = sum(len(other) for other in graph.tracks[: graph.tracks.index(track)])
    priority = asked(graph)[2][:, first : first + len(track)] / graph.weights.touch
    assert np.abs(np.diff(priority, axis=0)).max(initial=0.0) <= 1 / (0.1 * graph.fps) + 1e-9


def test_who_is_put_elsewhere_goes_on_from_where_he_was() -> None:
    graph = describe(read_motion(SAMPLES / "walk.bvh"), load_robot("op3"), fps=30)
    motion = graph.motion
    still, leaping = (CausalFeatures(graph.human) for _ in range(2))
    for t, positions in enumerate(motion.positions):
        turns = None if motion.rotations is None else motion.rotations[t]
        away = np.array([LEAP, -LEAP, 0.0]) if t >= 40 else np.zeros(3)
        here, there = (one.step(x, turns, 1 / 30) for one, x in ((still, positions), (leaping, positions + away)))
        assert np.abs(there.positions - here.positions).max() < 0.2
    assert (still.leaps, leaping.leaps) == (0, 1)
