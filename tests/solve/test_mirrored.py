"""A mirrored motion gives the mirrored trajectory: no side is preferred, not even by the draws."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from shared_files import SHARED, needs_shared

from robot_retarget.describe.graph import describe
from robot_retarget.motion import Motion, read_motion
from robot_retarget.robot import Robot, load_robot
from robot_retarget.robot.mirror import mirror_of
from robot_retarget.shipped import SAMPLES
from robot_retarget.solve.options import Smoothing
from robot_retarget.transfer import retarget, solve

LEFT = np.array([0.0, 1.0, 0.0])


OTHER = {"Left": "Right", "Right": "Left", "L": "R", "R": "L", "l": "r", "r": "l"}


def mirrored(motion: Motion) -> Motion:
    """Left and right exchanged: joints, places and turns."""
    names = motion.skeleton.names
    side = re.compile("^(Left|Right|[LR](?=[A-Z])|[lr](?=hand))")
    other = [side.sub(lambda found: OTHER[found[0]], n) for n in names]
    order = [names.index(n) for n in other]
    turned = None if motion.rotations is None else motion.rotations[:, order] * [1, -1, 1, -1]
    return replace(motion, positions=motion.positions[:, order] * [1, -1, 1], rotations=turned)


def asymmetry(motion: Motion, robot: Robot, smoothing: Smoothing, separated: bool = True) -> float:
    """By how much a hinge of the mirrored trajectory misses that of the mirrored motion, at most [rad]."""
    motions, hinges = (motion, mirrored(motion)), robot.qpos_index
    graphs = (describe(m, robot) for m in motions)
    graphs = (graph if separated else graph.without("separation") for graph in graphs)
    here, there = (solve(graph, smoothing=smoothing).trajectory.qpos[:, hinges] for graph in graphs)
    return float(np.abs(mirror_of(robot, LEFT).angles(here) - there).max())


CAUSAL, WHOLE = Smoothing(passes=0), Smoothing()


# Squat and hands on hips are their own mirror images. Where hands meet, as in a clap, one goes first.
@pytest.mark.parametrize("clip", ["wave", "walk", "squat", "hips_and_bow"])
@pytest.mark.parametrize("smoothing", [CAUSAL, WHOLE], ids=["causal", "whole"])
def test_a_mirrored_motion_gives_the_mirrored_trajectory(clip: str, smoothing: Smoothing) -> None:
    motion = read_motion(SAMPLES / f"{clip}.bvh").resample(15)
    assert asymmetry(motion, load_robot("op3"), smoothing) < 1e-3


def test_knees_of_which_neither_goes_first_do_not_stop_a_squat_half_way_down() -> None:
    motion, robot = read_motion(SAMPLES / "squat.bvh").resample(15), load_robot("op3")
    lowest = [retarget(motion, robot, smoothing=s).trajectory.qpos[:, 2].min() for s in (CAUSAL, WHOLE)]
    assert lowest[0] == pytest.approx(lowest[1], abs=0.005)


@needs_shared
@pytest.mark.parametrize("name", ["booster_t1", "unitree_h1", "toddlerbot_2xc"])
def test_frame_by_frame_hands_that_meet_do_not_get_stuck(name: str) -> None:
    """A frame whose hands were held back costs ten times as much as one of the smooth clap."""
    motion, robot = read_motion(SAMPLES / "clap.bvh").resample(30), load_robot(SHARED / f"robots/{name}/{name}.xml")
    solved = [retarget(motion, robot, smoothing=smoothing).solution for smoothing in (CAUSAL, WHOLE)]
    most = [(solution.cost - solution.stress["smoothness"]).max() for solution in solved]
    assert most[0] < 6 * most[1]


@needs_shared
@pytest.mark.parametrize("clip", ["hips_and_bow", "squat"])
@pytest.mark.parametrize("smoothing", [CAUSAL, WHOLE], ids=["causal", "whole"])
def test_hulls_that_differ_from_side_to_side_hardly_give_a_motion_a_side(clip: str, smoothing: Smoothing) -> None:
    """Those of this robot's hips do by a millimetre and a half, and its wrists rest on them."""
    motion = read_motion(SAMPLES / f"{clip}.bvh").resample(30)
    robot = load_robot(SHARED / "robots/unitree_g1/unitree_g1.xml")
    angles = retarget(motion, robot, smoothing=smoothing).trajectory.qpos[:, robot.qpos_index]
    assert np.abs(mirror_of(robot, LEFT).angles(angles) - angles).max() < 0.05


@needs_shared
@pytest.mark.parametrize(
    ("name", "clip", "smoothing"),
    [
        ("robotis_op3", SAMPLES / "walk.bvh", WHOLE),
        ("toddlerbot_2xc", SAMPLES / "wave.bvh", CAUSAL),
        # The human's left leg is longer than the right.
        ("robotis_op3", SHARED / "motions/bvh/cmu_hahne_3dsmax/jumping_jacks.bvh", CAUSAL),
    ],
)
def test_so_it_does_on_robots_whose_joints_mirror_each_other_and_whose_meshes_do_not(
    name: str, clip: Path, smoothing: Smoothing
) -> None:
    """But for links that near each other: there it is the meshes that say how far they may."""
    motion, robot = read_motion(clip).resample(10), load_robot(SHARED / f"robots/{name}/{name}.xml")
    assert asymmetry(motion, robot, smoothing, separated=False) < 1e-3
