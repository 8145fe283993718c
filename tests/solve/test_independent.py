"""Frame by frame it does not matter where one begins: frames solved alone and inside their clip are soon the same."""

import numpy as np
import pytest
from shared_files import SHARED, needs_shared

from robot_retarget.describe.contacts import intervals
from robot_retarget.describe.edges import build_edges
from robot_retarget.describe.match import match
from robot_retarget.motion import read_motion
from robot_retarget.robot import Robot, load_robot
from robot_retarget.shipped import SAMPLES
from robot_retarget.solve.clip import Smoothing
from robot_retarget.solve.footing import nearing
from robot_retarget.solve.problem import build_problem
from robot_retarget.solve.solve import solve
from robot_retarget.solve.stepping import settling
from robot_retarget.transfer import retarget

FPS, FRAMES, START = 30.0, 100, 40
SOON = 15
"""Half a second, in frames."""
SAME = 0.02
"""[rad]"""
CAUSAL = Smoothing(passes=0)
SAMPLED = ("walk", "squat", "wave", "clap", "hips_and_bow")
MET = {"unitree_g1": SAMPLED, "unitree_h1": SAMPLED[1:], "booster_t1": SAMPLED}
"""Clips whose parts alone tell what the whole tells, per robot."""
MODELS = {name: str(SHARED / f"robots/{name}/{name}.xml") for name in MET}
ELSEWHERE = [pytest.param(MODELS[name], clip, marks=needs_shared) for name, clips in MET.items() for clip in clips]


def _apart(robot: Robot, inside: np.ndarray, alone: np.ndarray) -> float:
    """The largest difference of a joint after half a second [rad]."""
    return float(np.abs(inside - alone)[SOON:, robot.qpos_index].max())


@pytest.mark.parametrize(
    ("name", "clip"),
    [("op3", clip) for clip in ("walk", "squat", "clap", "hips_and_bow")] + ELSEWHERE,
)
def test_frames_alone_and_inside_their_clip_are_soon_the_same(name: str, clip: str) -> None:
    motion, robot = read_motion(SAMPLES / f"{clip}.bvh").resample(FPS), load_robot(name)
    span = slice(START, min(START + FRAMES, len(motion)))
    inside = retarget(motion, robot, smoothing=CAUSAL).trajectory.qpos[span]
    alone = retarget(motion.frames(span.start, span.stop), robot, smoothing=CAUSAL).trajectory.qpos
    assert _apart(robot, inside, alone) < SAME


@pytest.mark.parametrize(
    ("name", "clip"),
    [("op3", clip) for clip in ("walk", "squat", "clap")]
    + [*ELSEWHERE, pytest.param(MODELS["unitree_h1"], "walk", marks=needs_shared)],
)
def test_the_same_edges_lead_to_the_same_poses_wherever_they_begin(name: str, clip: str) -> None:
    """How segments are turned on the whole is read off all frames there are: edges of a part may differ."""
    motion, robot = read_motion(SAMPLES / f"{clip}.bvh").resample(FPS), load_robot(name)
    matched = match(motion, robot)
    edges = build_edges(motion, matched)
    problem = build_problem(robot, matched, edges)
    whole = solve(problem, edges, FPS, smoothing=CAUSAL).trajectory.qpos
    for start in (20, 40, 80):
        span = slice(start, min(start + FRAMES, len(edges)))
        alone = solve(problem, edges.window(span), FPS, smoothing=CAUSAL).trajectory.qpos
        assert _apart(robot, whole[span], alone) < SAME


def test_feet_near_their_footholds_before_they_stand_and_settle_after() -> None:
    stands = np.zeros((30, 2), dtype=bool)
    stands[8:20, 0] = stands[:5, 1] = stands[28:, 1] = True
    near, settled = nearing(stands, 3), settling(stands, 3)
    assert (near[stands] == 1).all() and near[:5, 0].max() == 0 == near[5:25, 1].max()
    assert (np.diff(near[5:9, 0]) > 0).all() and (settled[5:9, 0] == 11).all()
    assert settled[0, 1] == 3 and settled[28, 1] == 29  # never beyond the stance itself
    assert [tuple(run) for run in intervals(settled[:, 0] != np.arange(30))] == [(5, 9)]
