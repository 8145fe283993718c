"""Links that stand between a pose and another one are gone around."""

from itertools import permutations

import mujoco
import numpy as np
import pytest
from shared_files import SHARED, needs_shared

from robot_retarget.arrays import Floats
from robot_retarget.describe.edges import build_edges
from robot_retarget.describe.match import match
from robot_retarget.motion import read_motion
from robot_retarget.robot import Robot, load_robot
from robot_retarget.shipped import SAMPLES
from robot_retarget.solve.crossing import Crossing
from robot_retarget.solve.detour import clear, detour
from robot_retarget.solve.footing import held_corners
from robot_retarget.solve.frame import FrameSolver, Options
from robot_retarget.solve.problem import build_problem, frame_parameters
from robot_retarget.solve.starts import place_root, ways


@pytest.fixture(scope="module")
def solver() -> FrameSolver:
    motion, robot = read_motion(SAMPLES / "hips_and_bow.bvh").resample(30), load_robot("op3")
    matched = match(motion, robot)
    return FrameSolver(build_problem(robot, matched, build_edges(motion, matched)), Options())


def on_hips(robot: Robot, forward: float) -> Floats:
    """Both hands at the hips, before them or behind, by the pitch of the shoulders [rad]."""
    pose = robot.standing()
    angles = {"sho_pitch": (forward, -forward), "sho_roll": (0.85, -0.85), "el": (-1.57, 1.57)}
    for joint, sides in angles.items():
        for side, angle in zip("lr", sides, strict=True):
            pose[robot.qpos_index[robot.joint_names.index(f"{side}_{joint}")]] = angle
    return pose


def deepest(robot: Robot, start: Floats, end: Floats) -> float:
    """How far robot links enter each other on the straight way, by MuJoCo's contacts in a hundred places [m]."""
    data, hinges, depth = mujoco.MjData(robot.model), robot.qpos_index, 0.0
    for share in np.linspace(0, 1, 100):
        data.qpos[:] = start
        data.qpos[hinges] += share * (end - start)[hinges]
        mujoco.mj_forward(robot.model, data)
        links = (robot.model.geom_bodyid[data.contact.geom] > 0).all(axis=1)
        depth = max(depth, float(-data.contact.dist[links].min(initial=0.0)))
    return depth


def test_hands_come_from_behind_the_hips_to_before_them_without_going_through(solver: FrameSolver) -> None:
    behind, before = on_hips(solver.robot, -0.3), on_hips(solver.robot, 0.6)
    assert not clear(solver, behind, before) and deepest(solver.robot, behind, before) > 0.01
    via = detour(solver, behind, before)
    assert via is not None
    assert max(deepest(solver.robot, behind, via), deepest(solver.robot, via, before)) < 0.002


def test_where_nothing_stands_between_nothing_is_gone_around(solver: FrameSolver) -> None:
    robot = solver.robot
    assert detour(solver, robot.standing(), on_hips(robot, 0.6)) is None
    assert detour(solver, on_hips(robot, 0.6), on_hips(robot, 0.6)) is None


def test_a_robot_with_its_hands_behind_the_hips_comes_to_where_a_pose_costs_least(solver: FrameSolver) -> None:
    """What is wished stays the same meanwhile: hands that leave the hips forward."""
    problem, robot, frame = solver.problem, solver.robot, 90
    edges = build_edges(read_motion(SAMPLES / "hips_and_bow.bvh").resample(30), problem.match)
    held = held_corners(edges.stances, problem.feet, len(edges))[frame]
    wished = (*frame_parameters(edges, frame), *solver.grip.lay_down(held))
    best = ways(solver, wished, edges, frame)[0]
    behind = place_root(problem, on_hips(robot, -0.3), edges.root[frame], edges.facing[frame])
    poses, crossing = [solver.descend(behind, wished)], Crossing(solver, 30.0)
    assert crossing.lookout.better(best, wished) is None  # so it knows what a good pose costs
    assert poses[0].cost > 1.5 * best.cost
    for _ in range(45):
        box = solver.ranges.around([poses[-1].qpos[robot.qpos_index]], robot.max_speed / 30)
        pose = solver.descend(poses[-1].qpos, wished, pull=crossing.pull(wished), box=box)
        poses.append(solver.held_back(poses[-1].qpos, pose, wished))
        crossing.look(poses[-1], wished)
    assert np.ptp([pose.cost for pose in poses[:10]]) < 0.01  # it stays behind until the other way is found ...
    assert max(pose.cost for pose in poses[35:]) < 1.02 * best.cost  # ... and gets there in half a second
    assert not any(solver.overlapping(pose.qpos) for pose in poses)


def test_what_it_does_not_come_to_within_two_seconds_is_left(solver: FrameSolver) -> None:
    robot, edges = (
        solver.robot,
        build_edges(read_motion(SAMPLES / "hips_and_bow.bvh").resample(30), solver.problem.match),
    )
    wished = (*frame_parameters(edges, 0), *solver.grip.lay_down(np.zeros((2, 4), dtype=bool)))
    best, crossing = ways(solver, wished, edges, 0)[0], Crossing(solver, 30.0)
    crossing.aim, crossing.via, crossing.left = best, on_hips(robot, 3.0) + 10.0, 60
    for _ in range(59):
        crossing.look(best, wished)
        assert crossing.aim is not None
    crossing.look(best, wished)
    assert crossing.aim is None and crossing.via is None


@needs_shared
def test_stops_of_a_robot_with_closed_chains_can_be_come_to() -> None:
    """Its hands lie on its hips in several ways, with its hips between."""
    robot = load_robot(str(SHARED / "robots/toddlerbot_2xc/toddlerbot_2xc.xml"))
    motion, frame = read_motion(SAMPLES / "hips_and_bow.bvh").resample(30), 55
    matched = match(motion, robot)
    edges = build_edges(motion, matched)
    solver = FrameSolver(build_problem(robot, matched, edges), Options())
    held = held_corners(edges.stances, solver.problem.feet, len(edges))[frame]
    wished = (*frame_parameters(edges, frame), *solver.grip.lay_down(held))
    ends = [solver.descend(end.qpos, wished) for end in ways(solver, wished, edges, frame)]
    stops = [(a, b, detour(solver, a.qpos, b.qpos)) for a, b in permutations(ends, 2) if b.cost < a.cost]
    stops = [(a, b, via) for a, b, via in stops if via is not None]
    assert len(stops) > 2
    for begun, aim, via in stops:
        crossing, pose, frames = Crossing(solver, 30.0), begun, 0
        crossing.aim, crossing.via, crossing.left = aim, via, crossing.patience
        while crossing.aim is not None:
            box, last, frames = solver.reachable([pose.qpos], 1 / 30), pose.qpos, frames + 1
            pose = solver.held_back(last, solver.descend(last, wished, pull=crossing.pull(wished), box=box), wished)
            crossing.look(pose, wished)
        assert frames < 30 and pose.cost < 1.02 * aim.cost  # it is there long before it would give up
