"""The interaction distance of capsules, against cases solved by hand and against brute force."""

from typing import Any

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from robot_retarget.collision.approach import Approach, CapsulePairs
from robot_retarget.dgp.interaction import Interaction
from robot_retarget.robot.capsules import Capsules
from robot_retarget.robot.clearance import Pairs

R = 0.1
CASES = {  # centre and step of two balls of radius R → D, α
    "crossing": ((-2.0, 0, 0), (0.5, 0, 0), (0, -2.0, 0), (0, 0.5, 0), -2 * R, 5),
    "head-on": ((-1.0, 0, 0), (0.25, 0, 0), (1.0, 0, 0), (-0.25, 0, 0), -2 * R, 5),
    "one steady": ((-1.0, 0.5, 0), (0.25, 0, 0), (0, 0, 0), (0, 0, 0), 0.5 - 2 * R, 5),
    "the other steady": ((0, 0, 0), (0, 0, 0), (-1.0, 0.5, 0), (0.25, 0, 0), 0.5 - 2 * R, 5),
    "co-moving": ((0, 0, 0), (0.3, 0.1, 0), (0, 1.0, 0), (0.3, 0.1, 0), 1 - 2 * R, 1),
    "parallel, overtaking": ((-1.0, 1.0, 0), (0.5, 0, 0), (0, 0, 0), (0.25, 0, 0), 1 - 2 * R, 5),
    "receding": ((0, 0, 0), (-0.2, 0, 0), (1.0, 0, 0), (0.2, 0, 0), 1 - 2 * R, 1),
    "beyond the horizon": ((-100.0, 0, 0), (1.0, 0, 0), (0, 0, 0), (0, 0, 0), 85 - 2 * R, 16),
}


def approach(ends: np.ndarray, steps: np.ndarray, radii: np.ndarray, horizon: float = 15) -> Approach:
    """Of two links with a capsule each: ends and steps (T, 2, 2, 3)."""
    capsules = Capsules(np.array([1, 2]), np.zeros((2, 2, 3)), radii, {})
    pairs = Pairs(np.array([[1, 2]]), (((0, 1),),))
    return CapsulePairs(capsules, pairs).approach(ends, steps, Interaction(horizon, 1e-9))


@pytest.mark.parametrize("name", CASES)
def test_balls_meet_as_worked_out_by_hand(name: str) -> None:
    first, first_step, second, second_step, ahead, alpha = CASES[name]
    ends = np.repeat(np.array([[first, second]], float), 2, axis=0).reshape(2, 1, 2, 3).transpose(1, 2, 0, 3)
    steps = np.repeat(np.array([[first_step, second_step]], float), 2, axis=0).reshape(2, 1, 2, 3).transpose(1, 2, 0, 3)
    found = approach(ends, steps, np.array([R, R]))
    apart = np.linalg.norm(np.subtract(first, second)) - 2 * R
    assert found.distance[0, 0] == pytest.approx(apart, abs=1e-12)
    assert found.ahead[0, 0] == pytest.approx(ahead, abs=1e-12)
    assert found.alpha[0, 0] == alpha


def segment_distance(a: np.ndarray, b: np.ndarray) -> float:
    """Between two segments (2, 3), by minimising over the one the distance to the other."""

    def to_second(s: float) -> float:
        point = a[0] + s * (a[1] - a[0])
        along = b[1] - b[0]
        share = np.clip((point - b[0]) @ along / (along @ along), 0, 1)
        return float(np.linalg.norm(point - b[0] - share * along))

    found: Any = minimize_scalar(to_second, bounds=(0, 1), method="bounded", options={"xatol": 1e-9})
    return float(found.fun)


def test_segments_are_as_far_apart_as_a_search_finds() -> None:
    draw = np.random.default_rng(0)
    ends = draw.normal(size=(200, 2, 2, 3))
    ends[::10, 1] = ends[::10, 0] + draw.normal(size=(20, 1, 3))  # parallel ones too
    found = approach(ends, np.zeros_like(ends), np.zeros(2)).distance[:, 0]
    assert found == pytest.approx([segment_distance(*pair) for pair in ends], abs=1e-6)


def test_what_is_foreseen_lies_between_the_best_step_and_the_present() -> None:
    draw = np.random.default_rng(1)
    ends = draw.normal(scale=0.4, size=(600, 2, 1, 3)) + draw.normal(scale=0.12, size=(600, 2, 2, 3))
    steps = np.repeat(draw.normal(scale=0.03, size=(600, 2, 1, 3)), 2, axis=2)
    steps = steps + draw.normal(scale=0.006, size=ends.shape)
    found = approach(ends, steps, np.zeros(2))
    best = np.min([approach(ends + k * steps, 0 * steps, np.zeros(2)).distance for k in range(16)], axis=0)
    assert (found.ahead <= found.distance + 1e-12).all()
    assert (found.ahead >= best - 1e-9).all()
    assert np.mean(found.ahead <= best + 0.005) > 0.85
    there = approach(ends + (found.alpha - 1)[..., None, None] * steps, 0 * steps, np.zeros(2)).distance
    assert (there <= found.ahead + 1e-9).all()


def test_a_common_step_changes_nothing() -> None:
    draw = np.random.default_rng(2)
    ends, steps = draw.normal(size=(50, 2, 2, 3)), draw.normal(scale=0.1, size=(50, 2, 2, 3))
    plain, moved = (approach(ends, steps + s, np.array([0.1, 0.2])) for s in (np.zeros(3), np.array([0.3, -0.2, 0.1])))
    assert moved.ahead == pytest.approx(plain.ahead, abs=1e-9)
    assert (moved.alpha == plain.alpha).mean() > 0.98


def test_links_of_several_capsules_are_as_near_as_their_nearest() -> None:
    draw = np.random.default_rng(3)
    ends, steps = draw.normal(size=(40, 5, 2, 3)), draw.normal(scale=0.1, size=(40, 5, 2, 3))
    radii, links = draw.uniform(0, 0.2, 5), np.array([1, 1, 2, 2, 2])
    capsules = Capsules(links, np.zeros((5, 2, 3)), radii, {})
    found = CapsulePairs(capsules, Pairs(np.array([[1, 2]]), (((0, 1),),))).approach(ends, steps, Interaction(15))
    each = [approach(ends[:, [a, b]], steps[:, [a, b]], radii[[a, b]]) for a in (0, 1) for b in (2, 3, 4)]
    assert found.distance == pytest.approx(np.min([one.distance for one in each], axis=0))
    least = np.argmin([one.ahead for one in each], axis=0)
    assert found.ahead == pytest.approx(np.min([one.ahead for one in each], axis=0))
    assert (found.alpha == np.choose(least, [one.alpha for one in each])).all()
