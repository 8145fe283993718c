"""A long clip in windows: every frame once, bounded, and no seam where they join."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot_retarget.base.files import SAMPLES
from robot_retarget.base.progress import Count
from robot_retarget.graph.describe import describe
from robot_retarget.graph.footholds import foothold_corners
from robot_retarget.human.read import read_motion
from robot_retarget.robot import load_robot, world_points
from robot_retarget.robot.support import sole_corners
from robot_retarget.solver.clip_model import clip_of
from robot_retarget.solver.limits import targets_of
from robot_retarget.solver.minimum import ClipMinimum
from robot_retarget.solver.options import Smoothing, Windows
from robot_retarget.solver.pipeline import Result, retarget
from robot_retarget.solver.solve import problem_of
from robot_retarget.solver.sqp import FrameSolver

SHORT = Windows(3.0)
seconds = st.floats(0.1, 5.0)


@given(st.integers(1, 2000), st.floats(1.0, 240.0), seconds, seconds, seconds)
def test_windows_keep_every_frame_once_and_fix_only_what_was_kept(
    frames: int, fps: float, more: float, kept: float, foreseen: float
) -> None:
    windows = list(Windows(kept + foreseen + more, kept, foreseen).cut(frames, fps))
    done = 0
    for window in windows:
        assert window.first + window.fixed == done <= window.final <= window.last <= frames
        done = window.final
    assert done == frames
    around = max(1, round(kept * fps)) + max(1, round(foreseen * fps))
    longest = max(round((kept + foreseen + more) * fps), around + 1) + around
    assert max(w.last - w.first for w in windows) <= longest


def test_a_clip_little_longer_than_a_window_stays_whole() -> None:
    assert len(list(Windows(20.0, 1.0, 1.0).cut(660, 30.0))) == 1


def test_a_stance_that_began_in_the_window_before_stays_where_it_was() -> None:
    corners = np.tile(np.array([[0.1, 0.05, 0], [0.1, -0.05, 0], [-0.1, 0.05, 0], [-0.1, -0.05, 0]]), (6, 1, 1))
    corners[2:, ..., 0] += 0.3  # the coarse path wanders off
    assert np.allclose(foothold_corners(np.ones((6, 4), dtype=bool), corners, fixed=2), corners[0])


def test_known_frames_stay_to_the_last_bit_though_they_miss_a_hard_edge_and_overlap() -> None:
    graph = describe(read_motion(SAMPLES / "clap.bvh").frames(0, 9), load_robot("op3")).unbalanced()
    graph = graph.with_edge("l_hand", "r_hand", 0.2, hard=True)
    solver, robot, draw = FrameSolver(problem_of(graph)), graph.robot, np.random.default_rng(0)
    arms = robot.qpos_index[[k for k, name in enumerate(robot.joint_names) if "_sho_" in name or name.endswith("_el")]]
    start = np.tile(robot.standing(), (9, 1))
    while solver.depth(start[0]) < 0.01:
        start[:, arms] = draw.uniform(-1.5, 1.5, len(arms))
    start[0] = robot.standing()  # no joint turns so fast from here, and the way back is clear
    clip = clip_of(solver, targets_of(graph.tracks), Smoothing(steps=2), graph.fps, fixed=4)
    qpos = np.array([pose.qpos for pose in ClipMinimum(clip, start).finish(Count(None, 1))])
    np.testing.assert_array_equal(qpos[:4], start[:4])
    assert (np.abs(qpos - start)[5:].max(axis=1) > 1e-3).all()  # the first may go back to the one before


@pytest.fixture(scope="module")
def walk() -> tuple[Result, Result]:
    motion, robot = read_motion(SAMPLES / "walk.bvh").resample(20), load_robot("op3")
    whole, cut = Smoothing(), replace(Smoothing(), windows=SHORT)
    return retarget(motion, robot, smoothing=whole, balance="off"), retarget(
        motion, robot, smoothing=cut, balance="off"
    )


def test_a_walk_in_windows_is_hardly_rougher_around_their_joins_than_in_one(walk: tuple[Result, Result]) -> None:
    whole, cut = (
        np.abs(np.diff(result.trajectory.qpos[:, load_robot("op3").qpos_index], 2, axis=0)).max(axis=1)
        for result in walk
    )
    joins = [w.first + w.fixed for w in list(SHORT.cut(len(cut) + 2, 20.0))[1:]]
    assert len(joins) >= 2
    assert max(cut[t - 3 : t + 3].max() for t in joins) < 1.05 * whole.max()


def test_a_foot_that_stands_across_a_join_does_not_move(walk: tuple[Result, Result]) -> None:
    result, robot = walk[1], load_robot("op3")
    held, met = result.graph.human.contacts, 0
    for join in [w.first + w.fixed for w in list(SHORT.cut(len(result.trajectory), 20.0))[1:]]:
        for foot in "lr":
            if held.of(foot)[join - 1 : join + 1].all():
                place = world_points(
                    robot, sole_corners(result.match.anatomy, foot), result.trajectory.qpos[join - 1 : join + 1]
                )
                assert np.linalg.norm(place[1] - place[0], axis=1).max() < 1e-3
                met += 1
    assert met > 0


def test_windows_follow_the_motion_as_well_as_the_whole(walk: tuple[Result, Result]) -> None:
    whole, cut = (float(result.solution.posture_error.mean()) for result in walk)
    assert cut < 1.05 * whole
