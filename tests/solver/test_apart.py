"""Links apart and chains closed: distances and slopes against MuJoCo and finite differences."""

import mujoco
import numpy as np
import pytest
from shared_files import SHARED, needs_shared

from robot_retarget.base.files import SAMPLES
from robot_retarget.base.progress import Count
from robot_retarget.graph.describe import describe
from robot_retarget.graph.rows import ClipRows
from robot_retarget.graph.track import Status
from robot_retarget.human.read import read_motion
from robot_retarget.robot import Robot, load_robot
from robot_retarget.robot.coupling import Coupling
from robot_retarget.robot.distances import Separation
from robot_retarget.robot.kinematics import carrying, difference, integrate
from robot_retarget.solver import minimum
from robot_retarget.solver.clip_model import clip_of
from robot_retarget.solver.descent import FrameSolution
from robot_retarget.solver.limits import targets_of
from robot_retarget.solver.minimum import ClipMinimum
from robot_retarget.solver.near_links import NearLinks, foremost, tightest_rows
from robot_retarget.solver.options import Smoothing
from robot_retarget.solver.pipeline import retarget
from robot_retarget.solver.problem import build_problem
from robot_retarget.solver.solve import solve_graph
from robot_retarget.solver.sqp import FrameSolver

TODDLER = SHARED / "robots/toddlerbot_2xc/toddlerbot_2xc.xml"


def crossed_arms() -> tuple[Separation, np.ndarray]:
    robot = load_robot("op3")
    pose = robot.standing()
    for side, sign in (("l", 1), ("r", -1)):
        index = robot.qpos_index[robot.joint_names.index(f"{side}_sho_pitch")]
        pose[index] = -1.2 * sign
        pose[robot.qpos_index[robot.joint_names.index(f"{side}_el")]] = -1.2 * sign
    return Separation(robot, 0.05), pose


def test_slopes_agree_with_central_differences() -> None:
    separation, pose = crossed_arms()
    robot, step = load_robot("op3"), 1e-6

    def nearest(at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        found, slope = separation.along(at[None])
        distance = found.distance
        order = np.argsort(distance)[tightest_rows(np.zeros(len(distance), int), -np.sort(distance), 24)]
        return distance[order], slope[order]

    distance, slope = nearest(pose)
    assert len(distance) > 3
    checked = 0
    for column, direction in enumerate(np.eye(robot.model.nv)):
        ahead, behind = (nearest(integrate(robot, pose, s * step * direction))[0] for s in (1, -1))
        if len(ahead) == len(behind) == len(distance):
            smooth = np.abs(ahead + behind - 2 * distance) < 1e-9  # the nearest points did not leap
            assert np.allclose(slope[smooth, column], ((ahead - behind) / (2 * step))[smooth], atol=2e-3)
            checked += int(smooth.sum())
    assert checked > 20 * len(distance)


def test_what_overlaps_at_rest_is_left_out() -> None:
    robot = load_robot("op3")
    separation = Separation(robot, 0.02)
    assert separation.depth(robot.neutral()) == separation.depth(np.array(robot.model.qpos0)) == 0.0


def test_of_more_places_than_there_are_rows_those_with_the_least_room_to_the_margin_count() -> None:
    """Legs that may pass closely must not crowd out an arm that may not: it would be led straight into them."""
    draw = np.random.default_rng(0)
    for _ in range(50):
        distance, rest = draw.uniform(0.0, 0.02, 12), draw.choice([0.002, 0.005, np.inf], 12)
        distance[6:], rest[6:] = distance[:6], rest[:6]  # left and right
        distance, rest = distance[(shuffled := draw.permutation(12))], rest[shuffled]
        room = distance - np.minimum(0.01, rest)
        frame = np.repeat([0, 1], [12, 11])  # in the second, one has lost its counterpart
        both = tightest_rows(frame, -np.concatenate([room, room[1:]]), 6)
        kept, odd = both[:12], both[12:]
        assert kept.sum() == 6 and room[kept].max() < room[~kept].min()
        assert odd.sum() <= 6 and room[1:][odd].max() < room[1:][~odd].min()


def test_equal_rows_take_one_place_each_where_there_are_too_many() -> None:
    draw = np.random.default_rng(1)
    frame, distance, slope = np.repeat([0, 1, 2], [30, 4, 30]), draw.uniform(0.0, 0.02, 64), draw.normal(size=(64, 9))
    distance[20:30], slope[20:30] = distance[:10], slope[:10]  # the first frame has 20 different rows
    found = foremost(ClipRows(frame, distance, slope, np.zeros(64, int), np.full(64, 0.002)), 24)
    for k, own in enumerate((np.arange(20), np.arange(30, 34), np.arange(34, 64))):
        expected = np.sort(distance[own])[:24]
        np.testing.assert_array_equal(np.sort(found.values[found.frame == k]), expected)


def test_a_dof_carries_exactly_the_bodies_it_moves() -> None:
    robot = load_robot("op3")
    table, data = carrying(robot.model), mujoco.MjData(robot.model)
    for dof, direction in enumerate(np.eye(robot.model.nv)):
        moved = []
        for pose in (robot.standing(), integrate(robot, robot.standing(), 0.3 * direction)):
            data.qpos[:] = pose
            mujoco.mj_kinematics(robot.model, data)
            moved.append((data.xipos.copy(), data.ximat.copy()))
        differs = (np.abs(moved[0][1] - moved[1][1]).max(1) > 1e-9) | (np.abs(moved[0][0] - moved[1][0]).max(1) > 1e-9)
        assert (differs == table[:, dof]).all()


def test_a_pose_held_back_is_apart_and_on_the_way() -> None:
    graph = describe(read_motion(SAMPLES / "wave.bvh").frames(0, 3), load_robot("op3"))
    robot, crossed = graph.robot, crossed_arms()[1]
    solver = FrameSolver(build_problem(robot, graph.match, graph.tracks))
    assert solver.overlapping(crossed)
    held = solver.backtrack_to_clearance(robot.standing(), FrameSolution(crossed, Status.CONVERGED, 0.0, 1))
    assert held.status is Status.BLOCKED and not solver.overlapping(held.qpos)
    way, whole = (difference(robot, robot.standing(), q) for q in (held.qpos, crossed))
    assert np.linalg.norm(way - (share := way @ whole / (whole @ whole)) * whole) < 1e-9 and 0 <= share < 1
    apart = FrameSolution(robot.standing(), Status.CONVERGED, 0.0, 1)
    assert solver.backtrack_to_clearance(crossed, apart) is apart


@pytest.mark.parametrize("inside", [1, 4])
def test_a_robot_whose_links_were_held_apart_catches_up_within_its_joint_speeds(
    inside: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Arms that go through each other for some frames while the head turns, without a search for a way around."""
    graph = describe(read_motion(SAMPLES / "clap.bvh").frames(0, 40), load_robot("op3"), fps=15)
    robot, crossed = graph.robot, crossed_arms()[1]
    solver = FrameSolver(build_problem(robot, graph.match, graph.tracks))
    way = np.interp(np.arange(len(graph)), [3, 7, 7 + inside, 11 + inside], [0.0, 1.0, 1.0, 0.0])
    start = np.array(
        [integrate(robot, robot.standing(), s * difference(robot, robot.standing(), crossed)) for s in way]
    )
    start[:, robot.qpos_index[robot.joint_names.index("head_pan")]] = np.interp(
        np.arange(len(graph)), [3, 15], [-1.4, 1.4]
    )
    clip = clip_of(solver, targets_of(graph.tracks), Smoothing(steps=0), 15.0)
    monkeypatch.setattr(minimum, "ROUNDS", 0)
    found = ClipMinimum(clip, start)
    given, poses = found.qpos[:, robot.qpos_index].copy(), found.finish(Count(None, 1))
    turned = np.array([pose.qpos for pose in poses])[:, robot.qpos_index]
    assert any(pose.status is Status.BLOCKED for pose in poses) and np.abs(turned - given).max() > 0.1
    assert (np.abs(np.diff(turned, axis=0)) * 15 <= clip.bounds.speed[1:] * (1 + 1e-9)).all()
    assert not solver.costs.overlap(np.array([pose.qpos for pose in poses])).max() > solver.options.overlap
    np.testing.assert_allclose(turned[-1], given[-1], atol=1e-6)


def deepest(separated: bool) -> float:
    robot = load_robot("op3")
    graph = describe(read_motion(SAMPLES / "hips_and_bow.bvh").resample(15), robot)
    qpos = solve_graph(graph if separated else graph.without("separation")).trajectory.qpos
    separation = Separation(robot, 0.0)
    return max(separation.depth(q) for q in qpos)


def test_separation_keeps_links_from_entering_each_other() -> None:
    assert deepest(separated=False) > 0.002
    assert deepest(separated=True) < 0.001


def test_a_step_back_to_where_the_joints_can_be_leads_no_link_into_another() -> None:
    """Each pose of hands on hips is sent to where it may only be as it is a third of a second later."""
    result = retarget(read_motion(SAMPLES / "hips_and_bow.bvh"), load_robot("op3"), fps=30, balance="off")
    graph, robot, qpos = result.graph, result.robot, result.trajectory.qpos
    solver, all_targets = FrameSolver(build_problem(robot, graph.match, graph.tracks)), targets_of(graph.tracks)
    hinges, ahead = robot.qpos_index, 10
    for t in range(0, len(qpos) - ahead, 3):
        box = solver.ranges(all_targets.at(t)).around([(qpos[t + ahead][hinges], np.full(len(hinges), 0.02))])
        after = solver.solve_frame(qpos[t], all_targets.at(t), box=box, iterations=1).qpos
        assert box.outside(after[hinges]) <= box.outside(qpos[t][hinges]) + 1e-9
        assert not solver.overlapping(after)


@needs_shared
def test_coupled_joints_and_closed_chains_hold() -> None:
    robot = load_robot(TODDLER)
    qpos = retarget(read_motion(SAMPLES / "clap.bvh").resample(10), robot, balance="off").trajectory.qpos
    coupling = Coupling(robot)
    assert coupling.present
    assert max(np.abs(coupling(q)[0]).max() for q in qpos) < 1e-4


@needs_shared
def test_a_chain_that_is_nearly_closed_hardly_moves_when_it_is_closed() -> None:
    """A neck on two equal rods may go on along its way at no cost: rounding must not send it there."""
    robot, draw = load_robot(TODDLER), np.random.default_rng(0)
    coupling, neck = Coupling(robot), [k for k, name in enumerate(robot.joint_names) if name.startswith("neck_pitch")]
    for angle in np.linspace(-0.3, 0.6, 60):
        pose = robot.standing()
        pose[robot.qpos_index[neck]] = angle * np.array([1, 1, -1, -1]) + 1e-4 * draw.normal(size=4)
        moved = np.abs(coupling.close_chains(pose) - pose).max()
        assert moved < 3e-3 and np.abs(coupling(coupling.close_chains(pose))[0]).max() < 1e-6


@needs_shared
def test_coupling_slopes_agree_with_central_differences() -> None:
    robot, step = load_robot(TODDLER), 1e-6
    coupling = Coupling(robot)
    pose = integrate(robot, robot.neutral(), 0.1 * np.random.default_rng(0).normal(size=robot.model.nv))
    slope = coupling(pose)[1]
    for column, direction in enumerate(np.eye(robot.model.nv)):
        ahead, behind = (coupling(integrate(robot, pose, s * step * direction))[0] for s in (1, -1))
        assert slope[:, column] == pytest.approx((ahead - behind) / (2 * step), abs=1e-5)


@needs_shared
def test_a_waist_on_a_differential_turns_with_its_motors() -> None:
    """Its model has no equality constraint for that, but tendons with hardly any play."""
    robot = load_robot(TODDLER)
    model, data = robot.model, mujoco.MjData(robot.model)
    pose = robot.standing()
    pose[robot.qpos_index[robot.joint_names.index("waist_yaw")]] = 0.4
    for qpos, gap in ((pose, 0.3), (Coupling(robot).close_chains(pose), 0.0)):
        data.qpos[:] = qpos
        mujoco.mj_fwdPosition(model, data)
        beyond = np.maximum(data.ten_length - model.tendon_range[:, 1], model.tendon_range[:, 0] - data.ten_length)
        assert (beyond.max() > gap) if gap else (beyond.max() <= 0.0)


def test_a_robot_without_equalities_has_no_coupling() -> None:
    coupling, pose = Coupling(load_robot("op3")), load_robot("op3").standing()
    assert not coupling.present and (coupling.close_chains(pose) == pose).all()


def test_measurements_that_others_replace_stay_in_order_at_their_frames_alone() -> None:
    poses, rows = np.zeros((3, 7)), ClipRows.of([None], 6)
    near = NearLinks.measured(poses, rows, 4)
    near.keep(2)
    for angle in (1.0, 2.0, 3.0):
        near.put(np.array([1]), np.full((1, 7), angle), rows)
    kept = np.array([each.qpos[:, 0] for each in near.measurements()])
    assert kept.tolist() == [[0.0, 3.0, 0.0], [0.0, 2.0, 0.0], [0.0, 1.0, 0.0]]


def test_hands_that_clap_touch_and_do_not_pass_through_each_other() -> None:
    robot, motion = load_robot("op3"), read_motion(SAMPLES / "clap.bvh").resample(30)
    result = retarget(motion, robot, balance="off")
    human = result.match.human_positions(motion)
    wrists = np.linalg.norm(human[:, result.match.index("l_hand")] - human[:, result.match.index("r_hand")], axis=1)
    claps = [t for t in range(3, len(wrists) - 3) if wrists[t] == wrists[t - 3 : t + 4].min() and wrists[t] < 0.1]
    apart = hand_distances(robot, result.trajectory.qpos)
    assert len(claps) >= 6 and all(apart[t - 2 : t + 3].min() < 0.01 for t in claps)
    assert apart.min() > -0.001


def hand_distances(robot: Robot, qpos: np.ndarray) -> np.ndarray:
    """(T,) between the surfaces of the two forearms with their hands, by MuJoCo's exact distance [m]."""
    model, data = robot.model, mujoco.MjData(robot.model)
    solid = [g for g in range(model.ngeom) if model.geom_contype[g] or model.geom_conaffinity[g]]
    sides = [[g for g in solid if model.body(model.geom_bodyid[g]).name == f"{s}_el_link"] for s in "lr"]
    found = np.empty(len(qpos))
    for t, q in enumerate(qpos):
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        found[t] = min(mujoco.mj_geomDistance(model, data, a, b, 1.0, None) for a in sides[0] for b in sides[1])
    return found
