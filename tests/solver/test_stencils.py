"""Costs that join frames: one call gives the terms of all frames, as finite differences of the cost of the whole clip do."""

from dataclasses import dataclass, replace

import casadi as ca
import mujoco
import numpy as np
import pytest

import robot_retarget as rr
from robot_retarget.base.arrays import Floats
from robot_retarget.base.files import SAMPLES
from robot_retarget.graph.describe import RobotGraph
from robot_retarget.graph.kind import Kind, RetargetContext, Track, exact
from robot_retarget.graph.kinds import clip_kinds
from robot_retarget.graph.symbolic_robot import SymbolicRobot
from robot_retarget.robot.kinematics import integrate
from robot_retarget.solver.options import SolveOptions
from robot_retarget.solver.problem import build_problem, targets_of
from robot_retarget.solver.smooth import SmoothSystem, joined_offsets, joined_rows
from robot_retarget.solver.sqp import FrameSolver

FRAMES, FPS = 7, 30.0


@dataclass(frozen=True)
class Swing(Kind):
    """The centre of mass of a frame over the hand of others, at most a value that varies over time."""

    name: str = "swing"
    stencil: tuple[int, ...] = (-1, 0, 1)

    def targets(self, context: RetargetContext) -> Track:
        draw = np.random.default_rng(3)
        shape = len(context.human), 2
        track = exact(self, [("mass", "r_hand")] * 2, draw.normal(scale=0.05, size=shape), 1.0, 0.5, axes=("x", "z"))
        return replace(track, lower=np.full(shape, -np.inf), priority=draw.uniform(0, 2, shape))

    def measure(self, track: Track, body: SymbolicRobot) -> ca.SX:
        value = body.mass()
        for place, offset in enumerate(self.stencil):
            value -= (0.3 + place) * body.at(offset).keypoint("r_hand")
        return ca.vertcat(value[0], value[2])


def measured(graph: RobotGraph, stencil: tuple[int, ...], qpos: Floats) -> Floats:
    """(T, 2) by MuJoCo; frames outside the clip repeat its ends."""
    robot, data = graph.robot, mujoco.MjData(graph.robot.model)
    site = graph.match.anatomy.sites["r_hand"]
    mass, hand = np.empty((len(qpos), 3)), np.empty((len(qpos), 3))
    for t, q in enumerate(qpos):
        data.qpos[:] = q
        mujoco.mj_kinematics(robot.model, data)
        mujoco.mj_comPos(robot.model, data)
        mass[t] = data.subtree_com[robot.root_body]
        hand[t] = data.xpos[site.body] + data.xmat[site.body].reshape(3, 3) @ site.offset
    at = [np.clip(np.arange(len(qpos)) + offset, 0, len(qpos) - 1) for offset in stencil]
    return (mass - sum((0.3 + place) * hand[own] for place, own in enumerate(at)))[:, [0, 2]]


@pytest.fixture(scope="module", params=[(-1, 0), (-1, 0, 1), (-2, -1, 0)], ids=str)
def solver(request: pytest.FixtureRequest) -> tuple[FrameSolver, RobotGraph, Floats]:
    kinds = (*clip_kinds(), Swing(stencil=request.param))
    motion = rr.read_motion(SAMPLES / "wave.bvh").frames(12, 12 + FRAMES)
    graph = rr.describe(motion, rr.load_robot("op3"), kinds=kinds)
    problem = build_problem(graph.robot, graph.match, graph.tracks)
    draw = np.random.default_rng(0)
    away = draw.normal(scale=0.1, size=(FRAMES, graph.robot.model.nv))
    qpos = integrate(graph.robot, np.repeat(graph.robot.standing()[None], FRAMES, axis=0), away)
    return FrameSolver(problem, SolveOptions()), graph, qpos


def test_the_measures_of_all_frames_are_those_of_mujoco(solver: tuple[FrameSolver, RobotGraph, Floats]) -> None:
    frames, graph, qpos = solver
    (cost,) = frames.problem.stencils
    assert np.allclose(cost.values(qpos), measured(graph, cost.track.stencil, qpos), atol=1e-9)


def test_the_terms_of_all_frames_are_finite_differences_of_the_cost(
    solver: tuple[FrameSolver, RobotGraph, Floats],
) -> None:
    frames, graph, qpos = solver
    (cost,) = frames.problem.stencils
    every = np.arange(FRAMES)
    around = frames.neighbours(qpos, targets_of(graph.tracks), every, 1 / FPS)
    assert around is not None
    found, gradient, normal = cost.terms(qpos, around)
    track, nv, step = graph.kinds["swing"], graph.robot.model.nv, 1e-6

    def stress(poses: Floats) -> Floats:
        value = measured(graph, track.stencil, poses)
        return (track.present * track.priority * (np.maximum(value - track.upper, 0) / 0.5) ** 2).sum(axis=1)

    for t in every:
        joined = [t - offset for offset in track.stencil if 0 <= t - offset < FRAMES]
        assert found[t] == pytest.approx(stress(qpos)[joined].sum())
        slope = np.empty(nv)
        for dof in range(nv):
            moved = [qpos.copy(), qpos.copy()]
            for poses, way in zip(moved, (step, -step), strict=True):
                poses[t] = integrate(graph.robot, qpos[t], way * np.eye(nv)[dof])
            slope[dof] = (stress(moved[0]).sum() - stress(moved[1]).sum()) / (2 * step)
        assert np.allclose(2 * gradient[t], slope, atol=1e-5 * max(1.0, np.abs(slope).max()))
    assert found.min() >= 0 < found.max() and np.linalg.eigvalsh(normal).min() > -1e-9


def test_one_frame_has_the_terms_that_it_has_among_all(solver: tuple[FrameSolver, RobotGraph, Floats]) -> None:
    frames, graph, qpos = solver
    (cost,) = frames.problem.stencils
    around = frames.neighbours(qpos, targets_of(graph.tracks), np.arange(FRAMES), 1 / FPS)
    assert around is not None
    together = cost.terms(qpos, around)
    for t in range(FRAMES):
        for whole, own in zip(together, cost.terms(qpos[[t]], around.at(t)), strict=True):
            assert np.allclose(whole[t], own[0], rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("fixed", [0, 2])
def test_a_path_moves_to_the_minimum_of_smoothness_and_joining_costs(
    solver: tuple[FrameSolver, RobotGraph, Floats], fixed: int
) -> None:
    """The oracle solves the dense system, with slopes by finite differences of MuJoCo's measures."""
    frames, graph, path = solver
    (cost,), track, nv = frames.problem.stencils, graph.kinds["swing"], graph.robot.model.nv
    draw = np.random.default_rng(5)
    rho, kappa = draw.uniform(0.01, 0.03, nv), np.repeat(draw.uniform(0.001, 0.05, (1, nv)), FRAMES, axis=0)
    found = joined_offsets(
        [joined_rows(cost, path, targets_of(graph.tracks), 1 / FPS)],
        SmoothSystem(kappa / rho, fixed),
        rho,
        (FRAMES, nv),
    )

    def values(offset: Floats) -> Floats:
        return measured(graph, track.stencil, integrate(graph.robot, path, offset.reshape(FRAMES, nv))).ravel()

    steps = 1e-6 * np.eye(FRAMES * nv)
    slope = np.stack([(values(step) - values(-step)) / 2e-6 for step in steps], axis=1)
    excess = np.maximum(values(np.zeros(FRAMES * nv)) - track.upper.ravel(), 0)
    weight = (track.present * track.priority / 0.5**2).ravel() * (excess > 0)
    bend = np.kron(np.diff(np.eye(FRAMES), 2, axis=0), np.eye(nv))
    base = np.diag(np.tile(rho, FRAMES)) + bend.T @ np.diag(np.tile(kappa[0], FRAMES - 2)) @ bend
    hessian, force = base + slope.T @ (weight[:, None] * slope), -slope.T @ (weight * excess)
    free = slice(fixed * nv, None)
    wanted: Floats = np.asarray(np.linalg.solve(hessian[free, free], force[free]), dtype=np.float64)

    def gain(offset: Floats) -> float:
        return float(force[free] @ offset - offset @ hessian[free, free] @ offset / 2)

    assert (found[:fixed] == 0).all() and gain(wanted) > 0
    assert gain(found.ravel()[free]) > 0.999 * gain(wanted)
