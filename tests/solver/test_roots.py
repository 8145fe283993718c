"""What carries a robot does not matter: a free joint, three slides and three hinges, or in the end nothing at all."""

from dataclasses import replace
from functools import cache

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from robot_retarget.base.arrays import Floats
from robot_retarget.base.files import SAMPLES
from robot_retarget.graph.describe import describe
from robot_retarget.human.motion import Motion
from robot_retarget.human.read import read_motion
from robot_retarget.robot import Robot, load_robot
from robot_retarget.robot.dynamics import body_placer, raise_root, root_travel
from robot_retarget.robot.kinematics import body_frames, integrate
from robot_retarget.robot.model import robot_from_model
from robot_retarget.solver.limits import targets_of
from robot_retarget.solver.pipeline import retarget
from robot_retarget.solver.problem import build_problem

AXES = np.eye(3)


@cache
def carried_by(root: str) -> Robot:
    """The OP3 on a free joint, on single joints (slides, then yaw, pitch and roll), or bolted to the world: standing alike,
    with the same servos.
    """
    op3 = load_robot("op3")
    if root == "free":
        return op3
    spec = mujoco.MjSpec.from_file(str(op3.path))
    body = spec.bodies[int(op3.root_body)]
    for joint in list(body.joints):
        spec.delete(joint)
    root_coordinates = {"single": [*(op3.standing()[:3] - body.pos), 0, 0, 0], "none": []}[root]
    for key in list(spec.keys):
        spec.delete(key)
    spec.add_key(name="stand", qpos=[*root_coordinates, *op3.standing()[7:]])
    for kind, axes in (("slide", AXES), ("hinge", AXES[::-1])) if root == "single" else ():
        for k, axis in enumerate(axes):
            body.add_joint(name=f"root_{kind}_{k}", type=getattr(mujoco.mjtJoint, f"mjJNT_{kind.upper()}"), axis=axis)
    made = robot_from_model(spec.compile(), op3.path, root)
    return replace(made, max_speed=op3.max_speed, max_torque=op3.max_torque)  # its servos are known by its name


@pytest.mark.parametrize("root", ["free", "single", "none"])
def test_a_root_travels_along_the_directions_that_move_it_without_a_turn(root: str) -> None:
    robot = carried_by(root)
    count = robot.model.nv - len(robot.dof_index)
    start = robot.neutral()
    moved = np.stack([start, *(integrate(robot, start, 0.1 * step) for step in np.eye(robot.model.nv)[:count])])
    places, turns = (part[:, robot.root_body] for part in body_frames(robot, moved))
    travels = (np.abs(places[1:] - places[0]).max(axis=1) > 1e-3) & (
        np.abs(turns[1:] - turns[0]).max(axis=(1, 2)) < 1e-9
    )
    assert root_travel(robot).tolist() == np.flatnonzero(travels).tolist()
    assert travels.sum() == (0 if root == "none" else 3)


def turning_walk() -> Motion:
    """A walk whose world turns by a third of a turn meanwhile."""
    walk = read_motion(SAMPLES / "walk.bvh").resample(15)
    turns = Rotation.from_rotvec(np.linspace(0, 2, len(walk))[:, None] * AXES[2])
    assert walk.rotations is not None
    count = walk.positions.shape[1]
    placed = np.stack([turns.apply(np.array(walk.positions[:, j])) for j in range(count)], axis=1)
    turned = [turns * Rotation.from_quat(np.array(walk.rotations[:, j]), scalar_first=True) for j in range(count)]
    wxyz = np.stack([turn.as_quat(scalar_first=True) for turn in turned], axis=1)
    return Motion(walk.skeleton, placed, wxyz, walk.fps, walk.source)


def hinges(robot: Robot) -> Floats:
    """The hinges' angles (T, n) [rad]."""
    return retarget(turning_walk(), robot, balance="off").trajectory.qpos[:, robot.qpos_index]


def test_six_single_joints_carry_a_robot_as_a_free_joint_does() -> None:
    free, single = (hinges(carried_by(root)) for root in ("free", "single"))
    apart = np.abs(free - single).max(axis=1)
    assert (
        np.median(apart) < 5e-4 and apart.max() < 5e-3
    )  # the roots' own smoothness costs differ, after any number of passes


@pytest.mark.parametrize("root", ["free", "single", "none"])
def test_slopes_are_those_of_the_cost_whatever_carries_the_robot(root: str) -> None:
    """By central differences, wherever the root is and however it is turned."""
    graph = describe(turning_walk(), carried_by(root))
    problem, targets, robot = (
        build_problem(graph.robot, graph.match, graph.tracks),
        targets_of(graph.tracks).at(30),
        graph.robot,
    )
    for seed in range(3):
        step = np.random.default_rng(seed).normal(scale=0.5, size=robot.model.nv)
        q, gradient = integrate(robot, robot.standing(), step), np.empty(robot.model.nv)
        for column, direction in enumerate(np.eye(robot.model.nv)):
            ahead, behind = (problem.cost(integrate(robot, q, sign * 1e-6 * direction), targets) for sign in (1, -1))
            gradient[column] = (ahead - behind) / 4e-6
        assert np.allclose(problem.model(q, targets)[1], gradient, rtol=1e-5, atol=1e-6 * np.abs(gradient).max())


def test_a_robot_bolted_to_the_world_still_moves_its_limbs() -> None:
    robot = carried_by("none")
    assert not robot.root_joints.size
    assert np.ptp(hinges(robot), axis=0).max() > 0.3


@pytest.mark.parametrize("root", ["free", "single"])
def test_a_robot_is_put_where_it_is_wished_and_raised_straight_up(root: str) -> None:
    robot, body = carried_by(root), carried_by(root).root_body
    turn, place, offset = (
        Rotation.from_euler("zyx", [3.0, 0.5, -0.7]).as_matrix(),
        np.array([1.0, -2.0, 0.4]),
        0.1 * AXES[1],
    )
    there = body_placer(robot, robot.neutral(), body, offset)(place, turn)
    positions, rotations = (frames[0, body] for frames in body_frames(robot, np.array([there])))
    assert np.allclose(rotations, turn, atol=1e-9)
    assert np.allclose(positions + turn @ offset, place, atol=1e-9)
    higher = body_frames(robot, np.array([raise_root(robot, there, 0.3)]))[0][0, body]
    assert np.allclose(higher - positions, [0.0, 0.0, 0.3], atol=1e-9)
