"""Randomised simulations differ from the model in the drawn parameters only."""

import itertools

import numpy as np
import pytest
from made_trajectories import hold, swing

from robot_retarget.judge.playback import Playback, roll_out
from robot_retarget.judge.rollout import plant_of, rollouts
from robot_retarget.judge.worlds import Draw, drawn, draws, is_decided
from robot_retarget.robot import load_robot

OP3 = load_robot("op3")
FREE = plant_of(OP3, "free")
STAND = hold(OP3, 0.5)


def test_a_seed_gives_the_same_worlds_and_a_longer_list_begins_with_the_shorter():
    assert draws(5, seed=3) == draws(20, seed=3)[:5]
    assert draws(5, seed=3) != draws(5, seed=4)
    spread = np.array([[d.mass, d.friction, d.stiffness, d.delay, d.roll, d.pitch] for d in draws(400)])
    low, high = spread.min(0), spread.max(0)
    np.testing.assert_allclose(low, [0.9, 0.6, 0.85, 0.0, -np.pi / 180, -np.pi / 180], atol=0.01)
    np.testing.assert_allclose(high, [1.1, 1.2, 1.15, 0.02, np.pi / 180, np.pi / 180], atol=0.01)


def test_a_draw_leaves_the_plant_it_was_drawn_from_alone():
    before = FREE.model.body_mass.copy(), FREE.model.actuator_gainprm.copy(), FREE.model.opt.gravity.copy()
    drawn(FREE, draws(1)[0], Playback())
    after = FREE.model.body_mass, FREE.model.actuator_gainprm, FREE.model.opt.gravity
    assert all(np.array_equal(a, b) for a, b in zip(before, after, strict=True))


def test_a_heavier_robot_turns_as_heavily():
    model = drawn(FREE, Draw(mass=1.1), Playback())[0].model
    np.testing.assert_allclose(model.body_mass, 1.1 * FREE.model.body_mass)
    np.testing.assert_allclose(model.body_inertia, 1.1 * FREE.model.body_inertia)


def test_the_empty_draw_is_the_model():
    (same,) = rollouts(FREE, STAND, [Draw()])
    assert np.array_equal(same.qpos, roll_out(FREE, STAND, "free").qpos)


def test_the_ground_carries_what_a_drawn_robot_weighs():
    heavy, light = rollouts(FREE, STAND, [Draw(mass=1.1), Draw(mass=0.9)])
    weight = 9.81 * FREE.model.body_mass.sum()
    last = slice(-20, None)
    assert heavy.ground[last, 2].mean() == pytest.approx(1.1 * weight, rel=0.01)
    assert light.ground[last, 2].mean() == pytest.approx(0.9 * weight, rel=0.01)


def test_a_tilted_floor_pushes_a_standing_robot_sideways_by_its_sine():
    (tilted,) = rollouts(FREE, STAND, [Draw(roll=0.02)])
    force = tilted.ground[-20:, :3].mean(0)
    np.testing.assert_allclose(force[1] / force[2], np.tan(0.02), atol=2e-3)


def test_a_soft_servo_droops_more():
    arm = hold(OP3, 1.0)
    soft, stiff = rollouts(plant_of(OP3, "pinned"), arm, [Draw(stiffness=0.85), Draw(stiffness=1.15)], mode="pinned")
    droop = [np.abs(r.hinges[-1] - arm.qpos[-1, OP3.qpos_index]).max() for r in (soft, stiff)]
    assert droop[0] > 1.1 * droop[1]


def test_slippery_ground_lets_feet_turn_that_grip_holds():
    twist = swing(OP3, "l_hip_yaw", 0.4, 2.0, 1.0)
    slippery, rough = rollouts(FREE, twist, [Draw(friction=0.05), Draw(friction=1.2)])
    turned = [np.abs(r.hinges - twist.qpos[0, OP3.qpos_index]).max() for r in (slippery, rough)]
    assert turned[0] > turned[1]


def test_supply_and_floor_are_drawn_between_a_flat_battery_and_a_full_one_a_hard_floor_and_a_soft_one():
    spread = np.array([[12 * (d.voltage or 0), 1e3 * (d.floor or 0)] for d in draws(400)])
    np.testing.assert_allclose(spread.min(0), [11.0, 4.0], atol=0.06)
    np.testing.assert_allclose(spread.max(0), [12.4, 12.0], atol=0.06)


def test_a_low_supply_droops_by_the_inverse_of_its_voltage():
    """A holding servo gives its torque at an error of τ / (k_p V); little current flows."""
    arm, pinned = hold(OP3, 1.0), plant_of(OP3, "pinned")
    full, low = rollouts(pinned, arm, [Draw(voltage=1.0), Draw(voltage=0.8)], mode="pinned")
    droop = [np.abs(r.hinges[-1] - arm.qpos[-1, OP3.qpos_index]).max() for r in (full, low)]
    assert droop[1] / droop[0] == pytest.approx(1 / 0.8, rel=0.05)
    assert pinned.model.actuator_gainprm[0, 0] == plant_of(OP3, "pinned").model.actuator_gainprm[0, 0]


def test_feet_sink_deeper_into_a_soft_floor():
    hard, soft = rollouts(FREE, STAND, [Draw(floor=0.004), Draw(floor=0.012)])
    assert soft.qpos[-1, 2] < hard.qpos[-1, 2] - 3e-5


def test_many_worlds_at_once_come_out_as_one_by_one_and_in_order():
    worlds = draws(4, seed=1)
    together = rollouts(FREE, STAND, worlds, threads=4)
    alone = [rollouts(FREE, STAND, [world], threads=1)[0] for world in worlds]
    assert all(np.array_equal(a.qpos, b.qpos) for a, b in zip(together, alone, strict=True))


@pytest.mark.parametrize(("chance", "passes"), [(0.3, 0.229), (0.5, 0.036)])
def test_draws_that_stop_early_pass_a_motion_as_often_as_stated_and_never_change_a_decided_verdict(chance, passes):
    """Every sequence of ten falls and stands, by its probability."""
    total = 0.0
    for worlds in itertools.product((False, True), repeat=10):
        seen = worlds if not is_decided(worlds[:5], 10, 0.1) else worlds[:5]
        fails = sum(seen) > 0.1 * len(seen)
        assert fails == (sum(worlds) > 1) or not any(worlds[:5])
        total += 0.0 if fails else chance ** sum(worlds) * (1 - chance) ** (10 - sum(worlds))
    assert total == pytest.approx(passes, abs=5e-4)
