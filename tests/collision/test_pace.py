"""How joints go on: what keeps its pace and what swings are told apart by their own past."""

import numpy as np
import pytest

from robot_retarget.collision.pace import SWING, TRUSTED, Pace, steady, swinging

K = np.arange(1.0, 13.0)


def watch(path: np.ndarray) -> tuple[Pace, np.ndarray]:
    """What is guessed at the end of a path (T, n), K steps ahead."""
    pace, gains = Pace(K, 1 / 30), np.zeros((2, len(K)))
    steps = np.diff(path, axis=0)
    changes = np.diff(steps, axis=0)
    for now, step, change in zip(path[2:], steps[1:], changes, strict=True):
        gains = pace.next(now, step, change)
    return pace, path[-1] + gains.T @ np.stack([steps[-1], changes[-1]])


def swing(count: int) -> np.ndarray:
    """What goes by the steps that `swinging` sums up."""
    steps = [np.array([0.05, -0.02, 0.0]), np.array([0.06, -0.01, 0.03])]
    while len(steps) < count:
        steps.append(SWING[0] * steps[-1] + SWING[1] * steps[-2])
    return np.cumsum(steps, axis=0)


def test_a_steady_pace_is_trusted_and_foreseen_exactly() -> None:
    path = np.arange(40)[:, None] * np.array([0.02, -0.01, 0.0])
    pace, ahead = watch(path)
    assert pace.trust == pytest.approx(1)
    assert ahead == pytest.approx(path[-1] + K[:, None] * [0.02, -0.01, 0.0])


def test_a_swing_is_foreseen_exactly() -> None:
    path = swing(40)
    pace, ahead = watch(path[:28])
    assert pace.trust < 0.01
    assert ahead == pytest.approx(path[28:40], abs=2e-4)


def test_before_there_is_a_past_neither_is_trusted() -> None:
    pace, _ = watch(swing(6))
    assert pace.trust == 0.5 < TRUSTED


def test_near_now_both_go_by_the_last_step() -> None:
    for gains in (steady(np.array([1.0]), 1 / 30), swinging(np.array([1.0]))):
        assert gains[0, 0] == pytest.approx(1, abs=0.2) and gains[1, 0] > 0


def test_the_fading_change_of_pace_is_a_parabola_at_first() -> None:
    k = np.array([1e-3])
    assert steady(k, 1e-4)[1] == pytest.approx(k * (k + 1) / 2, rel=1e-3)
