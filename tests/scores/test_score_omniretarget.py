"""OmniRetarget's figures against their definitions, restated frame by frame."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from made_trajectories import hold, lifted

import robot_retarget as rr
from robot_retarget.scores import physics
from robot_retarget.scores.score import score
from robot_retarget.scores.subject import Subject

SCALE = 0.75


def subject_of(human: np.ndarray, robot: np.ndarray) -> Subject:
    """Toes (T, 2, 2) of both bodies seen from above."""
    flat = [np.concatenate([toes, np.zeros((*toes.shape[:2], 1))], axis=2) for toes in (human, robot)]
    pair = SimpleNamespace(
        human=flat[0],
        robot=flat[1],
        match=SimpleNamespace(leg_ratio=SCALE),
        has=lambda *names: True,
        index=lambda name: int(name == "r_toe"),
    )
    return cast(Subject, SimpleNamespace(pair=pair))


def restated(human: np.ndarray, robot: np.ndarray) -> tuple[float, float]:
    """Skating as `detect_foot_sliding` and `extract_foot_sticking_sequence_velocity` describe it, a frame at a time."""
    sticking, slides = 0, list[float]()
    for t in range(1, len(human)):
        stuck = [float(np.hypot(*(SCALE * (human[t, k] - human[t - 1, k])))) <= 0.01 for k in range(2)]
        moved = [float(np.hypot(*(robot[t, k] - robot[t - 1, k]))) for k in range(2)]
        sticking += any(stuck)
        worst = max(m if s and m > 0.01 else 0.0 for m, s in zip(moved, stuck, strict=True))
        slides += [worst] if worst > 0 else []
    return (100 * len(slides) / sticking, 100 * float(np.mean(slides))) if slides else (0.0, 0.0)


@given(st.integers(0, 10_000), st.integers(2, 40))
def test_skating_is_that_of_holosoma(seed: int, frames: int) -> None:
    draw = np.random.default_rng(seed)
    human, robot = (np.cumsum(draw.normal(0, 0.008, (frames, 2, 2)), axis=0) for _ in range(2))
    found = cast(Any, physics.skating.of(subject_of(human, robot)))
    assert found == pytest.approx(restated(human, robot))


def test_depth_is_the_mean_over_penetrating_frames() -> None:
    robot = rr.load_robot("op3")
    stands = hold(robot)
    floor = cast(float, score(stands, robot).figures["float_med_cm"]) / 100
    sunk = -floor - np.where(np.arange(len(stands)) % 2, 0.03, 0.005)
    found = score(lifted(stands, sunk), robot).figures
    assert found["omni_pen_cm"] == pytest.approx(3, abs=0.05)
    assert found["omni_pen_pct"] == pytest.approx(50, abs=2)
