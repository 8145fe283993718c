"""The dial between directions and distances: each side gets what it asks for, the middle changes nothing."""

import numpy as np
import pytest

from robot_retarget.describe.weights import FAVOURS, Weights
from robot_retarget.errors import UsageError
from robot_retarget.motion import read_motion
from robot_retarget.pipeline import retarget
from robot_retarget.robot import load_robot
from robot_retarget.shipped import SAMPLES
from robot_retarget.summary import describe_solution


def test_the_middle_is_the_weights_as_they_are() -> None:
    assert Weights().favouring("balanced") == Weights()
    assert list(FAVOURS) == ["directions", "balanced", "distances"]


def test_what_is_favoured_is_followed_more_closely() -> None:
    """At minima of  f π + r  the loss f falls and the rest r grows with π."""
    motion, robot = read_motion(SAMPLES / "walk.bvh").frames(0, 60), load_robot("op3")
    distances, rest = [], []
    for favour, factor in FAVOURS.items():
        solution = retarget(motion, robot, fps=15, favour=favour).solution
        posture = solution.stress["posture"].mean()
        distances.append(posture / factor)
        rest.append(solution.cost.mean() - posture)
    assert distances[0] > 1.02 * distances[1] > 1.02**2 * distances[2]
    assert rest[0] < 0.98 * rest[1] < 0.98**2 * rest[2]


def test_an_unknown_word_names_those_there_are() -> None:
    with pytest.raises(UsageError, match=r"'angles'; known: directions, balanced, distances"):
        Weights().favouring("angles")


def test_frames_a_second_count_the_time_that_balance_took() -> None:
    motion, robot = read_motion(SAMPLES / "wave.bvh").frames(0, 60), load_robot("op3")
    result = retarget(motion, robot, fps=15, legs="stand", balance="static")
    seconds = result.solution.timings["solve"] + result.solution.timings["balance"]
    told = describe_solution(result.solution)
    assert told["frames"] == len(result.trajectory) > len(motion.resample(15))
    assert told["solved_per_second"] == pytest.approx(len(result.trajectory) / seconds, abs=0.1)
    assert result.solution.timings["balance"] > 0
    assert (
        told["sigma"].keys() == {"relative", "half squared", "squared"} and np.isfinite([*told["sigma"].values()]).all()
    )
