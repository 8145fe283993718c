"""Stances and footholds: when a foot stands, where it stands, and how it goes from one place to the next."""

from dataclasses import replace

import numpy as np
import pytest

from robot_retarget.describe.contacts import intervals, stances
from robot_retarget.describe.edges import build_edges
from robot_retarget.describe.ground import grounded
from robot_retarget.describe.match import Match, match
from robot_retarget.motion import Motion, read_motion
from robot_retarget.robot import Points, load_robot, recognise, world_points
from robot_retarget.shipped import SAMPLES
from robot_retarget.solve.clip import Smoothing, clip_poses
from robot_retarget.solve.footing import (
    LEAST,
    flattened,
    footholds,
    held_corners,
    laid,
    led,
    near_footholds,
    nearing,
    sole_corners,
)
from robot_retarget.solve.frame import FrameSolver, Options
from robot_retarget.solve.problem import build_problem
from robot_retarget.solve.progress import Count


@pytest.fixture(scope="module")
def walk() -> tuple[Motion, Match]:
    motion = read_motion(SAMPLES / "walk.bvh")
    return motion, match(motion, load_robot("op3"))


def of(case: tuple[Motion, Match], motion: Motion | None = None) -> dict[str, np.ndarray]:
    chosen = motion or case[0]
    return stances(grounded(case[1].human_positions(chosen), case[1], chosen.fps), case[1], chosen.fps)


def test_a_squatting_human_stands_on_both_whole_soles_throughout() -> None:
    motion = read_motion(SAMPLES / "squat.bvh")
    matched = match(motion, load_robot("op3"))
    found = of((motion, matched))
    assert all(flags.mean() > 0.98 for flags in found.values())


def test_a_walker_always_stands_on_one_foot_and_lifts_each_in_turn(walk: tuple[Motion, Match]) -> None:
    found = of(walk)
    left, right = (np.asarray(found[s].any(axis=1)) for s in "lr")
    assert (left | right).mean() > 0.95
    assert len(intervals(~left)) >= 3 and len(intervals(~right)) >= 3


def test_stances_do_not_depend_on_the_frame_rate(walk: tuple[Motion, Match]) -> None:
    slow, fast = of(walk, walk[0].resample(30)), of(walk, walk[0].resample(120))
    for side in "lr":
        agree = slow[side] == fast[side][::4][: len(slow[side])]
        assert agree.mean() > 0.95


def test_intervals_are_the_runs_of_true() -> None:
    assert intervals(np.array([1, 1, 0, 0, 1, 0, 1], dtype=bool)) == [(0, 2), (4, 5), (6, 7)]
    assert intervals(np.zeros(3, dtype=bool)) == []


def test_flattened_corners_keep_middle_heading_and_shape() -> None:
    robot = load_robot("op3")
    corners = sole_corners(match(read_motion(SAMPLES / "wave.bvh"), robot).anatomy, "l")
    pose = robot.standing()
    pose[3:7] = [0.95, 0.1, -0.2, 0.2]
    tilted = world_points(robot, corners, pose[None])[0]
    flat = flattened(tilted)
    apart = [np.linalg.norm(c[:, None] - c[None], axis=2) for c in (tilted, flat)]
    assert np.allclose(flat[:, 2], 0) and np.allclose(flat[:, :2].mean(0), tilted[:, :2].mean(0))
    assert np.allclose(*apart, atol=1e-6)


def test_an_edge_laid_down_keeps_its_width_and_heading() -> None:
    draw = np.random.default_rng(0)
    corners = draw.normal(size=(4, 3))
    down = laid(corners, np.asarray(False))
    for k in (0, 2):
        assert np.linalg.norm(down[k] - down[k + 1]) == pytest.approx(np.linalg.norm(corners[k] - corners[k + 1]))
        across = (corners[k] - corners[k + 1])[:2]
        assert np.cross(np.append(across, 0), down[k] - down[k + 1]) == pytest.approx(np.zeros(3), abs=1e-12)


def test_footholds_stay_put_and_the_way_between_them_has_no_leap(walk: tuple[Motion, Match]) -> None:
    edges = build_edges(walk[0], walk[1])
    held = held_corners(edges.stances, ("l", "r"), len(edges))
    drifting = np.cumsum(np.full((len(edges), 2, 4, 3), 0.004), axis=0)
    drifting[..., :2, :] += [0.05, 0, 0]
    drifting[..., [0, 2], 1] += 0.02
    places = led(footholds(held, drifting), held, drifting)
    for foot in range(2):
        stands = np.asarray(held[:, foot].any(axis=1))
        for start, stop in intervals(stands):
            assert np.ptp(places[start:stop, foot], axis=0).max() < 1e-12
        middle = places[:, foot].mean(axis=1)[:, :2]
        longest = max(stop - start for start, stop in intervals(stands))
        leap = np.linalg.norm(np.diff(middle, axis=0), axis=1)[~stands[1:]].max()
        assert leap < 0.004 * longest  # a bare jump would make up a whole stance's drift at once


def test_a_foot_that_rolls_off_where_it_stands_is_led_along_its_own_way() -> None:
    """A raised heel is not off its foothold: nothing holds it there, and nothing should press it down in the air."""
    standing, lifted = np.array([[0.2, 0.05, 0], [0.2, -0.05, 0], [0, 0.05, 0], [0, -0.05, 0]]), np.zeros((12, 1))
    lifted[4:, 0] = np.linspace(0.01, 0.1, 8)
    draft = np.repeat(standing[None, None], 12, axis=0)
    draft[:, 0, 2:, 2] += lifted  # the heels first, while the toes stand, ...
    draft[6:, :, :, 0] += 0.05 * np.arange(1, 7)[:, None, None]  # ... then the whole foot goes ahead
    held = np.zeros((12, 1, 4), dtype=bool)
    held[:4] = held[4:6, :, :2] = True
    assert np.allclose(led(footholds(held, draft), held, draft)[6:], draft[6:], atol=1e-12)


def test_a_foot_in_the_air_goes_on_from_where_the_known_frames_have_it() -> None:
    standing = np.array([[0.2, 0.05, 0], [0.2, -0.05, 0], [0, 0.05, 0], [0, -0.05, 0]])
    draft = np.repeat(standing[None, None], 12, axis=0) + np.linspace(0, 0.3, 12)[:, None, None, None] * [1, 0, 0]
    held = np.zeros((12, 1, 4), dtype=bool)
    held[9:] = True
    places = led(footholds(held, draft, fixed=4), held, draft, fixed=4)
    assert np.allclose(places[:4], draft[:4]) and np.allclose(places[9:], places[9])
    assert np.linalg.norm(np.diff((places - draft)[:10, 0, 0], axis=0), axis=1).max() < 0.02


def test_feet_are_near_their_footholds_a_moment_before_and_after_alike() -> None:
    held = np.zeros((20, 2, 4), dtype=bool)
    held[8:12, 0] = held[:3, 1, :2] = True
    near = near_footholds(held, 30.0)
    assert np.allclose(near[5:15, 0], [1 / 16, 4 / 16, 9 / 16, 1, 1, 1, 1, 9 / 16, 4 / 16, 1 / 16])
    assert near[:5, 0].max() == near[15:, 0].max() == 0 and np.allclose(near[:7, 1], near[9:16, 0])
    stands = np.asarray(held.any(axis=2))
    assert np.array_equal(nearing(stands, 3)[8:], stands[8:])
    stands[13:15, 0] = True  # so soon after that the one stance is near the other
    assert (nearing(stands, 3)[stands] == 1).all()


def test_feet_land_and_leave_more_softly_than_if_nothing_led_them(walk: tuple[Motion, Match]) -> None:
    """By their speed along the floor in the last step before a stance and the first after it."""
    motion, robot = walk[0].resample(30.0).frames(0, 90), load_robot("op3")
    matched = match(motion, robot)
    edges = build_edges(motion, matched)
    solver = FrameSolver(build_problem(robot, matched, edges), Options())
    held = held_corners(edges.stances, solver.problem.feet, len(edges))
    stands = np.asarray(held.any(axis=2))
    speeds = []
    for grip in (solver.grip, replace(solver.grip, swing=0.0, step=0.0)):
        solver.grip = grip
        poses = clip_poses(solver, edges, held, Smoothing(), 30.0, Count(None, 1))
        steps = np.diff([solver.corners(pose.qpos).mean(axis=1)[:, :2] for pose in poses], axis=0)
        speeds.append(np.linalg.norm(steps, axis=2)[stands[1:] != stands[:-1]].mean())
    assert speeds[0] < 0.9 * speeds[1]


def test_drifting_heights_are_levelled_and_level_ones_kept(walk: tuple[Motion, Match]) -> None:
    motion, matched = walk
    x = matched.human_positions(motion)
    feet = [matched.index(k) for k in ("l_toe", "r_toe", "l_ankle", "r_ankle")]
    level = grounded(x, matched, motion.fps)
    rise = np.linspace(0, 1.0, len(x))[:, None, None] * [0, 0, 1]
    drifted = grounded(x + rise, matched, motion.fps)
    assert np.ptp(level - x, axis=0).max() < 1e-12
    assert np.abs((drifted - level)[:, feet, 2]).max() < 0.15 and np.allclose(drifted[..., :2], x[..., :2])


@pytest.mark.parametrize(
    "tread", [[[0.0, 0.0, -0.03]], [[-0.05, 0.0, -0.03], [0.06, 0.0, -0.03]]], ids=["point", "line"]
)
def test_a_foot_on_a_point_or_a_line_has_the_heading_of_its_frame(tread: list[list[float]]) -> None:
    whole = recognise(load_robot("op3"))
    body, axes = whole.frames["l_foot"]
    tips = Points(np.full(len(tread), body), np.array(tread) @ axes.T)
    corners = sole_corners(replace(whole, treads={"l": tips}), "l").offsets @ axes
    ahead, across = corners[:2].mean(axis=0) - corners[2:].mean(axis=0), corners[[0, 2]] - corners[[1, 3]]
    assert ahead[0] >= LEAST - 1e-9 and ahead[1:] == pytest.approx([0, 0], abs=1e-9)
    assert (across[:, 1] > LEAST - 1e-9).all() and corners[:, 2] == pytest.approx(-0.03)
    assert corners.mean(axis=0) == pytest.approx(np.mean(tread, axis=0))
    assert np.isfinite(laid(corners, np.array(True))).all()
