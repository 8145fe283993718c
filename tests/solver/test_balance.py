"""What a motion in balance must be: feet that stand still, mass over them, a stand at either end, no fall."""

import copy
from dataclasses import replace
from itertools import pairwise, product

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.ndimage import gaussian_filter1d
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

import robot_retarget as rr
from robot_retarget.base.errors import BalanceError, UsageError
from robot_retarget.base.files import SAMPLES
from robot_retarget.contact.record import standing_on
from robot_retarget.judge.compensate import compensated
from robot_retarget.judge.playback import Playback, roll_out
from robot_retarget.judge.rollout import plant_of
from robot_retarget.robot import world_points
from robot_retarget.robot.distances import Separation
from robot_retarget.robot.dynamics import joint_torques, tread
from robot_retarget.robot.kinematics import difference, integrate
from robot_retarget.robot.support import support
from robot_retarget.solver.balance.balanced_ik import BalancedIk, balanced_stand, stand_places
from robot_retarget.solver.balance.footsteps import foothold_places, gaps, planted_feet, spread, without_small_swings
from robot_retarget.solver.balance.plan import (
    DYNAMIC,
    PlaybackClip,
    Steadiness,
    Timeline,
    plan_centre,
    timeline_of,
)
from robot_retarget.solver.balance.playback import (
    Pacing,
    begun,
    least_durations,
    motion_needs,
    steps_alone,
    stretched,
    swing_time,
)
from robot_retarget.solver.pipeline import Result

LEVER = 0.25 / 9.81
"""Of a centre of mass 0.25 m above the floor [s²]."""
SQUARE = np.array([[0.1, 0.1], [-0.1, 0.1], [-0.1, -0.1], [0.1, -0.1]])
IN_ORDER = [0, 3, 1, 2]
"""From around a sole to front left, front right, rear left, rear right."""
LEFT, RIGHT = SQUARE / 2 + [0.0, 0.06], SQUARE / 2 - [0.0, 0.06]


@pytest.fixture(scope="module")
def standing() -> Result:
    """A walk in place: the feet never leave the floor."""
    motion = rr.read_motion(SAMPLES / "walk.bvh").resample(15)
    return rr.retarget(motion, rr.load_robot("op3"), legs="stand", balance="static")


@pytest.fixture(scope="module")
def squat() -> Result:
    motion = rr.read_motion(SAMPLES / "squat.bvh").resample(15)
    return rr.retarget(motion, rr.load_robot("op3"), legs="follow", balance="static")


@pytest.fixture(scope="module")
def ik() -> BalancedIk:
    return BalancedIk(rr.describe(rr.read_motion(SAMPLES / "wave.bvh"), rr.load_robot("op3")).frames(0, 60))


def mass_centres(robot: rr.Robot, qpos: np.ndarray) -> np.ndarray:
    data, found = mujoco.MjData(robot.model), []
    for q in qpos:
        data.qpos[:] = q
        mujoco.mj_kinematics(robot.model, data)
        mujoco.mj_comPos(robot.model, data)
        found.append(data.subtree_com[robot.root_body].copy())
    return np.array(found)


@given(arrays(float, (7, 2), elements=st.floats(-1, 1)), arrays(float, 2, elements=st.floats(-1.2, 1.2)))
@settings(max_examples=60, deadline=None)
def test_a_point_is_inside_a_support_where_some_corners_surround_it(corners: np.ndarray, point: np.ndarray) -> None:
    corners = corners + np.random.default_rng(0).normal(scale=0.05, size=corners.shape)
    margin = support(corners).margin(point)
    around = np.sort(np.arctan2(*(corners - point).T))
    widest = np.diff([*around, around[0] + 2 * np.pi]).max()
    assert abs(margin) < 1e-6 or (margin > 0) == (widest < np.pi)


def test_a_planned_path_keeps_mass_and_zero_moment_point_over_the_feet_and_shifts_before_a_foot_lifts() -> None:
    both, left = support(np.concatenate([LEFT, RIGHT])), support(LEFT)
    supports = [both] * 60 + [left] * 30 + [both] * 60
    how = Steadiness(keep=0.6)
    plan = plan_centre(np.zeros((150, 2)), np.full(150, LEVER), supports, 30.0, how)
    c = plan.centre
    acceleration = np.zeros_like(c)
    acceleration[1:-1] = (c[2:] - 2 * c[1:-1] + c[:-2]) * 30.0**2
    acceleration[0], acceleration[-1] = (c[1] - c[0]) * 30.0**2, (c[-2] - c[-1]) * 30.0**2
    zmp = c - LEVER * acceleration
    for polygon, mass, point in zip(supports, c, zmp, strict=True):
        assert min(polygon.shrunk(0.6).margin(mass), polygon.shrunk(0.6).margin(point)) > -1e-4
    assert plan.excess.max() < 1e-4
    assert c[45, 1] > 0.005 and c[59, 1] > 0.025 and abs(c[0, 1]) < 0.005


def test_a_shift_without_the_time_for_it_is_reported_as_excess() -> None:
    left, right = support(LEFT), support(RIGHT)
    plan = plan_centre(np.zeros((60, 2)), np.full(60, LEVER), [left] * 30 + [right] * 30, 30.0, Steadiness(keep=0.5))
    assert plan.excess.max() > 0.01


def test_a_dynamic_plan_keeps_the_zero_moment_point_over_feet_that_the_mass_swings_past() -> None:
    left, right = support(LEFT), support(RIGHT)
    supports, keep = [left] * 12 + [right] * 12 + [left] * 12 + [right] * 12, 0.8
    plans = {
        static: plan_centre(np.zeros((48, 2)), np.full(48, LEVER), supports, 30.0, Steadiness(keep, static))
        for static in (True, False)
    }
    c = plans[False].centre
    zmp = c[1:-1] - LEVER * (c[2:] - 2 * c[1:-1] + c[:-2]) * 30.0**2
    assert min(p.shrunk(keep).margin(x) for p, x in zip(supports[1:-1], zmp, strict=True)) > -2e-3
    assert plans[False].excess.max() < 2e-3 < 0.01 < plans[True].excess.max()
    assert min(p.margin(x) for p, x in zip(supports, c, strict=True)) < 0


def test_a_walk_sways_no_farther_than_a_pendulum_that_stands_in_the_middle_of_each_foot() -> None:
    """A pendulum whose zero moment point rests at ± p for a time T each sways by p (1 − 1 / cosh(T / 2√lever))."""
    period, steps, middle = 15, 8, 0.06
    supports = ([support(LEFT)] * period + [support(RIGHT)] * period) * (steps // 2)
    sway = middle * (1 - 1 / np.cosh(period / 30 / 2 / np.sqrt(LEVER)))
    target, lever = np.zeros((len(supports), 2)), np.full(len(supports), LEVER)
    sways = [
        np.abs(plan_centre(target, lever, supports, 30.0, how).centre[2 * period : -2 * period, 1]).max()
        for how in DYNAMIC
    ]
    assert 0.2 * sway < sways[0] < sways[1] < sway


def test_swings_and_shifts_of_weight_are_given_their_time_and_long_stances_are_left_alone() -> None:
    planted = np.ones((90, 2), bool)
    planted[20:29, 0] = planted[30:39, 1] = planted[50:80, 1] = False
    durations = least_durations(planted, 30.0, Pacing(swing=0.8, transfer=0.3)) / 30
    both = durations[28:30].sum() / 2  # a frame lasts from the middle of the one interval to that of the other
    assert both >= 0.3 - 1e-9 and durations[19:29].sum() >= 0.8 - 1e-9
    assert (np.delete(durations, range(19, 39)) == 1 / 30).all()
    assert durations[19:28] == pytest.approx(0.08) and durations[30:39] == pytest.approx(0.08)


def test_a_pause_for_a_shift_of_weight_takes_little_time_from_the_swings_around_it() -> None:
    """A clip of 60 frames whose frames 28 to 31 last eight times as long: half a playback."""
    stretch, fps = np.ones(60), 30.0
    stretch[28:32] = 8.0
    times = np.concatenate([[0.0], np.cumsum(stretch)])
    at = np.interp(np.arange(1, times[-1]), times, np.arange(61))
    pause = (at > 28) & (at < 32)
    timeline = Timeline(at, np.ones(len(at)), np.ones((len(at), 2), bool), fps)
    longer = stretched(stretch, timeline, np.where(pause, 1.25, 1.0), Pacing()) / stretch
    assert longer[28:32].min() > 1.24 and longer.max() < 1.25 + 1e-9
    assert ((longer - 1) * stretch)[[*range(28), *range(32, 60)]].sum() < 0.25 * ((longer - 1) * stretch)[28:32].sum()


def test_a_held_first_pose_asks_for_time_of_the_first_frame() -> None:
    at = np.concatenate([np.zeros(40), np.arange(1.0, 30.0)])
    timeline = Timeline(at, np.ones(len(at)), np.ones((len(at), 2), bool), 30.0)
    needs = np.where(np.arange(len(at)) < 10, 1.5, 1.0)
    longer = stretched(np.ones(30), timeline, needs, Pacing(slowest=9.0))
    assert longer[0] > 1.45 and longer[3:] == pytest.approx(1.0, abs=0.01)


def test_a_load_beyond_the_torque_speed_line_asks_for_time_and_one_at_rest_does_not(ik: BalancedIk) -> None:
    robot = ik.robot
    held = np.tile(ik.robot.standing(), (40, 1))
    turning, elbow = held.copy(), robot.joint_names.index("l_el")
    turning[:, robot.qpos_index[elbow]] -= np.linspace(0, 0.6 * robot.max_speed[elbow] * 39 / 30, 40)
    rest, load = np.zeros((40, len(robot.joint_names))), np.zeros((40, len(robot.joint_names)))
    inside, friction = np.ones(40), np.zeros(40)
    for torque, slower in ((-0.2, False), (-0.6, True), (0.6, False)):  # the last one brakes
        load[:, elbow] = torque * robot.max_torque[elbow]
        for burst in (1.0, 1.3):  # the load is 1.2 of the line with 0.9 of it usable: 1.21 times too fast
            needs = motion_needs(robot, turning, (load, rest), inside, friction, 30.0, Pacing(burst=burst))[:-1]
            assert (needs > 1).all() == (slower and burst == 1)
    assert (motion_needs(robot, held, (load, load), inside, friction, 30.0, Pacing()) == 1).all()


def test_feet_that_would_slide_are_given_the_time_that_brings_them_under_their_friction(ik: BalancedIk) -> None:
    """Twice as slow, a motion needs a quarter of the friction."""
    robot, rest = ik.robot, np.zeros((40, len(ik.robot.joint_names)))
    held, inside = np.tile(ik.robot.standing(), (40, 1)), np.ones(40)
    pacing = Pacing(friction=0.2, most=10.0)
    for needed, factor in ((0.19, 1.0), (0.8, 2.0)):
        friction = np.full(40, needed)
        assert motion_needs(robot, held, (rest, rest), inside, friction, 30.0, pacing) == pytest.approx(factor)


def torques_of(ik: BalancedIk, pose: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of a pose held for a second: (n,) in motion and at rest by inverse dynamics, and what servos give in a simulation."""
    robot, held = ik.robot, np.tile(pose, (30, 1))
    moving, resting = joint_torques(robot, held, 30.0, ik.soles)
    plant, trajectory = plant_of(robot, "free"), rr.Trajectory(held, 30.0, robot.joint_names, robot.name)
    playback = Playback(settle_before=2.0)
    rollout = roll_out(plant, trajectory, "free", playback, compensated(plant, trajectory, "free", playback))
    return moving[-1], resting[-1], rollout.torque[-1]


def test_torques_at_rest_are_those_that_servos_give_in_a_simulated_stand(ik: BalancedIk) -> None:
    moving, resting, simulated = torques_of(ik, balanced_stand(ik, stand_places(ik)))
    np.testing.assert_allclose(moving, resting, atol=1e-9)
    pitch = [k for k, name in enumerate(ik.robot.joint_names) if name.endswith(("knee", "hip_pitch", "el"))]
    np.testing.assert_allclose(simulated[pitch], resting[pitch], atol=0.06)


def test_a_foot_that_hovers_over_the_floor_bears_nothing_yet(ik: BalancedIk) -> None:
    """Else the servos are told to let go of the leg that stands, and the other one comes down before its time."""
    places = stand_places(ik)
    stand, middle = balanced_stand(ik, places), places[1].mean(axis=0)[:2]
    places[0, :, 2] += 0.004
    pose = ik.stand(stand, places, middle)
    _, resting, simulated = torques_of(ik, pose)
    hips = [ik.robot.joint_names.index(f"{side}_hip_roll") for side in "lr"]
    assert np.abs(resting[hips[1]]) > 0.5
    np.testing.assert_allclose(simulated[hips], resting[hips], atol=0.1)


@given(st.integers(0, 10_000))
@settings(max_examples=15, deadline=None)
def test_stands_have_their_soles_on_their_places_and_their_mass_over_its_spot(ik: BalancedIk, seed: int) -> None:
    """Wherever they stand, whichever way they face and somewhat astride, first over the middle and then beside it."""
    draw, robot = np.random.default_rng(seed), ik.robot
    turn, places = draw.uniform(-np.pi, np.pi), stand_places(ik)
    places[:, :, :2] += draw.uniform([-0.01, 0.0], [0.01, 0.02], (2, 1, 2)) * [[[1, 1]], [[1, -1]]]
    spin = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    places[..., :2] = places[..., :2] @ spin.T + draw.normal(size=2)
    stand, middle = balanced_stand(ik, places), places.mean(axis=(0, 1))[:2]
    spot = middle + draw.uniform(-0.015, 0.015, 2)
    for pose, centre in ((stand, middle), (ik.stand(stand, places, spot), spot)):
        assert np.abs(ik.corners(pose[None])[0] - places).max() < 5e-4
        assert np.abs(mass_centres(robot, pose[None])[0, :2] - centre).max() < 5e-4
        angles = pose[robot.qpos_index]
        assert (angles >= robot.lower - 1e-9).all() and (angles <= robot.upper + 1e-9).all()


def test_a_stand_with_toes_turned_62_degrees_apart_has_its_soles_on_their_places(ik: BalancedIk) -> None:
    places = stand_places(ik)
    for sole, turn in zip(places, (31.0, -31.0), strict=True):
        middle, spin = sole.mean(axis=0), Rotation.from_euler("z", turn, degrees=True)
        sole[:] = spin.apply(sole - middle) + middle
    missing = gaps(stand_places(ik)[None])[0] - gaps(places[None])[0]
    places[..., 1] += missing / 2 * np.array([[1.0], [-1.0]])
    assert np.abs(ik.corners(balanced_stand(ik, places)[None])[0] - places).max() < 5e-4


def soles(lift: float, travel: float = 0.0, frames: int = 60) -> np.ndarray:
    """Two square soles; the left one rises by `lift` in the middle third and comes down `travel` further on."""
    corners = np.zeros((frames, 2, 4, 3))
    corners[:, 0, :, :2], corners[:, 1, :, :2] = LEFT[IN_ORDER], RIGHT[IN_ORDER]
    share = np.clip(np.linspace(-1, 2, frames), 0, 1)[:, None]
    corners[:, 0, :, 2] += lift * np.sin(np.pi * share) ** 2
    corners[:, 0, :, 0] += travel * share
    return corners


def planted_soles(corners: np.ndarray) -> np.ndarray:
    """Feet to stand on while the human lifts a foot the moment that it rises at all, without small swings."""
    stands = np.repeat(corners[:, :, :1, 2] < 1e-6, 2, axis=2)
    labels = standing_on(("l", "r"), stands)
    return without_small_swings(planted_feet(labels, labels, corners, 30.0), corners, 0.22, 30.0)


@pytest.mark.parametrize(
    ("lift", "travel", "steps"), [(0.001, 0.0, False), (0.01, 0.0, False), (0.08, 0.0, True), (0.02, 0.1, True)]
)
def test_only_a_foot_that_is_lifted_well_or_put_elsewhere_leaves_the_floor(
    lift: float, travel: float, steps: bool
) -> None:
    corners = soles(lift, travel)
    planted = planted_soles(corners)
    assert planted[:, 1].all() and (not planted[:, 0].all()) == steps


@given(st.floats(-np.pi, np.pi), st.floats(-0.1, 0.2))
@settings(max_examples=30, deadline=None)
def test_feet_are_set_apart_sideways_as_far_as_in_the_stand_whichever_way_they_point(turn: float, gap: float) -> None:
    spin = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    own, corners = soles(0.0, frames=1)[0], soles(0.0, frames=1)
    corners[0, 0, :, 1] += gap
    corners[..., :2] = corners[..., :2] @ spin.T
    set_apart = spread(corners, own)[0] @ np.block([[spin, np.zeros((2, 1))], [np.zeros((1, 2)), np.eye(1)]])
    assert (set_apart[0] - set_apart[1]).mean(axis=0)[1] == pytest.approx(0.12 + max(gap, 0.0), abs=1e-9)


@given(arrays(float, (2, 3), elements=st.floats(-0.15, 0.15)))
@settings(max_examples=60, deadline=None)
def test_the_gap_between_two_soles_is_their_distance_where_edge_faces_edge_and_negative_where_they_overlap(
    poses: np.ndarray,
) -> None:
    """Against the nearest of many points of the one sole to the other."""
    rectangle = np.array([[0.06, 0.04], [0.06, -0.04], [-0.06, 0.04], [-0.06, -0.04]])
    corners, grid = np.zeros((1, 2, 4, 3)), np.stack(np.meshgrid(*[np.linspace(-1, 1, 41)] * 2), -1).reshape(-1, 2)
    inside = []
    for foot, (x, y, turn) in enumerate(poses * [1, 1, 8]):
        spin = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
        corners[0, foot, :, :2] = rectangle @ spin.T + [x, y]
        inside.append((grid * [0.06, 0.04]) @ spin.T + [x, y])
    nearest = KDTree(inside[1]).query(inside[0])[0].min()
    gap = gaps(corners)[0]
    assert gap <= nearest + 1e-9
    if nearest > 0.01:
        assert gap > 0 and nearest < 2 * gap  # apart only cornerwise, the edges see less
    if gap < -0.005:
        assert nearest < 0.005


def test_footholds_that_would_overlap_are_set_apart() -> None:
    corners = soles(0.05, 0.1)
    corners[:, 1, :, :2] += [0.05, 0.06]
    planted = np.ones((len(corners), 2), bool)
    planted[20:40, 0] = False
    assert gaps(corners)[0] < -0.03
    places = foothold_places(planted, corners, 0.03, 0.01)
    assert gaps(places)[planted.all(axis=1)].min() > 0.01 - 1e-6
    assert np.ptp(places[:, 1], axis=0).max() == 0


def test_a_foot_in_the_air_goes_around_the_one_that_stands() -> None:
    corners = soles(0.05, 0.1)
    corners[:, 0, :, 1] -= 0.06 * np.sin(np.linspace(0, np.pi, len(corners)))[:, None]
    planted = np.ones((len(corners), 2), bool)
    planted[5:-5, 0] = False
    middle = len(corners) // 2
    for gap in (0.01, 0.02):
        assert gaps(corners)[middle] < gap
        assert gaps(foothold_places(planted, corners, 0.03, gap))[middle] == pytest.approx(gap, abs=1e-6)


def test_a_jump_is_refused_with_its_time_and_the_way_out() -> None:
    """One decision: what no robot plays on its own feet is what balance refuses."""
    motion = rr.read_motion(SAMPLES / "wave.bvh")
    since = np.arange(len(motion)) / motion.fps - 0.7
    rise = 9.81 * np.clip(since * (0.5 - since), 0, None) / 2
    jump = replace(motion, positions=motion.positions + rise[:, None, None] * [0.0, 0.0, 1.0]).resample(15)
    graph = rr.describe(jump, "op3")
    assert graph.human.not_standing.startswith("the human leaves the floor, longest from 0.")
    with pytest.raises(
        BalanceError, match=r"leaves the floor, longest from 0\.\d to 1\.\d s.*legs 'stand'.*balance 'off'"
    ):
        rr.solve(graph, legs="follow")


def test_feet_that_hover_for_a_step_over_a_tenth_of_a_leg_do_not_jump() -> None:
    corners = soles(0.11 * 0.22, 0.1)
    corners[:, 1, :, 2] = corners[:, 0, :, 2]
    assert planted_soles(corners).any(axis=1).all()


def test_a_swing_leaves_and_meets_its_footholds_flat_and_clears_the_floor_between() -> None:
    corners = soles(0.02, 0.1)
    planted = planted_soles(corners)
    places = foothold_places(planted, corners, 0.03, 0.01)
    swing = np.flatnonzero(~planted[:, 0])
    assert np.abs(np.diff(places[:, 0], axis=0)).max() < 0.015
    assert (places[planted[:, 0], 0, :, 2] == 0).all() and places[swing, 0, :, 2].min() >= 0
    assert places[swing, 0, :, 2].min(axis=1).max() > 0.029


def test_legs_that_stand_never_move_their_soles_whatever_the_human_does(standing: Result) -> None:
    robot, anatomy = standing.robot, standing.match.anatomy
    for sole in anatomy.soles.values():
        places = world_points(robot, sole, standing.trajectory.qpos)
        assert np.abs(places - places[0]).max() < 1e-3
    hands = world_points(robot, standing.match.points, standing.trajectory.qpos)[:, standing.match.index("l_hand")]
    assert np.ptp(hands, axis=0).max() > 0.02


def test_a_playback_begins_and_ends_at_rest_in_a_balanced_stand(standing: Result, squat: Result) -> None:
    for result in (standing, squat):
        robot, qpos = result.robot, result.trajectory.qpos
        for frame, step in ((0, 1), (-1, -2)):
            centre = mass_centres(robot, qpos[[frame]])[0, :2]
            corners = [world_points(robot, s, qpos[[frame]])[0] for s in result.match.anatomy.soles.values()]
            polygon = support(np.concatenate(corners))
            assert polygon.margin(centre) > 0.7 * polygon.margin(polygon.middle)
            assert np.abs(qpos[frame] - qpos[step]).max() < 0.01


def test_every_frame_has_its_human_and_its_figures(squat: Result) -> None:
    solution = squat.solution
    assert len(squat.motion) == len(squat.trajectory) == len(solution.cost) == len(solution.status)
    assert np.allclose(solution.cost, sum(solution.stress.values()), rtol=1e-9, atol=0)
    assert squat.balance is not None and any("stand before and after" in note for note in squat.notes)


def test_joints_keep_to_their_speeds(standing: Result) -> None:
    robot, qpos = standing.robot, standing.trajectory.qpos[:, standing.robot.qpos_index]
    assert (np.abs(np.diff(qpos, axis=0)) * standing.trajectory.fps <= robot.max_speed).all()


def test_the_planned_zero_moment_point_is_the_one_of_the_contact_forces(squat: Result) -> None:
    """Where the simulated ground pushes, against the plan of the motion."""
    robot, trajectory = squat.robot, squat.trajectory
    plant, playback = plant_of(robot, "free"), Playback(settle_before=2.0)
    rollout = roll_out(plant, trajectory, "free", playback, compensated(plant, trajectory, "free", playback))
    force, torque = rollout.ground[:, 2], rollout.ground[:, 3:]
    pushed = np.stack([-torque[:, 1], torque[:, 0]], axis=1) / force[:, None]
    times = np.arange(len(trajectory)) / trajectory.fps
    seen = np.stack([np.interp(times, rollout.times, column) for column in pushed.T], axis=1)
    assert squat.balance is not None
    assert np.ptp(trajectory.qpos[:, 2]) > 0.04 and np.abs(seen - squat.balance.zmp).max() < 0.01


def test_links_of_a_playback_stay_out_of_each_other_at_frames_and_between(standing: Result, squat: Result) -> None:
    for result in (standing, squat):
        robot, qpos = result.robot, result.trajectory.qpos
        separation = Separation(robot, 0.0)
        ways = [(a, difference(robot, a, b)) for a, b in pairwise(qpos)]
        deepest = [separation.depth(integrate(robot, a, share * way)) for a, way in ways for share in (0.0, 0.5)]
        assert max(deepest) < 1e-3


def test_the_moment_about_the_vertical_is_that_of_the_contact_forces(ik: BalancedIk) -> None:
    """Arms that swing against each other turn a robot over its feet."""
    robot, time = ik.robot, np.arange(121) / 30
    swung = np.tile(balanced_stand(ik, stand_places(ik)), (121, 1))
    swing = np.sin(np.pi * time / 4) ** 2 * np.sin(np.pi * time)
    for joint in ("l_sho_pitch", "r_sho_pitch"):
        swung[:, robot.qpos_index[robot.joint_names.index(joint)]] += swing
    trajectory = rr.Trajectory(swung, 30.0, robot.joint_names, robot.name)
    plant, playback = plant_of(robot, "free"), Playback(settle_before=2.0)
    rollout = roll_out(plant, trajectory, "free", playback, compensated(plant, trajectory, "free", playback))
    force, torque = rollout.ground[:, :3], rollout.ground[:, 3:]
    point = np.stack([-torque[:, 1], torque[:, 0]], axis=1) / force[:, 2:]
    twist = (torque[:, 2] - point[:, 0] * force[:, 1] + point[:, 1] * force[:, 0]) / force[:, 2]
    planned, seen = tread(robot, swung, 30.0).twist, np.interp(time, rollout.times, gaussian_filter1d(twist, 4))
    assert np.abs(planned).max() > 1e-3 and np.corrcoef(planned, seen)[0, 1] > 0.9
    assert seen.std() == pytest.approx(planned.std(), rel=0.2)


@pytest.mark.parametrize("pace", [1.0, 4.0])
def test_steps_are_steps_at_any_pace_and_a_swing_that_the_clip_cuts_lasts_as_long_as_any(
    ik: BalancedIk, pace: float
) -> None:
    """A clip that begins on both feet and ends with the left one in the air."""
    places = stand_places(ik)
    clip = PlaybackClip(
        ik.graph,
        np.tile(ik.robot.standing(), (60, 1)),
        np.tile(places, (60, 1, 1, 1)),
        np.ones((60, 2), bool),
        30.0,
    )
    clip.planted[20:40, 1] = clip.planted[50:, 0] = False
    clip.corners[50:, 0, :, 2] = 0.03
    stands = [balanced_stand(ik, places)] * 2
    timeline = timeline_of(ik, clip, stands, np.full(59, pace))
    assert (~timeline.planted[:, 1]).sum() == pytest.approx(20 * pace, abs=pace)
    within = 9.5 * pace
    assert (~timeline.planted[:, 0]).sum() == pytest.approx(
        max(30 * clip.swing, within + 15 * clip.swing), abs=pace + 1
    )


def test_a_foot_whose_swing_the_clip_cuts_follows_the_clip_to_the_cut_and_stands_where_it_is_there(
    ik: BalancedIk,
) -> None:
    """The left foot is on its way ahead at the last frame, 50 mm in front of the other; the frames after it are no frames of the clip."""
    places, planted = np.tile(stand_places(ik), (60, 1, 1, 1)), np.ones((60, 2), bool)
    planted[45:, 0], places[45:, 0, :, 0] = False, places[45:, 0, :, 0] + np.linspace(0, 0.05, 15)[:, None]
    places[46:, 0, :, 2] = 0.03
    stand = balanced_stand(ik, places[0])
    plan = begun(ik, PlaybackClip(ik.graph, np.tile(stand, (60, 1)), places, planted, 30.0), DYNAMIC).plan
    time, forward = plan.timeline, plan.places[:, 0, :, 0].mean(axis=1) - stand_places(ik)[0, :, 0].mean()
    cut = int(np.flatnonzero(time.at == 59)[0])
    assert forward[cut:] == pytest.approx(0.05, abs=2e-3) and forward[cut] > forward[cut - 5]
    assert not time.planted[cut, 0] and time.planted[-1].all() and time.inside[-1] == cut
    assert (np.diff(time.phase) > 0).all()


def test_steps_alone_put_soles_on_their_places_and_the_mass_over_its_path_within_two_millimetres(
    ik: BalancedIk,
) -> None:
    """A step of 40 mm: the plan of its start, followed by root and legs."""
    places, planted = np.tile(stand_places(ik), (60, 1, 1, 1)), np.ones((60, 2), bool)
    planted[20:40, 1], places[30:, 1, :, 0] = False, places[30:, 1, :, 0] + 0.04
    stand = balanced_stand(ik, places[0])
    plan = begun(ik, PlaybackClip(ik.graph, np.tile(stand, (60, 1)), places, planted, 30.0), DYNAMIC).plan
    alone = steps_alone(ik, plan)
    assert np.abs((ik.corners(alone) - plan.places)[plan.timeline.planted]).max() < 1e-3
    assert np.abs(mass_centres(ik.robot, alone)[:, :2] - plan.zmp.centre).max() < 2e-3
    assert (np.abs(np.diff(alone[:, ik.robot.qpos_index], axis=0)) * 30 <= ik.robot.max_speed).all()
    limbs = np.setdiff1d(ik.robot.qpos_index, ik.leg_coordinates)
    assert np.array_equal(alone[:, limbs], plan.targets[:, limbs])


def test_a_plan_keeps_a_zero_moment_point_inside_that_drifts_from_the_pendulums() -> None:
    """The drift is that of limbs that swing, 1 cm either way; the polygon is a square of 20 cm."""
    drift = 0.01 * np.stack([np.sin(np.arange(90) / 5), np.cos(np.arange(90) / 7)], axis=1)
    towards = np.full((90, 2), 0.5)
    how = Steadiness(keep=0.5, static=False)
    plain, made_up = (
        plan_centre(towards, np.full(90, LEVER), [support(SQUARE)] * 90, 30.0, how, d) for d in (None, drift)
    )
    assert np.abs(plain.pendulum + drift).max() > 0.055
    assert np.abs(made_up.pendulum + drift).max() < 0.0501
    acceleration = np.gradient(np.gradient(made_up.centre, 1 / 30, axis=0), 1 / 30, axis=0)
    assert made_up.pendulum[2:-2] == pytest.approx((made_up.centre - LEVER * acceleration)[2:-2], abs=2e-3)


def test_a_motion_of_one_frame_is_refused_with_the_alternatives() -> None:
    motion = rr.read_motion(SAMPLES / "wave.bvh").frames(5, 6)
    with pytest.raises(BalanceError, match=r"one frame.*balance 'off'"):
        rr.retarget(motion, rr.load_robot("op3"))


def test_a_swing_of_a_shorter_step_takes_less_time() -> None:
    planted, shares = np.ones((30, 2), bool), np.ones((30, 2))
    planted[5:8, 0] = planted[15:18, 1] = False
    shares[15:18, 1] = 0.5
    taken = least_durations(planted, 30.0, Pacing(swing=0.4, transfer=0.0), shares)
    assert taken[4:8].sum() == pytest.approx(30 * 0.4) and taken[14:18].sum() == pytest.approx(30 * 0.2)


def test_a_swing_takes_half_the_time_on_servos_twice_as_fast(ik: BalancedIk) -> None:
    faster = copy.copy(ik)
    faster.robot = replace(ik.robot, max_speed=2 * ik.robot.max_speed)
    assert swing_time(faster) == pytest.approx(swing_time(ik) / 2)
    assert 0.35 <= swing_time(ik) <= 0.65


@pytest.fixture(scope="module")
def walk() -> Result:
    return rr.retarget(rr.read_motion(SAMPLES / "walk.bvh"), rr.load_robot("op3"))


def test_a_walk_has_the_humans_pace_and_steps(walk: Result) -> None:
    found = walk.balance
    assert found is not None and (found.legs, found.mode) == ("follow", "dynamic")
    assert found.slowdown < 1.1 and found.stride > 0.95


def test_a_walk_sways_as_little_as_the_margin_allows(walk: Result) -> None:
    """With the conditions that stay up in every walk, it has 12 mm and more."""
    found = walk.balance
    assert found is not None and 0.007 <= found.margin.min() < 0.0115
    assert walk.trajectory.likeness["plan_margin_m"] == pytest.approx(found.margin.min(), abs=1e-4)


def test_the_report_lists_the_ways_that_were_tried_and_the_one_played_is_the_first_that_keeps_its_limits(
    walk: Result,
) -> None:
    rows = walk.trajectory.likeness["attempts"]
    assert [bool(row["reasons"]) for row in rows] == [True] * (len(rows) - 1) + [False]
    found, played = walk.balance, rows[-1]
    assert found is not None and (played["legs"], played["mode"]) == (found.legs, found.mode)
    assert played["margin_m"] == pytest.approx(found.margin.min(), abs=1e-4)
    assert played["slowdown"] == pytest.approx(found.slowdown, abs=1e-3) and 0 < played["solved"] <= Pacing.rounds


def test_legs_of_a_walk_are_within_seven_degrees_of_the_humans(walk: Result) -> None:
    assert walk.likeness.part("legs") < np.radians(7.0) and walk.likeness.part("trunk") < np.radians(5.0)


def test_balance_bends_the_knees_of_a_standing_human_no_further_than_the_human_does() -> None:
    """Planted feet leave the limbs as near to the human's as without balance."""
    graph = rr.describe(rr.read_motion(SAMPLES / "wave.bvh").frames(0, 60), rr.load_robot("op3"))
    free, balanced = (rr.solve(graph, balance=balance).likeness.figures() for balance in ("off", "static"))
    assert balanced["limb_rad_legs"] < free["limb_rad_legs"] + np.radians(1.0)
    assert balanced["limb_rad"] < free["limb_rad"] + np.radians(0.5)


def test_hands_that_clap_meet_by_their_surfaces_and_count_as_touching() -> None:
    clap = rr.retarget(rr.read_motion(SAMPLES / "clap.bvh").resample(30).frames(30, 70), rr.load_robot("op3"))
    model, data, gaps = clap.robot.model, mujoco.MjData(clap.robot.model), []
    hands = [np.flatnonzero(model.geom_bodyid == model.body(f"{side}_el_link").id).tolist() for side in "lr"]
    for data.qpos[:] in clap.trajectory.qpos:
        mujoco.mj_kinematics(model, data)
        gaps.append(min(mujoco.mj_geomDistance(model, data, a, b, 1.0, None) for a, b in product(*hands)))
    assert 0 < min(gaps) < 0.003 < 0.01 < gaps[0]
    assert clap.likeness.contacts is not None and clap.likeness.contacts > 0.8
    middles = replace(clap.likeness.pair, model=None).touches.share
    assert middles is not None and middles < 0.8  # thick hands meet while their middles are apart


def test_forearms_of_a_walk_pass_knees_at_a_distance_between_frames_too(walk: Result) -> None:
    """Half of the distance at frames is left for servos that err."""
    robot, qpos = walk.robot, walk.trajectory.qpos
    model, data = robot.model, mujoco.MjData(robot.model)
    solid = [g for g in range(model.ngeom) if model.geom_contype[g] or model.geom_conaffinity[g]]
    own = {
        link: [g for g in solid if model.body(model.geom_bodyid[g]).name == link]
        for link in (f"{s}_{end}_link" for s in "lr" for end in ("el", "knee"))
    }
    nearest = np.inf
    for before, after in pairwise(qpos):
        data.qpos[:] = integrate(robot, before, 0.5 * difference(robot, before, after))
        mujoco.mj_kinematics(model, data)
        for side in "lr":
            for pair in product(own[f"{side}_el_link"], own[f"{side}_knee_link"]):
                nearest = min(nearest, mujoco.mj_geomDistance(model, data, *pair, 0.05, None))
    assert nearest > 0.03 * walk.graph.match.robot_leg


def test_a_human_who_turns_around_in_place_is_followed_in_small_steps_without_a_fall() -> None:
    """By 170° in 1.5 s over the spot where it waves, with feet that never leave the floor."""
    waves = rr.read_motion(SAMPLES / "wave.bvh").resample(10).frames(0, 24)
    spin = Rotation.from_euler("z", np.radians(170) * np.clip(np.linspace(-0.3, 1.3, 24), 0, 1)[:, None])
    middle = waves.positions[:1, :1] * [1.0, 1.0, 0.0]
    assert waves.rotations is not None
    own = [Rotation.from_quat(joints, scalar_first=True) for joints in waves.rotations]
    turned = np.array([(turn * joints).as_quat(scalar_first=True) for turn, joints in zip(spin, own, strict=True)])
    places = middle + np.einsum("tij,tkj->tki", spin.as_matrix(), waves.positions - middle)
    robot = rr.load_robot("op3")
    result = rr.retarget(replace(waves, positions=places, rotations=turned, whole=None), robot)
    found, root = result.balance, Rotation.from_quat(result.trajectory.qpos[:, 3:7], scalar_first=True)
    assert found is not None and found.legs == "follow" and (~found.timeline.planted).any(axis=0).all()
    turn = np.unwrap(root.as_euler("ZYX")[:, 0])
    assert turn[-1] - turn[0] == pytest.approx(np.radians(170), abs=0.35)
    report = rr.simulate(result.trajectory, robot, mode="free", draws=0, playback=Playback(settle_after=2.0))
    assert report.figures["fall_s"] is None and report.figures["foot_slip_m"] < 0.01, report.reasons


def test_a_walk_is_walked_on_the_robots_own_feet_without_a_fall() -> None:
    robot = rr.load_robot("op3")
    result = rr.retarget(rr.read_motion(SAMPLES / "walk.bvh").frames(0, 75), robot, legs="follow", balance="static")
    report = rr.simulate(result.trajectory, robot, mode="free", draws=0, playback=Playback(settle_after=2.0))
    assert result.balance is not None and result.balance.slowdown < 4 and not result.balance.timeline.planted.all()
    assert np.ptp(result.trajectory.qpos[:, 0]) > 0.15
    assert report.figures["fall_s"] is None and report.figures["foot_slip_m"] < 0.01, report.reasons


def test_a_balanced_squat_and_a_walk_in_place_stay_upright_on_servos(standing: Result, squat: Result) -> None:
    for result in (standing, squat):
        report = rr.simulate(result.trajectory, result.robot, mode="free", draws=0, playback=Playback(settle_after=2.0))
        assert report.figures["fall_s"] is None, report.reasons


def test_choices_that_do_not_go_together_are_refused() -> None:
    motion, robot = rr.read_motion(SAMPLES / "wave.bvh").frames(0, 5), rr.load_robot("op3")
    for legs, balance, said in (
        ("hop", "auto", "follow, stand"),
        ("follow", "often", "static"),
        ("stand", "off", "needs balance: 'static' or 'dynamic'"),
    ):
        with pytest.raises(UsageError, match=said):
            rr.retarget(motion, robot, legs=legs, balance=balance)  # pyright: ignore[reportArgumentType]


def test_a_robot_without_a_free_root_cannot_be_balanced() -> None:
    robot = rr.load_robot("op3")
    bolted = replace(robot, root_joints=np.zeros(0, int))
    with pytest.raises(BalanceError, match="free root"):
        rr.retarget(rr.read_motion(SAMPLES / "wave.bvh").frames(0, 5), bolted, balance="static")
