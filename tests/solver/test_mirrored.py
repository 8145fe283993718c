"""A mirrored motion gives the mirrored trajectory: no side is preferred, not even by the draws."""

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from shared_files import SHARED, needs_shared

from robot_retarget.base.files import SAMPLES
from robot_retarget.graph.describe import describe
from robot_retarget.human.motion import Motion
from robot_retarget.human.read import read_motion
from robot_retarget.robot import Robot, load_robot
from robot_retarget.robot.anatomy import mirror_of
from robot_retarget.solver.minimum import ClipMinimum
from robot_retarget.solver.pipeline import retarget, solve
from robot_retarget.solver.sqp import FrameSolver

LEFT = np.array([0.0, 1.0, 0.0])


OTHER = {"Left": "Right", "Right": "Left", "L": "R", "R": "L", "l": "r", "r": "l"}


def mirrored(motion: Motion) -> Motion:
    """Left and right exchanged: joints, places and turns, also of the clip that it is a part of."""
    names = motion.skeleton.names
    side = re.compile("^(Left|Right|[LR](?=[A-Z])|[lr](?=hand))")
    other = [side.sub(lambda found: OTHER[found[0]], n) for n in names]
    order = [names.index(n) for n in other]
    turned = None if motion.rotations is None else motion.rotations[:, order] * [1, -1, 1, -1]
    whole = None if motion.whole is None else mirrored(motion.whole)
    return replace(motion, positions=motion.positions[:, order] * [1, -1, 1], rotations=turned, whole=whole)


def asymmetry(motion: Motion, robot: Robot, separated: bool = True) -> float:
    """By how much a hinge of the mirrored trajectory misses that of the mirrored motion, at most [rad]."""
    motions, hinges = (motion, mirrored(motion)), robot.qpos_index
    graphs = (describe(m, robot) for m in motions)
    graphs = (graph if separated else graph.without("separation") for graph in graphs)
    here, there = (solve(graph, balance="off").trajectory.qpos[:, hinges] for graph in graphs)
    return float(np.abs(mirror_of(robot, LEFT).angles(here) - there).max())


# Squat and hands on hips are their own mirror images, as the clap is: see the laws of hands that meet below.
@pytest.mark.parametrize("clip", ["wave", "walk", "squat", "hips_and_bow"])
def test_a_mirrored_motion_gives_the_mirrored_trajectory(clip: str) -> None:
    motion = read_motion(SAMPLES / f"{clip}.bvh").resample(15).frames(0, 40)
    assert asymmetry(motion, load_robot("op3")) < 1e-3


def one_clap() -> Motion:
    """Hands that meet, and a second before and after."""
    return read_motion(SAMPLES / "clap.bvh").resample(15).frames(8, 40)


def lopsided_clap(lifted: float = 0.03) -> Motion:
    """The clap with the left hand higher [m], so that neither hand's way is as good as its mirror image."""
    motion = one_clap()
    hand = [k for k, name in enumerate(motion.skeleton.names) if name.startswith("LeftWrist")]
    positions = motion.positions.copy()
    positions[:, hand, 2] += lifted
    return replace(motion, positions=positions)


def test_a_clap_of_which_one_hand_is_higher_gives_the_mirrored_trajectory() -> None:
    """But for a degree: where flush faces touch, the nearest points differ from side to side."""
    assert asymmetry(lopsided_clap(), load_robot("op3")) < np.radians(1)


@needs_shared
@pytest.mark.parametrize("name", ["booster_t1", "unitree_g1"])
def test_so_it_does_on_other_robots_but_for_meshes_that_differ_from_side_to_side(name: str) -> None:
    robot = load_robot(SHARED / f"robots/{name}/{name}.xml")
    assert asymmetry(lopsided_clap(), robot, separated=False) < 1e-3


def test_the_best_clap_of_a_clap_that_mirrors_itself_does_not_mirror_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two hands that cannot fill the same place pass each other on either side: in the symmetric clap they stay apart."""
    robot = load_robot("op3")
    graph = describe(one_clap(), robot)
    free = solve(graph, balance="off").solution
    reflection = tangent_reflection(robot)

    def symmetric(steps: Callable[..., Any]) -> Callable[..., Any]:
        def mirrored_steps(*given: Any) -> Any:
            found, *others = steps(*given)
            return (found + found @ reflection.T) / 2, *others

        return mirrored_steps

    for solver, name in ((FrameSolver, "_steps"), (ClipMinimum, "_minimised")):
        monkeypatch.setattr(solver, name, symmetric(getattr(solver, name)))
    tied = solve(graph, balance="off").solution
    hinges = tied.trajectory.qpos[:, robot.qpos_index]
    assert np.abs(mirror_of(robot, LEFT).angles(hinges) - hinges).max() < 1e-6
    assert tied.cost.sum() > free.cost.sum()
    assert tied.stress["touch"].sum() > 1.3 * free.stress["touch"].sum()


def tangent_reflection(robot: Robot) -> np.ndarray:
    """Return the (nv, nv) reflection of tangent vectors of a robot with a free root."""
    mirror, matrix = mirror_of(robot, LEFT), np.zeros((robot.model.nv, robot.model.nv))
    matrix[range(6), range(6)] = [1, -1, 1, -1, 1, -1]
    for hinge, partner in enumerate(mirror.partner):
        matrix[robot.dof_index[hinge], robot.dof_index[partner]] = mirror.sign[partner]
    return matrix


@needs_shared
@pytest.mark.parametrize("clip", ["hips_and_bow", "squat"])
def test_hulls_that_differ_from_side_to_side_hardly_give_a_motion_a_side(clip: str) -> None:
    """Those of this robot's hips do by a millimetre and a half, and its wrists rest on them."""
    motion = read_motion(SAMPLES / f"{clip}.bvh").resample(15)
    robot = load_robot(SHARED / "robots/unitree_g1/unitree_g1.xml")
    angles = retarget(motion, robot, balance="off").trajectory.qpos[:, robot.qpos_index]
    assert np.abs(mirror_of(robot, LEFT).angles(angles) - angles).max() < 0.05


@needs_shared
@pytest.mark.parametrize(
    ("name", "clip"),
    [
        ("robotis_op3", SAMPLES / "walk.bvh"),
        ("toddlerbot_2xc", SAMPLES / "wave.bvh"),
        # The human's left leg is longer than the right.
        ("robotis_op3", SHARED / "motions/bvh/cmu_hahne_3dsmax/jumping_jacks.bvh"),
    ],
)
def test_so_it_does_on_robots_whose_joints_mirror_each_other_and_whose_meshes_do_not(name: str, clip: Path) -> None:
    """But for links that near each other: there it is the meshes that say how far they may."""
    motion, robot = read_motion(clip).resample(10).frames(0, 40), load_robot(SHARED / f"robots/{name}/{name}.xml")
    assert asymmetry(motion, robot, separated=False) < 1e-3
