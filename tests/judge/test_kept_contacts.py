"""Planned contacts with bodies: which a simulation keeps, and what the verdict says of those that are missing."""

from dataclasses import replace

import numpy as np
import pytest

import robot_retarget as rr
from robot_retarget.judge.playback import Rollout, roll_out
from robot_retarget.judge.rollout import plant_of, simulate
from robot_retarget.judge.stance import contact_figures, missed_steps, planned_touches
from robot_retarget.judge.verdict import Thresholds, judge
from robot_retarget.robot.kinematics import world_points
from robot_retarget.robot.support import feet_of
from robot_retarget.scene.scene import RigidBody, Scene
from robot_retarget.scene.shape import ShapeKind, solid

OP3 = rr.load_robot("op3")
RISE = 0.03
SOLES = world_points(OP3, feet_of(OP3).soles, OP3.standing()[None])[0]


def standing(gap: float = 1e-4) -> rr.Trajectory:
    """The OP3 stands still for a second, over a block by a gap [m]."""
    qpos = np.tile(OP3.standing(), (31, 1))
    qpos[:, OP3.root_address + 2] += RISE + gap - SOLES[:, 2].min()
    block = RigidBody("block", solid(ShapeKind.BOX, (0.3, 0.3, RISE)), np.array([0, 0, RISE / 2, 1, 0, 0, 0]))
    return rr.Trajectory(qpos, 30.0, OP3.joint_names, OP3.name, scene=Scene((block,)))


def rolled(trajectory: rr.Trajectory) -> tuple[Rollout, dict]:
    plant = plant_of(OP3, "free", scene=trajectory.scene)
    rollout = roll_out(plant, trajectory, "free")
    return rollout, contact_figures(plant.bodies, rollout, OP3, trajectory, None)


def test_feet_that_stand_on_a_block_keep_their_contacts() -> None:
    _, figures = rolled(standing())
    assert figures["body_contacts_lost"] == 0.0 and figures["lost_contact"] is None
    assert {(line["foot"], line["body"], line["kept"]) for line in figures["body_contacts"]} == {
        ("l", "block", 1.0), ("r", "block", 1.0),
    }  # fmt: skip
    assert not missed_steps(figures)


def test_a_plan_touches_within_a_millimetre_and_for_longer_than_a_moment() -> None:
    assert [(touch.first, touch.last) for touch in planned_touches(OP3, standing(gap=0.0009))] == [(0, 30)] * 2
    assert not planned_touches(OP3, standing(gap=0.0011))
    lifted, qpos = standing(gap=0.003), standing().qpos
    brief = lifted.qpos.copy()
    brief[10:14] = qpos[10:14]
    assert not planned_touches(OP3, replace(lifted, qpos=brief))


def test_a_foot_that_never_touches_its_block_misses_it_with_its_time() -> None:
    trajectory = standing()
    plant = plant_of(OP3, "free", scene=trajectory.scene)
    rollout = roll_out(plant, trajectory, "free")
    left = feet_of(OP3).bodies[0]
    gone = np.isin(rollout.around.bodies[:, 0], list(left)) & (rollout.times[rollout.around.frame] > 0.3)
    figures = contact_figures(plant.bodies, replace(rollout, around=rollout.around.of(~gone)), OP3, trajectory, None)
    (reason,) = missed_steps(figures)
    assert figures["lost_contact"].split()[0] in [OP3.model.body(body).name for body in left]
    before = contact_figures(plant.bodies, replace(rollout, around=rollout.around.of(~gone)), OP3, trajectory, 0.4)
    assert before["body_contacts_lost"] == 0.0, "what a robot misses after it fell does not count"
    assert reason.startswith("the left foot misses block at 0.")
    assert float(reason.split()[-2]) == pytest.approx(0.3 + 0.15, abs=0.07)  # the last contact, and `LATE`
    assert 0.2 < figures["body_contacts_lost"] < 0.4 and "leaves block" in figures["lost_contact"]


@pytest.mark.parametrize("kept", [0.49, 0.51])
def test_a_foot_misses_a_step_on_which_it_stands_for_less_than_half_of_its_time(kept: float) -> None:
    line = {"foot": "l", "body": "step", "kept": kept, "lost_s": 1.0}
    assert bool(missed_steps({"body_contacts": [line]})) == (kept < 0.5)
    assert not missed_steps({"body_contacts": [{**line, "foot": None}]})


def test_the_verdict_names_contacts_that_are_missing_and_its_threshold_can_be_changed() -> None:
    report = simulate(standing(), OP3, mode="free", draws=0, others=False)
    assert report.verdict == "pass" and report.figures["body_contacts_lost"] == 0.0
    figures = {**report.figures, "body_contacts_lost": 0.5, "lost_contact": "l_el_link leaves box, first at 2.0 s"}
    (reason,) = judge(figures, Thresholds())
    assert reason == "50 % of the planned contacts with bodies are missing: l_el_link leaves box, first at 2.0 s"
    assert not judge(figures, Thresholds(body_contacts_lost=0.6))


def test_a_trajectory_without_bodies_has_no_such_figures() -> None:
    trajectory = replace(standing(), scene=None)
    assert not planned_touches(OP3, trajectory) and not rolled(trajectory)[1]
