"""Frame by frame it does not matter where one begins: frames solved alone and inside their clip are soon the same."""

import numpy as np
import pytest
from shared_files import SHARED, needs_shared

from robot_retarget.base.files import SAMPLES
from robot_retarget.graph.describe import describe
from robot_retarget.human.read import read_motion
from robot_retarget.robot import Robot, load_robot
from robot_retarget.solver.options import Smoothing
from robot_retarget.solver.pipeline import retarget
from robot_retarget.solver.solve import solve_graph

FPS, FRAMES, START = 30.0, 100, 40
SOON = 15
"""Half a second, in frames."""
NEAR = 0.02
"""[rad]"""
CAUSAL = Smoothing(passes=0)
ALONE = {
    "op3": ("squat",),
    "unitree_g1": ("squat", "hips_and_bow"),
    "unitree_h1": ("wave",),
    "booster_t1": ("hips_and_bow",),
}
"""Clips whose parts alone tell what the whole tells; arms of three joints go on as they began. Where hands meet, as in a clap,
which one goes first depends on where they come from."""
SAME = {
    "op3": ("walk", "squat"),
    "unitree_g1": ("walk", "hips_and_bow"),
    "unitree_h1": ("walk", "wave"),
    "booster_t1": ("squat",),
}


def model(name: str) -> str:
    return name if name == "op3" else str(SHARED / f"robots/{name}/{name}.xml")


def cases(chosen: dict[str, tuple[str, ...]]) -> list:
    marks = {name: () if name == "op3" else needs_shared for name in chosen}
    return [pytest.param(name, clip, marks=marks[name]) for name, clips in chosen.items() for clip in clips]


def _apart(robot: Robot, inside: np.ndarray, alone: np.ndarray) -> float:
    """The largest difference of a joint after half a second [rad]."""
    return float(np.abs(inside - alone)[SOON:, robot.qpos_index].max())


@pytest.mark.parametrize(("name", "clip"), cases(ALONE))
def test_frames_alone_and_inside_their_clip_are_soon_the_same(name: str, clip: str) -> None:
    motion, robot = read_motion(SAMPLES / f"{clip}.bvh").resample(FPS), load_robot(model(name))
    span = slice(START, min(START + FRAMES, len(motion)))
    inside = retarget(motion, robot, smoothing=CAUSAL, balance="off").trajectory.qpos[span]
    alone = retarget(motion.frames(span.start, span.stop), robot, smoothing=CAUSAL, balance="off").trajectory.qpos
    assert _apart(robot, inside, alone) < NEAR


@pytest.mark.parametrize(("name", "clip"), cases(SAME))
def test_the_same_edges_lead_to_the_same_poses_wherever_they_begin(name: str, clip: str) -> None:
    """How segments are turned on the whole is read off all frames there are: edges of a part may differ."""
    graph = describe(read_motion(SAMPLES / f"{clip}.bvh"), load_robot(model(name)), fps=FPS)
    whole = solve_graph(graph, smoothing=CAUSAL).trajectory.qpos
    for start in (20, 80):
        span = slice(start, min(start + FRAMES, len(graph)))
        alone = solve_graph(graph.frames(span.start, span.stop), smoothing=CAUSAL).trajectory.qpos
        assert _apart(graph.robot, whole[span], alone) < NEAR
