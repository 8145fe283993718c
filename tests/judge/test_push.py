"""Pushes in randomised simulations, and the script that fits gains on them."""

from dataclasses import replace
from itertools import islice

import fit_feedback as fit
import mujoco
import numpy as np
import pytest
from made_trajectories import hold, swing
from pushes import largest_survived, pushed, survives, worlds_at_push

import robot_retarget as rr
from robot_retarget.judge.compensate import compensated
from robot_retarget.judge.feedback import with_feedback
from robot_retarget.judge.playback import Playback, roll_out
from robot_retarget.judge.rollout import plant_of
from robot_retarget.judge.worlds import Draw, draws

OP3 = rr.load_robot("op3")
PLANT = plant_of(OP3, "free")
STAND = hold(OP3, 0.2)


@pytest.mark.parametrize(("delay", "backlash"), [(0.002, 0.0), (0.012, 0.0), (0.012, 0.004)])
def test_a_world_without_a_push_is_the_simulation_that_is_judged(delay: float, backlash: float) -> None:
    plant, moving = plant_of(OP3, "free", backlash=backlash), swing(OP3, "l_sho_pitch", 0.3, 1.0, 0.5)
    goals = with_feedback(plant, moving, compensated(plant, moving, "free"))
    judged = roll_out(plant, moving, "free", Playback(delay=delay), goals)
    (start,) = worlds_at_push(plant, moving, [Draw(delay=delay)], feedback=True)
    for world in islice(pushed(start, np.zeros(3)), 60):
        assert np.array_equal(plant.places.configuration(world.data.qpos), judged.qpos[world.row - 1])


def test_a_push_leaves_the_world_it_starts_from_alone() -> None:
    (start,) = worlds_at_push(PLANT, STAND, draws(1), feedback=True)
    before, row = start.data.qpos.copy(), start.row
    survives(start, np.array([1.0, 0.0, 0.0]))
    assert np.array_equal(start.data.qpos, before) and start.row == row


def test_a_push_gives_the_robot_its_momentum() -> None:
    """On a floor without friction the impulse stays in the robot."""
    (start,) = worlds_at_push(PLANT, STAND, [Draw(friction=1e-3)], feedback=False)
    model, ticks = start.played.plant.model, round(0.1 * start.goals.rate)
    world = next(islice(pushed(start, np.array([0.3, 0.0, 0.0])), ticks - 1, None))
    mujoco.mj_forward(model, world.data)
    mujoco.mj_subtreeVel(model, world.data)
    speed = world.data.subtree_linvel[OP3.root_body][0]
    assert speed * model.body_mass.sum() == pytest.approx(0.3, rel=0.02)


def test_the_survived_impulse_is_that_of_a_rigid_body_on_its_edge() -> None:
    """J = m d √(g / h) within a third: d to the tip of the soles, h of the centre of mass."""
    (start,) = worlds_at_push(PLANT, STAND, [Draw()], feedback=False)
    data, model = start.data, start.played.plant.model
    com = data.subtree_com[OP3.root_body]
    tip = data.contact.pos[: data.ncon, 0].max()
    rigid = model.body_mass.sum() * (tip - com[0]) * np.sqrt(9.81 / com[2])
    assert largest_survived(start, np.array([1.0, 0.0, 0.0])) == pytest.approx(rigid, rel=0.33)


def test_fitted_joints_are_those_of_both_legs_in_pairs() -> None:
    pitch, roll = fit.leg_pairs(OP3, 1), fit.leg_pairs(OP3, 0)
    assert {frozenset(pair) for pair in pitch} == {
        frozenset((f"l_{name}", f"r_{name}")) for name in ("hip_pitch", "knee", "ank_pitch")
    }
    assert {frozenset(pair) for pair in roll} == {
        frozenset((f"l_{name}", f"r_{name}")) for name in ("hip_roll", "ank_roll")
    }


def test_gains_that_oscillate_are_told_from_those_that_stand() -> None:
    task = fit.Task(OP3, (hold(OP3, 2.0),), draws(1))
    wild = fit.with_gains(OP3, fit.leg_pairs(OP3, 1), np.array([0.3, 1.0, 0, 0, -0.3, -1.0]))
    assert task.oscillates(plant_of(wild, "free"))
    assert OP3.servo_map is not None and OP3.servo_map.balance is not None
    calm = replace(OP3, servo_map=replace(OP3.servo_map, balance=replace(OP3.servo_map.balance, joints={})))
    assert not task.oscillates(plant_of(calm, "free"))
