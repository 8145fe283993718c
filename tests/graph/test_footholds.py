"""Stances and footholds: where a sole stands it stays, flat; near in time to a stance a swing foot is led to it."""

from dataclasses import replace
from functools import cache
from itertools import pairwise

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation
from shared_files import SHARED, needs_shared

from robot_retarget.base.arrays import Floats, intervals, smoothstep
from robot_retarget.base.files import SAMPLES
from robot_retarget.contact.record import ContactRecord
from robot_retarget.graph.describe import RobotGraph, describe
from robot_retarget.graph.footholds import (
    Surface,
    _come_down,
    _edges_down,
    foothold_corners,
    footholds_of,
    median_pose,
    settled_heading,
    without_unreachable,
)
from robot_retarget.graph.soles import HEEL, TOE, flattened, lengths, soles_of
from robot_retarget.graph.track import HARD
from robot_retarget.human.features import features_of, floor_under
from robot_retarget.human.match import match
from robot_retarget.human.motion import Motion
from robot_retarget.human.read import read_motion
from robot_retarget.robot import Robot, load_robot, world_points
from robot_retarget.robot.recognise import recognise
from robot_retarget.robot.support import sole_corners
from robot_retarget.solver.solve import solve_graph
from robot_retarget.solver.stream import stream

SOLE = np.array([[0.2, 0.05, 0], [0.2, -0.05, 0], [0, 0.05, 0], [0, -0.05, 0]])
"""Front left, front right, rear left, rear right [m]."""
stances = st.integers(8, 40).flatmap(lambda frames: arrays(bool, frames))


@cache
def walk() -> RobotGraph:
    return describe(read_motion(SAMPLES / "walk.bvh"), load_robot("op3"), fps=30)


def test_a_stance_lies_on_the_plane_of_its_median_height() -> None:
    heights, normals = np.array([0.0, 0.3, 0.1, 0.2, 9.0, 5.0]), np.random.default_rng(0).normal(size=(6, 3))
    places = np.stack([np.arange(6.0), np.zeros(6), heights], axis=1)
    place, normal = Surface(places, normals, np.zeros((6, 3))).over(slice(0, 5))
    np.testing.assert_array_equal((place, normal), (places[3], normals[3]))


def schedule(motion: Motion) -> ContactRecord:
    matched = match(motion, load_robot("op3"))
    return features_of(motion, matched).contacts


def tilted(draw: np.random.Generator, frames: int) -> Floats:
    """(T, 4, 3) a sole that goes its own way, tilted by up to half a radian."""
    turns = np.cumsum(draw.normal(scale=0.05, size=(frames, 3)), axis=0)
    c, s = np.cos(turns), np.sin(turns)
    one, zero = np.ones(frames), np.zeros(frames)
    z = np.array([[c[:, 0], -s[:, 0], zero], [s[:, 0], c[:, 0], zero], [zero, zero, one]]).transpose(2, 0, 1)
    y = np.array([[c[:, 1], zero, s[:, 1]], [zero, one, zero], [-s[:, 1], zero, c[:, 1]]]).transpose(2, 0, 1)
    return SOLE @ (z @ y).swapaxes(1, 2) + np.cumsum(draw.normal(scale=0.01, size=(frames, 1, 3)), axis=0)


def turning_on_a_foot() -> Motion:
    """A standing human who turns by 1.2 rad about the right toes, then stands."""
    motion = read_motion(SAMPLES / "squat.bvh").resample(30)
    yaw = 1.2 * smoothstep((np.arange(50) - 20).clip(0, 20) / 20)
    turn = Rotation.from_rotvec(yaw[:, None] * [0, 0, 1]).as_matrix()
    stand = motion.positions[0]
    toe = stand[match(motion, load_robot("op3")).recognition.marks["r_toe"].joints[0]]
    return replace(motion.frames(0, 50), positions=(stand - toe) @ turn.swapaxes(1, 2) + toe, rotations=None)


def shape(corners: Floats) -> Floats:
    """(…, 4, 4) distances between corners."""
    return np.linalg.norm(corners[..., :, None, :] - corners[..., None, :, :], axis=-1)


def test_a_squatting_human_stands_on_both_whole_soles_throughout() -> None:
    assert schedule(read_motion(SAMPLES / "squat.bvh")).stands.mean(axis=(0, 2)).min() > 0.98


def test_a_walker_always_stands_on_one_foot_and_lifts_each_in_turn() -> None:
    left, right = (np.asarray(walk().human.contacts.of(side).any(axis=1)) for side in "lr")
    assert (left | right).mean() > 0.95
    assert len(intervals(~left)) >= 3 and len(intervals(~right)) >= 3


def test_stances_do_not_depend_on_the_frame_rate() -> None:
    motion = read_motion(SAMPLES / "walk.bvh")
    slow, fast = schedule(motion.resample(30)), schedule(motion.resample(120))
    for side in "lr":
        assert (slow.of(side) == fast.of(side)[::4][: len(slow.of(side))]).mean() > 0.95


@given(arrays(bool, st.integers(0, 40)))
def test_intervals_are_the_runs_of_true(flags: np.ndarray) -> None:
    runs = intervals(flags)
    inside = [t for start, stop in runs for t in range(start, stop)]
    assert inside == np.flatnonzero(flags).tolist()
    assert all(first[1] < second[0] for first, second in pairwise(runs))


def test_drifting_heights_are_levelled_and_level_ones_kept() -> None:
    motion = read_motion(SAMPLES / "walk.bvh")
    matched = match(motion, load_robot("op3"))
    x = matched.human_positions(motion)

    def grounded(x: Floats) -> Floats:
        return x - floor_under(x, matched, motion.fps)[:, None, None] * [0, 0, 1]

    feet = [matched.index(k) for k in ("l_toe", "r_toe", "l_ankle", "r_ankle")]
    level = grounded(x)
    rise = np.linspace(0, 1.0, len(x))[:, None, None] * [0, 0, 1]
    drifted = grounded(x + rise)
    assert np.ptp(level - x, axis=0).max() < 1e-12
    assert np.abs((drifted - level)[:, feet, 2]).max() < 0.15 and np.allclose(drifted[..., :2], x[..., :2])


@given(st.integers(0, 2**32 - 1))
def test_a_sole_laid_flat_keeps_its_middle_heading_and_shape(seed: int) -> None:
    corners = tilted(np.random.default_rng(seed), 5)
    flat = flattened(corners)
    assert (flat[..., 2] == 0).all()
    assert np.allclose(flat.mean(axis=1)[:, :2], corners.mean(axis=1)[:, :2])
    assert np.allclose(shape(flat), shape(corners), atol=1e-9)
    one, other = lengths(flat), lengths(corners)
    assert np.allclose(one[:, 0] * other[:, 1], one[:, 1] * other[:, 0]) and ((one * other).sum(axis=1) > 0).all()
    assert np.allclose(flattened(flat), flat)


def test_a_step_between_0_and_1_is_at_rest_at_both_ends() -> None:
    share = np.linspace(0, 1, 101)
    slope = np.gradient(smoothstep(share), share)
    assert smoothstep(share)[[0, 50, -1]].tolist() == [0.0, 0.5, 1.0]
    assert slope[0] < 0.04 > slope[-1] and (slope > 0).all()


@given(stances, st.integers(0, 2**32 - 1))
def test_a_foot_that_stands_is_flat_and_still_wherever_it_goes_by_itself(stands: np.ndarray, seed: int) -> None:
    corners = tilted(np.random.default_rng(seed), len(stands))
    places = foothold_corners(np.repeat(stands[:, None], 4, axis=1), corners)
    for start, stop in intervals(stands):
        assert (places[start:stop] == places[start]).all() and (places[start][:, 2] == 0).all()
        assert np.allclose(shape(places[start]), shape(SOLE), atol=1e-9)
        middles = corners[start:stop].mean(axis=1)[:, :2]
        assert (places[start].mean(axis=0)[:2] <= middles.max(axis=0) + 0.1).all()
    if not stands.any():
        assert (places == corners).all()


@given(st.integers(0, 2**32 - 1), st.sampled_from([TOE, HEEL]))
def test_a_foot_on_its_toes_or_heels_alone_keeps_its_edges_as_wide_and_on_the_floor(seed: int, edge: list[int]) -> None:
    corners = tilted(np.random.default_rng(seed), 6)
    held = np.zeros((6, 4), dtype=bool)
    held[1:5, edge] = True
    down = foothold_corners(held, corners)[1]
    for one, other in (TOE, HEEL):
        assert np.allclose(down[[one, other], 2], 0)
        assert np.linalg.norm(down[one] - down[other]) == pytest.approx(np.linalg.norm(SOLE[one] - SOLE[other]))


@given(st.integers(0, 2**32 - 1), st.floats(-np.pi, np.pi))
def test_footholds_turn_with_the_human(seed: int, yaw: float) -> None:
    draw = np.random.default_rng(seed)
    corners, held = tilted(draw, 30), np.repeat(draw.random((30, 2)) < 0.8, 2, axis=1)
    turn = Rotation.from_euler("z", yaw).as_matrix()
    assert np.allclose(foothold_corners(held, corners @ turn.T), foothold_corners(held, corners) @ turn.T, atol=1e-9)


def test_the_pose_of_a_stance_is_that_of_most_of_its_frames() -> None:
    corners = np.repeat(tilted(np.random.default_rng(1), 1), 9, axis=0)
    moved = corners.copy()
    moved[:2] += [0.3, -0.2, 0.1]
    assert np.allclose(median_pose(moved), corners[0], atol=1e-12)


@given(arrays(float, 30, elements=st.floats(-0.3, 0.3)), st.floats(0.01, 0.2))
def test_the_heading_of_a_stance_stays_within_a_backlash_of_the_foot_and_moves_no_more_than_it_must(
    steps: np.ndarray, backlash: float
) -> None:
    foot = np.cumsum(steps)
    ahead, stands = np.column_stack([np.cos(foot), np.sin(foot)]), np.ones((30, 4), dtype=bool)
    settled = settled_heading(stands, ahead, backlash)
    assert np.abs(settled - foot).max() <= backlash + 1e-9
    moves, taken = np.diff(settled), np.diff(foot)
    assert (np.abs(moves) <= np.abs(taken) + 1e-9).all() and (moves * taken >= -1e-12).all()
    if np.ptp(foot) <= backlash:
        assert np.ptp(settled) < 1e-12
    assert np.allclose(settled_heading(~stands, ahead, backlash), foot)


def test_a_foot_that_points_down_turns_no_foothold_by_noise() -> None:
    foot, size = 0.3 * (-1.0) ** np.arange(20), np.where(np.arange(20) < 10, 1.0, 0.2)
    ahead = size[:, None] * np.column_stack([np.cos(foot), np.sin(foot)])
    settled = settled_heading(np.ones((20, 4), dtype=bool), ahead, 0.1)
    assert np.ptp(settled[10:]) == 0 and np.ptp(settled[:10]) > 0.3


@given(st.integers(0, 2**32 - 1))
def test_a_foothold_that_turns_keeps_a_corner_its_shape_and_the_floor(seed: int) -> None:
    corners = flattened(tilted(np.random.default_rng(seed), 20))
    heading = np.linspace(0.4, 1.9, 20)
    places = foothold_corners(np.ones((20, 4), dtype=bool), corners, heading=heading)
    turn = Rotation.from_rotvec((heading - heading[0])[:, None] * [0, 0, 1]).as_matrix()
    assert np.allclose(lengths(places), (turn[:, :2, :2] @ lengths(places[0])), atol=1e-9)
    assert np.allclose(shape(places[-1]), shape(places[0]), atol=1e-9) and not places[..., 2].any()
    assert np.ptp(places, axis=0).max(axis=1).min() < 1e-12


def test_a_human_who_turns_on_the_ball_of_a_foot_turns_the_foothold_of_clip_and_stream() -> None:
    """By the turn less the backlash; the toes stay within the width of a sole."""
    graph = describe(turning_on_a_foot(), load_robot("g1_class")).unbalanced()
    clip = solve_graph(graph).trajectory.qpos
    streamed = np.array(list(stream(load_robot("g1_class"), turning_on_a_foot())))
    for qpos in (clip, streamed):
        sole = world_points(graph.robot, sole_corners(graph.match.anatomy, "r"), qpos)
        ahead = lengths(sole)[10:]
        assert np.ptp(np.unwrap(np.arctan2(ahead[:, 1], ahead[:, 0]))) > 0.8
        toes = sole[10:, TOE, :2].mean(axis=1)
        assert np.ptp(toes, axis=0).max() < 0.08


@given(st.integers(0, 2**32 - 1))
def test_a_swing_goes_its_own_way_shifted_from_one_foothold_to_the_next_without_a_leap(seed: int) -> None:
    corners = tilted(np.random.default_rng(seed), 40)
    stands = np.ones(40, dtype=bool)
    stands[10:30] = False
    places = foothold_corners(np.repeat(stands[:, None], 4, axis=1), corners, heading=np.zeros(40))
    offset = places - corners
    before, after = offset[9].mean(axis=0), offset[30].mean(axis=0)
    share = smoothstep((np.arange(40) - 9) / 21)[10:30, None, None]
    assert np.allclose(offset[10:30], (1 - share) * before + share * after)
    most = np.abs(after - before).max() * 1.5 / 21
    assert np.abs(np.diff(offset[9:31].mean(axis=1), axis=0)).max(initial=0.0) <= most + 1e-12


def test_a_heel_that_leaves_the_floor_before_the_toes_is_not_drawn_down_in_swing() -> None:
    corners, held = np.repeat(SOLE[None], 30, axis=0), np.ones((30, 4), dtype=bool)
    corners[8:20, HEEL, 2] = 0.15
    held[8:, HEEL], held[10:20] = False, False
    held[20:] = True
    assert np.allclose(foothold_corners(held, corners, heading=np.zeros(30))[10:20], corners[10:20])


@given(st.integers(1, 11), st.integers(0, 2**32 - 1))
def test_fixed_frames_stay_and_a_stance_that_began_in_them_goes_on_where_it_was(fixed: int, seed: int) -> None:
    corners, held = tilted(np.random.default_rng(seed), 40), np.zeros((40, 4), dtype=bool)
    corners[:12] = flattened(corners[:1])  # stands there, as the window before had it
    held[:20] = held[30:] = True
    places = foothold_corners(held, corners, fixed)
    assert np.allclose(places[:20], corners[0], atol=1e-12) and np.ptp(places[30:], axis=0).max() == 0
    offset = (places - corners)[19:31].mean(axis=1)
    assert np.abs(np.diff(offset, axis=0)).max() < 1.5 / 11 * np.abs(offset[-1] - offset[0]).max() + 1e-9


def test_one_foot_steps_while_the_legs_do_not_reach_both_footholds() -> None:
    """The one that is farther from its foothold; a single stance stays."""
    held, away = np.zeros((40, 2, 4), dtype=bool), np.zeros((40, 2))
    held[:20, 0] = held[10:, 1] = True
    away[:, 1] = 0.1
    free = without_unreachable(held, away, np.arange(40) < 18)
    assert np.array_equal(free[:, 0], held[:, 0]) and not free[8:18, 1].any() and free[24:, 1].all()
    for unreached in (np.zeros(40, dtype=bool), np.arange(40) < 10):
        assert np.array_equal(without_unreachable(held, away, unreached), held)


def test_read_off_a_human_ankles_stand_where_the_humans_do_scaled_by_the_leg() -> None:
    """Both feet further out by what the robot's hips are wider; a turn of the human about the vertical turns it all."""
    graph = walk()
    found = footholds_of(graph.human, graph.match, graph.robot)
    assert found.feet == ("l", "r") and found.places.shape == (len(graph), 2, 4, 3)
    assert (found.places[found.held][:, 2] == 0).all()
    for k, foot in enumerate(found.feet):
        ankle = graph.human.positions[:, graph.match.index(f"{foot}_ankle")]
        stands = intervals(np.asarray(found.held[:, k].all(axis=1)))
        middles = np.array([found.places[start, k].mean(axis=0)[:2] for start, _ in stands])
        theirs = np.array([np.median(ankle[start:stop], axis=0)[:2] for start, stop in stands]) * graph.match.leg_ratio
        assert np.allclose(np.diff(middles, axis=0), np.diff(theirs, axis=0), atol=0.02)


def pitched_foot(robot: Robot, body: int, pitch: float) -> Floats:
    """Brute force: the heights of the corners of a foot of a standing robot that is pitched, over its lowest vertex [m]."""
    data, model = mujoco.MjData(robot.model), robot.model
    data.qpos[:] = robot.standing()
    data.qpos[3:7] = (Rotation.from_euler("y", pitch) * Rotation.from_quat(data.qpos[3:7], scalar_first=True)).as_quat(
        scalar_first=True
    )
    mujoco.mj_kinematics(model, data)
    lowest = np.inf
    for geom in np.flatnonzero((model.geom_bodyid == body) & (model.geom_type == mujoco.mjtGeom.mjGEOM_MESH)):
        first, number = (int(x[model.geom_dataid[geom]]) for x in (model.mesh_vertadr, model.mesh_vertnum))
        vertices = model.mesh_vert[first : first + number] @ data.geom_xmat[geom].reshape(3, 3).T
        lowest = min(lowest, float((vertices + data.geom_xpos[geom])[:, 2].min()))
    corners = sole_corners(recognise(robot), "l")
    places = corners.offsets @ data.xmat[body].reshape(3, 3).T + data.xpos[body]
    return places[:, 2] - lowest


@needs_shared
@pytest.mark.parametrize("pitch", [0.3, 0.6, 1.0, 1.5])
@pytest.mark.parametrize(("edge", "way"), [(TOE, 1), (HEEL, -1)], ids=["toes", "heel"])
def test_a_round_foot_on_its_toes_or_heel_has_their_corners_as_high_as_its_mesh_says(
    pitch: float, edge: list[int], way: int
) -> None:
    """The recognised sole has some of the mesh's vertices, within 2 mm of its hull."""
    robot = load_robot(SHARED / "robots/unitree_g1/unitree_g1.xml")
    motion = read_motion(SAMPLES / "walk.bvh")
    human, matched = features_of(motion, match(motion, robot)), match(motion, robot)
    turn = Rotation.from_euler("y", way * pitch).as_matrix()
    axes = human.axes.copy()
    axes[:, human.calibration.segment_names.index("l_foot")] = turn
    held = np.zeros((len(human), 2, 4), dtype=bool)
    held[:, 0, edge] = True
    soles = soles_of(human, matched, robot)
    assert soles.feet[0] == "l"
    rises = soles.rises(replace(human, axes=axes), held)[0, 0]
    heights = pitched_foot(robot, sole_corners(recognise(robot), "l").bodies[0], way * pitch)
    np.testing.assert_allclose(rises[edge], heights[edge], atol=2e-3)
    assert not rises[[k for k in range(4) if k not in edge]].any()


def test_a_flat_foot_has_its_corners_on_the_floor() -> None:
    matched = match(walk().motion, load_robot("op3"))
    human = features_of(walk().motion, matched)
    assert not soles_of(human, matched, load_robot("op3")).rises(human, np.ones((len(human), 2, 4), bool)).any()


def test_toes_of_a_long_rigid_foot_swing_no_lower_than_the_humans_lowest_part_of_a_foot() -> None:
    """Scaled by the leg; oracle: toe and ankle over their lowest twentieth."""
    graph = walk()
    x, match, soles = graph.human.positions, graph.match, soles_of(graph.human, graph.match, graph.robot)
    corners = soles.lifted(graph.human)
    longer = replace(soles, corners=soles.corners + 0.05 * np.eye(3)[0] * (np.arange(4) < 2)[:, None]).lifted(
        graph.human
    )
    for k, foot in enumerate(soles.feet):
        toe, ankle = (x[:, match.index(f"{foot}_{part}"), 2] for part in ("toe", "ankle"))
        low = match.leg_ratio * np.minimum(toe - np.quantile(toe, 0.05), ankle - np.quantile(ankle, 0.05))
        assert low.max() > 0.01
        for found in (corners, longer):
            assert (found[:, k, TOE, 2].min(axis=1) > low - 0.003).all()


def test_without_balance_feet_in_swing_stay_as_high_as_the_plan_wherever_the_coarse_path_has_them() -> None:
    graph = walk().unbalanced()
    track, shape, up = graph.kinds["foothold"], (len(graph), 2, 4, 3), np.array([0.0, 0.0, 0.02])
    plan, swings = track.lower.reshape(shape), ~(track.priority.reshape(shape)[..., 2] >= HARD).any(axis=2)
    low = track.kind.solved(track, {track.name: (plan - up).reshape(track.lower.shape)})
    places = low.lower.reshape(shape)[..., 2].min(axis=2)
    assert np.allclose(places[swings], plan[..., 2].min(axis=2)[swings], atol=1e-9) and swings.any()
    assert (places[~swings] == 0).all()
    high = track.kind.solved(track, {track.name: (plan + up).reshape(track.lower.shape)})
    assert (high.lower.reshape(shape)[..., 2].min(axis=2)[swings] >= plan[..., 2].min(axis=2)[swings] - 1e-9).all()


def test_a_robot_that_is_bolted_to_the_world_has_no_footholds() -> None:
    graph = walk()
    bolted = replace(graph.robot, root_joints=np.zeros(0, dtype=np.int64))
    assert footholds_of(graph.human, graph.match, bolted).feet == ()


def test_corners_that_stand_are_held_hard_and_feet_in_swing_follow_their_path() -> None:
    graph = walk()
    track, held = graph.kinds["foothold"], footholds_of(graph.human, graph.match, graph.robot).held
    along = track.priority.reshape(len(graph), 2, 4, 3)
    stands = np.asarray(held.any(axis=2))
    assert (along[held] == HARD).all() and (along[stands[..., None] & ~held] == 0).all()
    assert (along[~stands] == graph.weights.swing).all() and (~stands).any()


def test_without_balance_each_foot_lands_one_frame_earlier_at_its_place() -> None:
    before, after = walk().kinds["foothold"], walk().unbalanced().kinds["foothold"]
    held = [(each.priority[:, ::3] >= HARD).reshape(len(each.lower), -1, 4) for each in (before, after)]
    landings = ~held[0][:-1].any(axis=2) & held[0][1:].any(axis=2)
    assert landings.sum() >= 3
    expected = held[0].copy()
    expected[:-1][landings] = held[0][1:][landings]
    assert np.array_equal(held[1], expected)
    places = after.lower.reshape(len(after.lower), -1, 12)
    assert np.array_equal(places[:-1][landings], places[1:][landings])


def test_footholds_of_a_solved_walk_do_not_slide() -> None:
    """By less than a millimetre over any stance, of the corners that are held."""
    graph = walk().frames(0, 90)
    qpos = solve_graph(graph).trajectory.qpos
    held, seen = footholds_of(graph.human, graph.match, graph.robot).held, 0
    for k, foot in enumerate("lr"):
        corners = world_points(graph.robot, sole_corners(graph.match.anatomy, foot), qpos)
        for corner in range(4):
            for start, stop in intervals(held[:, k, corner]):
                seen += 1
                assert np.ptp(corners[start:stop, corner], axis=0).max() < 1e-3
    assert seen >= 12


@given(st.floats(-3, 3), st.floats(-0.6, 0.6), st.floats(-0.4, 0.4), st.floats(0.0, 0.3))
def test_both_edges_of_a_sole_on_its_toes_are_laid_down_where_they_are(
    heading: float, pitch: float, roll: float, height: float
) -> None:
    """The independent way: each edge is turned about its middle into the floor's plane, and its middle is put on the floor."""
    turn = Rotation.from_euler("ZYX", [heading, pitch, roll])
    flat = np.array([[0.1, 0.03, 0], [0.1, -0.03, 0], [-0.05, 0.03, 0], [-0.05, -0.03, 0]])
    corners = turn.apply(flat) + np.array([0.4, -0.2, height])
    down = _edges_down(corners)
    np.testing.assert_allclose(down[:, 2], 0.0, atol=1e-12)
    for edge in (TOE, HEEL):
        way, laid = corners[edge[0]] - corners[edge[1]], down[edge[0]] - down[edge[1]]
        np.testing.assert_allclose(down[edge].mean(axis=0)[:2], corners[edge].mean(axis=0)[:2], atol=1e-12)
        assert np.linalg.norm(laid) == pytest.approx(np.linalg.norm(way))
        assert laid[:2] @ way[:2] == pytest.approx(np.linalg.norm(laid) * np.linalg.norm(way[:2]))


@given(st.floats(-3, 3), st.floats(-0.5, 0.5), st.sampled_from([TOE, HEEL, [0], [0, 1, 2, 3]]))
def test_a_foothold_that_comes_down_keeps_the_middle_of_the_held_corners(
    heading: float, pitch: float, held: list[int]
) -> None:
    flat = np.array([[0.1, 0.03, 0], [0.1, -0.03, 0], [-0.05, 0.03, 0], [-0.05, -0.03, 0]])
    corners = Rotation.from_euler("ZY", [heading, pitch]).apply(flat) + np.array([0.4, -0.2, 0.05])
    ahead = Rotation.from_euler("Z", heading).apply(flat)
    down = _come_down(corners, ahead, np.isin(np.arange(4), held), None)
    np.testing.assert_allclose(down[held, :2].mean(axis=0), corners[held, :2].mean(axis=0), atol=1e-9)
    np.testing.assert_allclose(down - down[0], ahead - ahead[0], atol=1e-9)
