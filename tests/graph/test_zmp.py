"""The zero moment point as a kind: MuJoCo's inverse dynamics say where it is, and a sampled sole how far it is outside."""

import copy
from dataclasses import replace
from functools import cache

import mujoco
import numpy as np
import pytest

import robot_retarget as rr
from robot_retarget.base.arrays import Floats
from robot_retarget.base.files import SAMPLES
from robot_retarget.graph.describe import RobotGraph
from robot_retarget.graph.kind import RetargetContext
from robot_retarget.graph.kinds.zmp import ZmpKind
from robot_retarget.graph.track import Track
from robot_retarget.graph.weights import Weights
from robot_retarget.robot.kinematics import world_points
from robot_retarget.robot.support import sole_corners
from robot_retarget.solver.solve import solve_graph
from robot_retarget.solver.stencils import StencilCost

RATE = 1000.0
"""Frames per second of the motions that are compared with derivatives [1/s]."""


@cache
def graph() -> RobotGraph:
    motion = rr.read_motion(SAMPLES / "wave.bvh").frames(12, 42)
    return rr.describe(motion, rr.load_robot("op3"), weights=Weights(zmp=1.0))


def fast(track: Track) -> Track:
    """The same edges at another frame rate."""
    return replace(track, kind=ZmpKind(rate=RATE))


def swaying(phase: float) -> Floats:
    """(3, nq) three frames of a robot whose joints and root sway."""
    robot = graph().robot
    qpos, draw = np.repeat(robot.standing()[None], 3, axis=0), np.random.default_rng(round(100 * phase))
    size, beat = draw.uniform(-0.15, 0.15, robot.model.nv), draw.uniform(1, 5, robot.model.nv)
    for t in range(3):
        way = size * np.sin(beat * (phase + t / RATE))
        mujoco.mj_integratePos(robot.model, qpos[t], way, 1.0)
    return qpos


def zero_moment_point(qpos: Floats) -> Floats:
    """(2,) on the floor, by inverse dynamics of point masses at the middle of three frames [m]."""
    robot = graph().robot
    model = copy.copy(robot.model)
    model.body_inertia[:] = 0.0
    model.dof_armature[:], model.dof_damping[:], model.dof_frictionloss[:] = 0.0, 0.0, 0.0
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    data, ways = mujoco.MjData(model), np.zeros((2, model.nv))
    mujoco.mj_differentiatePos(model, ways[0], 1 / RATE, qpos[0], qpos[1])
    mujoco.mj_differentiatePos(model, ways[1], 1 / RATE, qpos[1], qpos[2])
    data.qpos[:], data.qvel[:], data.qacc[:] = qpos[1], ways.mean(axis=0), (ways[1] - ways[0]) * RATE
    mujoco.mj_inverse(model, data)
    force = data.qfrc_inverse[:3]
    turn = data.xmat[robot.root_body].reshape(3, 3)
    moment = turn @ data.qfrc_inverse[3:6] + np.cross(data.qpos[:3], force)
    return np.array([-moment[1], moment[0]]) / force[2]


def soles(qpos: Floats) -> dict[str, Floats]:
    """(4, 2) corners of each sole [m]."""
    robot, anatomy = graph().robot, graph().match.anatomy
    return {foot: world_points(robot, sole_corners(anatomy, foot), qpos[1:2])[0, :, :2] for foot in ("l", "r")}


def outside(point: Floats, corners: Floats, ahead: Floats) -> float:
    """The distance of a point from the box around corners along a direction, by the nearest of many points of it [m]."""
    axes = np.array([ahead, [-ahead[1], ahead[0]]]) / np.linalg.norm(ahead)
    along = corners @ axes.T
    grid = [np.linspace(low, high, 400) for low, high in zip(along.min(axis=0), along.max(axis=0), strict=True)]
    x, y = np.meshgrid(*grid)
    own = axes @ point
    return float(np.sqrt(((x - own[0]) ** 2 + (y - own[1]) ** 2).min()))


def beyond(qpos: Floats) -> dict[str, Floats]:
    """(2,) of every set of soles, by the kind [m]."""
    track = fast(graph().kinds["zmp"])
    values = StencilCost(graph().robot, graph().match, track, slice(0, len(track))).values(qpos)[1]
    return {track.ends[k][1]: values[k : k + 2] for k in range(0, len(track), 2)}


@pytest.mark.parametrize("phase", [0.1, 0.5, 1.3, 2.2, 3.1])
def test_the_edges_measure_how_far_the_point_is_out_of_the_soles(phase: float) -> None:
    qpos = swaying(phase)
    found, point, corners = beyond(qpos), zero_moment_point(qpos), soles(qpos)
    left, right = corners["l"], corners["r"]
    boxes = {f"{foot} sole": (own, own[:2].sum(axis=0) - own[2:].sum(axis=0)) for foot, own in corners.items()}
    boxes["l and r sole"] = np.concatenate([left, right]), right.sum(axis=0) - left.sum(axis=0)
    assert set(found) == set(boxes)
    for name, box in boxes.items():
        assert np.linalg.norm(np.maximum(found[name], 0)) == pytest.approx(outside(point, *box), abs=1e-3)


def test_edges_are_of_the_soles_that_stand() -> None:
    track, contacts = graph().kinds["zmp"], graph().human.contacts
    stands = {foot: own.any(axis=1) for foot, own in contacts.items()}
    for k, (_, name) in enumerate(track.ends):
        feet = name.removesuffix(" sole").split(" and ")
        here = np.logical_and.reduce([stands[foot] == (foot in feet) for foot in stands])
        assert ((track.priority[:, k] > 0) == here).all()


def test_a_held_robot_and_the_weight_0_have_no_edges() -> None:
    bolted = replace(graph().robot, root_joints=np.zeros(0, dtype=np.int64))
    context = RetargetContext(graph().human, graph().match, graph().robot, Weights(zmp=1.0))
    assert ZmpKind().targets(context) is not None
    assert ZmpKind().targets(replace(context, robot=bolted)) is None
    assert ZmpKind().targets(replace(context, weights=Weights(zmp=0.0))) is None


def test_the_kind_lowers_what_it_costs() -> None:
    walk = rr.describe(rr.read_motion(SAMPLES / "walk.bvh").frames(20, 70), graph().robot, weights=Weights(zmp=1.0))
    plain, track = solve_graph(walk.without("zmp")).trajectory.qpos, walk.kinds["zmp"]
    cost = StencilCost(walk.robot, walk.match, track, slice(0, len(track)))
    before = track.stress(cost.values(plain)).sum()
    assert solve_graph(walk).stress["zmp"].sum() < 0.5 * before
