"""Links that stand between a pose and another one are gone around."""

import mujoco
import numpy as np
import pytest

from robot_retarget.arrays import Floats
from robot_retarget.motion import read_motion
from robot_retarget.retarget.clip import Smoothing
from robot_retarget.retarget.detour import clear, detour
from robot_retarget.retarget.edges import build_edges
from robot_retarget.retarget.frame import FrameSolver, Options
from robot_retarget.retarget.match import match
from robot_retarget.retarget.problem import build_problem
from robot_retarget.retarget.solve import solve
from robot_retarget.robot import Robot, load_robot
from robot_retarget.shipped import SAMPLES


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


def test_a_stream_that_began_with_its_hands_behind_the_hips_comes_to_cost_what_another_does(
    solver: FrameSolver,
) -> None:
    motion = read_motion(SAMPLES / "hips_and_bow.bvh").resample(30)
    edges = build_edges(motion, solver.problem.match)
    whole = solve(solver.problem, edges, 30.0, smoothing=Smoothing(passes=0))
    part = solve(solver.problem, edges.window(slice(40, 140)), 30.0, smoothing=Smoothing(passes=0))
    assert part.cost[45:56].min() > 1.2 * whole.cost[85:96].max()  # it stays behind until the other way is found ...
    assert (part.cost[70:] < 1.05 * whole.cost[110:140]).all()  # ... and gets there in half a second
