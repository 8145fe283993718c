"""Which swings are steps; reachable footholds stay, others come nearer, and root and swing feet follow."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robot_retarget.base.arrays import intervals
from robot_retarget.scene.geoms import SolidGround
from robot_retarget.scene.scene import RigidBody, Scene
from robot_retarget.scene.shape import ShapeKind, solid
from robot_retarget.solver.balance.footsteps import (
    REACH,
    gaps,
    reachable_footholds,
    spread,
    total_step_length,
    without_small_swings,
)
from robot_retarget.solver.balance.turns import turning_steps

LEG = 0.25
SOLE = np.array([[0.06, 0.04, 0.0], [0.06, -0.04, 0.0], [-0.06, 0.04, 0.0], [-0.06, -0.04, 0.0]])
OWN = SOLE + np.array([[[0.0, 0.05, 0.0]], [[0.0, -0.05, 0.0]]])
SWINGS = ((0, 10, 20, 0.5), (1, 30, 40, 1.0), (0, 50, 60, 1.0), (1, 70, 80, 1.0), (0, 90, 100, 0.5))
"""Foot, from, to, length over the step's."""


def walk(step: float, turn: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Which feet stand, and soles that walk straight ahead into a direction by so long steps [m]."""
    planted, ahead = np.ones((110, 2), bool), np.zeros((110, 2))
    for foot, start, stop, share in SWINGS:
        planted[start:stop, foot] = False
        ahead[:, foot] += share * step * np.clip((np.arange(110) - start + 1) / (stop - start + 1), 0, 1)
    corners = np.tile(OWN, (110, 1, 1, 1))
    corners[..., 0] += ahead[:, :, None]
    spin = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    corners[..., :2] = corners[..., :2] @ spin.T
    return planted, corners


@pytest.mark.parametrize(
    ("travel", "lift", "rise", "step"),
    [
        (0.29, 0.0, None, False),
        (0.31, 0.0, None, True),
        (0.0, 0.11, None, False),
        (0.0, 0.13, None, True),
        (0.29, 0.0, 0.055, False),
        (0.29, 0.0, 0.065, True),
        (0.29, 0.11, 0.0, False),
        (0.29, 0.13, 0.0, True),
    ],
)
def test_a_swing_is_a_step_when_it_goes_far_or_lifts_the_foot_or_ends_on_another_level(
    travel: float, lift: float, rise: float | None, step: bool
) -> None:
    """In legs of 0.8 m, on a level floor or onto a block whose edge is 0.07 m ahead."""
    leg, planted, corners = 0.8, np.ones((40, 2), bool), np.tile(OWN, (40, 1, 1, 1))
    planted[10:20, 0] = False
    corners[10:, 0, :, 0] += travel * leg
    corners[10:20, 0, :, 2] += lift * leg
    ground = None
    if rise is not None:
        height = max(rise * leg, 1e-3)
        corners[10:, 0, :, 2] += height
        place = np.array([0.37, 0.0, height / 2, 1, 0, 0, 0])
        ground = SolidGround(Scene((RigidBody("block", solid(ShapeKind.BOX, (0.6, 0.4, height)), place),)))
    assert (without_small_swings(planted, corners, leg, 30.0, ground=ground) == planted).all() == step


def test_a_foot_hands_over_to_the_other_while_both_stand() -> None:
    planted, corners = np.ones((40, 2), bool), np.tile(OWN, (40, 1, 1, 1))
    planted[20:, 0] = planted[:20, 1] = False
    corners[20:, 0, :, 2] = corners[:20, 1, :, 2] = 1.0
    kept = without_small_swings(planted, corners, 0.8, 30.0)
    assert kept[19:21].all() and (kept[:19] == planted[:19]).all() and (kept[21:] == planted[21:]).all()


@pytest.mark.parametrize("turn", [0.0, 0.3, 0.6])
def test_soles_that_turn_towards_each_other_keep_nearly_half_of_the_gap_of_the_stand(turn: float) -> None:
    corners = OWN[None].copy()
    spin = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    middle = corners[:, 0].mean(axis=1)[..., :2]
    corners[:, 0, :, :2] = (corners[:, 0, :, :2] - middle) @ spin.T + middle
    corners[:, 0, :, 1] -= 0.04
    placed = spread(corners, OWN)
    assert gaps(placed)[0] > 0.45 * gaps(OWN[None])[0]
    np.testing.assert_allclose(placed.mean(axis=(1, 2)), corners.mean(axis=(1, 2)), atol=1e-12)


def test_steps_within_reach_stay_as_they_are() -> None:
    planted, corners = walk(2 * 0.99 * REACH * LEG)
    assert reachable_footholds(planted, corners, OWN, LEG) == pytest.approx(corners, abs=1e-12)


@given(st.floats(1.1, 6.0), st.floats(-np.pi, np.pi))
@settings(max_examples=30, deadline=None)
def test_steps_out_of_reach_become_as_long_as_legs_reach_whichever_way_they_go(longer: float, turn: float) -> None:
    planted, corners = walk(2 * longer * REACH * LEG, turn)
    placed = reachable_footholds(planted, corners, OWN, LEG)
    for foot, start, stop, share in SWINGS:
        way = np.linalg.norm((placed[stop, foot] - placed[start - 1, foot]).mean(axis=0))
        assert way == pytest.approx(2 * share * REACH * LEG, rel=1e-6)
        assert np.ptp(placed[stop : stop + 10, foot], axis=0).max() < 1e-9
    shape = placed - placed.mean(axis=2, keepdims=True)
    assert shape == pytest.approx(corners - corners.mean(axis=2, keepdims=True), abs=1e-9)
    assert total_step_length(planted, placed) / total_step_length(planted, corners) == pytest.approx(1 / longer)


def test_a_foot_in_the_air_is_no_farther_from_its_place_beside_the_other_than_one_that_stands() -> None:
    planted, corners = walk(0.0)
    corners[12:18, 0, :, 0] += 3 * REACH * LEG
    placed = reachable_footholds(planted, corners, OWN, LEG)
    assert (placed[12:18, 0] - OWN[0])[..., 0] == pytest.approx(REACH * LEG)
    assert placed[20:] == pytest.approx(corners[20:], abs=1e-12)


@given(st.floats(2.1, 14.0), st.booleans(), st.integers(0, 10_000))
@settings(max_examples=40, deadline=None)
def test_a_spin_on_both_feet_or_on_one_is_small_turns_of_one_foot_after_the_other(
    way: float, right: bool, seed: int
) -> None:
    """Between soles that turn with the body, however it sways, as complex numbers."""
    most, rate, rng = 1.0, 0.12, np.random.default_rng(seed)
    frames = np.arange(round(way / rate) + 40)
    turns = np.clip(frames - 20, 0, way / rate) * rate * (-1 if right else 1) + 0.02 * np.sin(frames / 3)
    planted, corners = np.ones((len(frames), 2), bool), np.zeros((len(frames), 2, 4, 3))
    turned = (OWN[..., 0] + 1j * OWN[..., 1]) * np.exp(1j * turns)[:, None, None] + rng.normal()
    corners[..., 0], corners[..., 1] = turned.real, turned.imag
    if seed % 2:
        planted[22:-22, 1] = False
    steps, placed = turning_steps(planted, corners, OWN, turns, 30.0, most)
    ahead = placed[..., :2, :2].mean(axis=2) - placed[..., 2:, :2].mean(axis=2)
    landings = sorted((stop, foot) for foot in range(2) for _, stop in intervals(~steps[:, foot]))
    assert steps.any(axis=1).all() and len(landings) < 2 * way / most + 3
    if planted.all():  # the inner foot first
        assert [foot for _, foot in landings] == [(k + right) % 2 for k in range(len(landings))]
    for foot in range(2):
        held = []
        for start, stop in intervals(steps[:, foot]):
            x, y = np.median(ahead[start:stop, foot], axis=0)
            off = np.angle((x + 1j * y) * np.exp(-1j * turns[start:stop]))
            assert np.abs(off).max() < 1.25 * most  # what the hips turn
            held.append(turns[start] + off[0])
        assert np.abs(np.diff(held)).max() < 1.75 * most + 3 * rate
    apart = placed[:, 0].mean(axis=1) - placed[:, 1].mean(axis=1)
    assert np.linalg.norm(apart, axis=1) == pytest.approx(0.1)


def test_a_body_that_twists_by_a_quarter_turn_over_its_feet_takes_no_steps() -> None:
    turns, planted, corners = 0.8 * np.sin(np.arange(90) / 10), np.ones((90, 2), bool), np.tile(OWN, (90, 1, 1, 1))
    steps, placed = turning_steps(planted, corners, OWN, turns, 30.0, 1.0)
    assert steps.all() and (placed == corners).all()
