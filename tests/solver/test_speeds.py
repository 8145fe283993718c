"""Joint speeds: a path slowed down keeps them and is as near as it can be; whole clips keep them, whatever leaps."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import linprog

from robot_retarget.base.files import SAMPLES
from robot_retarget.graph.describe import describe
from robot_retarget.human.read import read_motion
from robot_retarget.robot import load_robot
from robot_retarget.solver.clip_model import clip_of
from robot_retarget.solver.limits import targets_of, within_speeds
from robot_retarget.solver.options import Smoothing
from robot_retarget.solver.pipeline import retarget
from robot_retarget.solver.solve import problem_of
from robot_retarget.solver.sqp import FrameSolver


def rough(draw: np.random.Generator, frames: int) -> np.ndarray:
    return np.cumsum(draw.normal(size=(frames, 2)) * draw.choice([0.1, 2.0], size=(frames, 1)), axis=0)


@given(st.integers(1, 30), st.integers(0, 5), st.integers(0, 999))
def test_a_path_slowed_down_keeps_speeds_and_what_kept_them(frames: int, fixed: int, seed: int) -> None:
    draw = np.random.default_rng(seed)
    angles, reach = rough(draw, frames), draw.uniform(0.1, 1.0, 2)
    fixed = min(fixed, frames)
    path = within_speeds(angles, reach, fixed)
    assert (np.abs(np.diff(path[max(fixed - 1, 0) :], axis=0)) <= reach + 1e-12).all()
    assert (path[:fixed] == angles[:fixed]).all()
    slow = within_speeds(angles, reach)
    assert np.allclose(within_speeds(slow, reach, fixed), slow)


@pytest.mark.parametrize("seed", range(5))
def test_no_path_that_keeps_speeds_is_nearer(seed: int) -> None:
    draw = np.random.default_rng(seed)
    angles, reach = rough(draw, 12)[:, 0], 0.4
    step = np.diff(np.eye(12), axis=0)
    away = np.ones((12, 1))
    rows = np.block([[np.eye(12), -away], [-np.eye(12), -away], [step, 0 * away[1:]], [-step, 0 * away[1:]]])
    most = np.concatenate([angles, -angles, np.full(22, reach)])
    least = linprog([0.0] * 12 + [1.0], A_ub=rows, b_ub=most, bounds=[(None, None)] * 13).fun
    path = within_speeds(angles[:, None], np.array([reach]))[:, 0]
    assert np.abs(path - angles).max() == pytest.approx(least, abs=1e-9)


def test_the_speed_between_two_frames_is_that_of_the_later_one() -> None:
    graph = describe(read_motion(SAMPLES / "wave.bvh").frames(0, 5), load_robot("op3")).unbalanced()
    robot, solver, draw = graph.robot, FrameSolver(problem_of(graph)), np.random.default_rng(0)
    speed = draw.uniform(1.0, 9.0, (5, len(robot.joint_names)))
    clip = replace(clip_of(solver, targets_of(graph.tracks), Smoothing(), 30.0), reach=speed / 30)
    qpos = np.tile(robot.standing(), (5, 1))
    qpos[:, robot.qpos_index] += draw.normal(scale=0.5, size=(5, len(robot.joint_names)))
    angles = clip.limited(qpos)[:, robot.qpos_index]
    turned = np.abs(np.diff(angles, axis=0)) * 30
    assert (turned <= speed[1:] + 1e-9).all() and (turned > 0.999 * speed[1:]).any()
    assert (angles >= robot.lower).all() and (angles <= robot.upper).all()


def test_a_human_that_leaps_is_followed_at_the_joints_speed() -> None:
    wave, robot = read_motion(SAMPLES / "wave.bvh").resample(30), load_robot("op3")
    hanging, raised = np.arange(12), len(wave) // 2 + np.arange(12)
    picked = np.concatenate([hanging, raised, hanging])
    assert wave.rotations is not None
    leaping = replace(wave, positions=wave.positions[picked], rotations=wave.rotations[picked])
    angles = retarget(leaping, robot, balance="off").trajectory.qpos[:, robot.qpos_index]
    turned = np.abs(np.diff(angles, axis=0)) / (robot.max_speed / 30)
    assert 0.99 < turned.max() < 1 + 1e-9
