"""Presets of the weights: `directions` and `distances` lower their own error, `balanced` changes nothing."""

import numpy as np
import pytest

from robot_retarget.base.errors import UsageError
from robot_retarget.base.files import SAMPLES
from robot_retarget.graph.weights import PRESETS, Weights
from robot_retarget.human.read import read_motion
from robot_retarget.robot import load_robot
from robot_retarget.solver.pipeline import retarget
from robot_retarget.tools.summary import describe_solution


def test_the_balanced_preset_changes_no_weight() -> None:
    assert Weights().with_preset("balanced") == Weights()
    assert list(PRESETS) == ["directions", "balanced", "distances"]


def test_each_preset_lowers_the_error_that_it_favours() -> None:
    """Each is the minimum of its own  π f + r : the solutions of the others cost more under its π."""
    motion, robot = read_motion(SAMPLES / "walk.bvh").frames(0, 60), load_robot("op3")
    factors = np.array([each.get("near", 1.0) for each in PRESETS.values()])
    solutions = [retarget(motion, robot, fps=15, preset=preset, balance="off").solution for preset in PRESETS]
    posture = np.array([each.stress["posture"].mean() for each in solutions])
    distances, rest = posture / factors, np.array([each.cost.mean() for each in solutions]) - posture
    costs = factors[:, None] * distances + rest
    assert (costs.argmin(axis=1) == range(len(PRESETS))).all()
    assert (np.diff(rest) > 0).all()
    assert distances[0] > 1.02 * distances[1] > 1.02**2 * distances[2]


def test_an_unknown_preset_lists_the_known_ones() -> None:
    with pytest.raises(UsageError, match=r"'angles'; known: directions, balanced, distances"):
        Weights().with_preset("angles")  # pyright: ignore[reportArgumentType]


def test_frames_a_second_count_the_time_that_balance_took() -> None:
    motion, robot = read_motion(SAMPLES / "wave.bvh").frames(0, 60), load_robot("op3")
    result = retarget(motion, robot, fps=15, legs="stand", balance="static")
    seconds = result.solution.timings["solve"] + result.solution.timings["balance"]
    facts = describe_solution(result.solution)
    assert facts["frames"] == len(result.trajectory) > len(motion.resample(15))
    assert facts["solved_per_second"] == pytest.approx(len(result.trajectory) / seconds, abs=0.1)
    assert result.solution.timings["balance"] > 0
