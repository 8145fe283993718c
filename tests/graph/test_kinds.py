"""Every kind measures the quantity of its docstring, checked by MuJoCo and NumPy; a new kind is one small class."""

from dataclasses import replace
from functools import cache
from typing import Any

import casadi as ca
import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robot_retarget.base.arrays import Floats
from robot_retarget.base.files import SAMPLES
from robot_retarget.graph.describe import RobotGraph, describe
from robot_retarget.graph.kind import Kind, RetargetContext
from robot_retarget.graph.kinds import KINDS, stream_kinds
from robot_retarget.graph.kinds.joints import BOUNCE, SmoothnessKind
from robot_retarget.graph.kinds.pose import MassKind
from robot_retarget.graph.symbolic_robot import SymbolicRobot, drawn_configurations
from robot_retarget.graph.track import Track, exact, frame_costs
from robot_retarget.human.read import read_motion
from robot_retarget.robot import Robot, load_robot, world_points
from robot_retarget.robot.support import sole_corners
from robot_retarget.solver.options import Smoothing
from robot_retarget.solver.problem import Problem, build_problem
from robot_retarget.solver.solve import solve_graph

HAND, HEAD = ("l_el_link", np.array([0.02, 0.1, 0.0])), np.array([0.3, -0.1, 0.2])
"""A point on a forearm and a place in the world [m]."""


class Toy(Kind):
    """A kind of one edge: the left hand is as high over the floor as the head."""

    name = "toy"

    def targets(self, context: RetargetContext) -> Track | None:
        return exact(self, [("l_hand", "head")], np.zeros((len(context.human), 1)), 1e3, context.leg, axes=("z",))

    def measure(self, track: Track, body: SymbolicRobot) -> ca.SX:
        return body.keypoint("l_hand")[2] - body.keypoint("head")[2]


@cache
def made() -> tuple[RobotGraph, Problem]:
    graph = describe(read_motion(SAMPLES / "wave.bvh").frames(0, 12), load_robot("op3"), kinds=(*KINDS, Toy()))
    graph = graph.with_edge("l_hand", "r_knee", 0.1).with_edge(HAND, HEAD, (0.1, 0.2))
    mass = MassKind().track(np.zeros((len(graph), 2)), graph.match.robot_leg)
    return graph, build_problem(graph.robot, graph.match, (*graph.tracks, mass))


def measured(kind: str, q: Floats) -> Floats:
    """(E,) by the compiled functions."""
    graph, problem = made()
    names = [*(track.name for track in graph.costs for _ in track.ends), "mass", "mass"]
    return problem.values(q)[np.array(names) == kind]


def keypoints(graph: RobotGraph, q: Floats) -> dict[str, Floats]:
    """By MuJoCo; the pelvis is the middle of the hips."""
    names = graph.match.keypoints
    found = dict(zip(names, world_points(graph.robot, graph.match.points, q[None])[0], strict=True))
    return found | {"pelvis": (found["l_hip"] + found["r_hip"]) / 2}


def mujoco_data(robot: Robot, q: Floats) -> mujoco.MjData:
    data = mujoco.MjData(robot.model)
    data.qpos[:] = q
    mujoco.mj_kinematics(robot.model, data)
    mujoco.mj_comPos(robot.model, data)
    return data


def expected(kind: str, graph: RobotGraph, q: Floats) -> Floats:
    """(E,) what the edges of a kind should measure, edge by edge from its names."""
    robot, x, data = graph.robot, keypoints(graph, q), mujoco_data(graph.robot, q)
    if kind == "mass":
        return data.subtree_com[robot.root_body][:2]
    track = graph.kinds[kind]
    found: list[Any] = []
    for e, (a, b) in enumerate(track.ends):
        axis = "xyz".index(track.axes[e]) if track.axes else 0
        if kind in ("posture", "touch"):
            found.append(np.linalg.norm(x[a] - x[b]))
        elif kind == "compass":
            found.append((x[a] - x[b])[axis] / np.linalg.norm(x[a] - x[b]))
        elif kind == "orientation":
            body, axes = graph.match.anatomy.frames[a]
            found.append((data.xmat[body].reshape(3, 3) @ axes[:, {"forward": 0, "up": 2}[b]])[axis])
        elif kind == "path":
            found.append(x["pelvis"][axis])
        elif kind == "rest":
            found.append(q[robot.model.jnt_qposadr[mujoco.mj_name2id(robot.model, mujoco.mjtObj.mjOBJ_JOINT, a)]])
        elif kind == "foothold":
            foot, corner = a.split(" sole ")
            corners = world_points(robot, sole_corners(graph.match.anatomy, foot), q[None])[0]
            places = ("front left", "front right", "rear left", "rear right")
            found.append(corners[places.index(corner)][axis])
        elif kind == "toy":
            found.append(x["l_hand"][2] - x["head"][2])
        elif kind == "own":
            body = robot.model.body(HAND[0]).id
            place = data.xpos[body] + data.xmat[body].reshape(3, 3) @ HAND[1]
            found = [np.linalg.norm(x["l_hand"] - x["r_knee"]), np.linalg.norm(place - HEAD)]
    return np.array(found, dtype=float)


@pytest.mark.parametrize("kind", [*(track.name for track in frame_costs(made()[0].tracks)), "mass"])
def test_every_kind_measures_what_plain_arithmetic_finds(kind: str) -> None:
    graph, _ = made()
    for q in drawn_configurations(graph.robot, 5):
        wanted = expected(kind, graph, q)
        assert wanted.size and np.allclose(measured(kind, q), wanted, atol=1e-9)


@settings(max_examples=20)
@given(st.integers(0, 2**32 - 1))
def test_directions_that_are_measured_or_wished_are_unit_vectors(seed: int) -> None:
    graph, _ = made()
    q = graph.robot.standing()
    q[graph.robot.qpos_index] = np.random.default_rng(seed).uniform(graph.robot.lower, graph.robot.upper)
    for kind in ("compass", "orientation"):
        track = graph.kinds[kind]
        for vectors in (measured(kind, q), track.lower, track.upper):
            assert np.allclose(np.linalg.norm(vectors.reshape(-1, 3), axis=1), 1.0, atol=1e-9)
        assert track.axes == ("x", "y", "z") * (len(track) // 3) and track.exact


def tree_path(graph: RobotGraph, bones: Floats, a: int, b: int) -> float:
    """The sum of the bones between two keypoints, by their ancestors."""
    parents = graph.match.parents

    def up(k: int) -> list[int]:
        return [k] if parents[k] < 0 else [k, *up(int(parents[k]))]

    return float(sum(bones[k] for k in set(up(a)) ^ set(up(b))))


def test_postures_are_wished_over_the_length_of_the_path_between() -> None:
    """δ = τ_B ‖x‖/τ_A with τ the bones between, on either body; so are touches."""
    graph, _ = made()
    human, match = graph.human.positions, graph.match
    for kind in ("posture", "touch"):
        track = graph.kinds[kind]
        for e, ends in enumerate(track.ends):
            a, b = (match.index(end) for end in ends)
            theirs, ours = (tree_path(graph, bones, a, b) for bones in (match.human_bones, match.robot_bones))
            delta = ours * np.linalg.norm(human[:, a] - human[:, b], axis=1) / theirs
            assert np.allclose(track.lower[:, e], delta) and np.array_equal(track.lower[:, e], track.upper[:, e])
            assert track.scale[e] == pytest.approx(ours)


def test_a_kind_of_one_small_class_is_shown_weighed_and_solved_with() -> None:
    motion, robot = read_motion(SAMPLES / "wave.bvh").frames(0, 12), load_robot("op3")
    plain, toy = (describe(motion, robot, kinds=kinds) for kinds in (KINDS, (*KINDS, Toy())))
    assert "1 toy" in repr(toy) and list(toy.between("l_hand", "head")) == ["posture", "touch", "toy"]
    levels = []
    for graph in (plain, toy.with_priority("toy", 0.1), toy):
        x = [keypoints(graph, q) for q in solve_graph(graph, smoothing=Smoothing(steps=4)).trajectory.qpos]
        levels.append(max(abs(at["l_hand"][2] - at["head"][2]) for at in x))
    assert levels[0] > 0.1 and levels[0] > levels[1] > levels[2] and levels[2] < 0.01


@pytest.mark.parametrize(("kind", "order"), [("smoothness", 2), ("jerk", 3)])
def test_a_smooth_motion_costs_as_much_a_frame_at_every_rate(kind: str, order: int) -> None:
    """A frame costs κ (Δᵏx / scale)², and Δᵏx of a smooth motion is its k-th derivative over fpsᵏ."""
    motion, robot, costs = read_motion(SAMPLES / "wave.bvh").frames(0, 20), load_robot("op3"), []
    for fps in (15.0, 30.0, 60.0):
        track = describe(motion, robot, fps=fps).kinds[kind]
        costs.append(track.priority.max(axis=0) / (track.scale * fps**order) ** 2)
    np.testing.assert_allclose(costs, np.tile(costs[1], (3, 1)), rtol=1e-9)


@pytest.mark.parametrize("kind", ["smoothness", "jerk"])
def test_squares_of_the_root_count_by_their_weights_beside_those_of_hinges(kind: str) -> None:
    graph = describe(read_motion(SAMPLES / "wave.bvh").frames(0, 3), load_robot("op3"))
    track, weights = graph.kinds[kind], graph.weights
    counted = dict(zip([end for end, _ in track.ends], track.scale**-2.0, strict=True))
    turn = weights.smooth_turn if kind == "smoothness" else 1.0
    root = {f"root {k}": weights.smooth_root if k < 3 else turn for k in range(6)}
    assert counted == pytest.approx(dict.fromkeys(graph.robot.joint_names, 1.0) | root)


def test_kinds_that_the_bodies_do_not_have_are_left_out() -> None:
    graph = describe(read_motion(SAMPLES / "wave.bvh").frames(0, 6), load_robot("op3"), kinds=(KINDS[0], MassKind()))
    assert [track.name for track in graph.tracks] == ["posture"]


def test_the_height_of_the_root_bends_as_the_scaled_path_does() -> None:
    graph, _ = made()
    fps, frames = 100.0, 60
    time = np.arange(frames)[:, None, None] / fps
    fall = [0.3, 0.0, 0.0] * time + [0.0, 0.0, -9.81 / 2] * time**2
    human = replace(graph.human, positions=graph.human.positions[:1] + fall, fps=fps, falls=None)
    track = SmoothnessKind().targets(RetargetContext(human, graph.match, graph.robot, graph.weights))
    up = [end for end, _ in track.ends].index("root 2")
    far = slice(round(5 * BOUNCE * fps), -round(5 * BOUNCE * fps))
    assert np.allclose(track.lower[far, up] * fps**2, -9.81 * graph.match.leg_ratio)
    assert not np.delete(track.lower, up, axis=1).any()


def test_hinges_that_turn_an_ankle_in_the_pelvis_have_the_inertia_of_legs() -> None:
    robot = load_robot("op3")
    graph = describe(read_motion(SAMPLES / "walk.bvh"), robot, fps=30, kinds=stream_kinds())
    track, sites, data = graph.kinds["inertia"], graph.match.anatomy.sites, mujoco.MjData(robot.model)

    def ankles(q: Floats) -> Floats:
        data.qpos[:] = q
        mujoco.mj_kinematics(robot.model, data)
        pelvis, *feet = (data.xmat[sites[part].body].reshape(3, 3) for part in ("pelvis", "l_ankle", "r_ankle"))
        return np.array([pelvis.T @ foot for foot in feet])

    weights, ends = graph.weights, [end for end, _ in track.ends]
    for joint, index in zip(robot.joint_names, robot.qpos_index, strict=True):
        q = robot.standing()
        before, q[index] = ankles(q), q[index] + 0.3
        moves = np.abs(ankles(q) - before).max() > 1e-6
        assert track.priority[0, ends.index(joint)] == (weights.inertia_leg if moves else weights.inertia), joint
    assert (track.priority[0, [end.startswith("root") for end in ends]] == 1).all()
