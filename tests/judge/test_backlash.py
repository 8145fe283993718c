"""Backlash lies between servo and link: the link plays, the encoder and the goals do not know."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from made_trajectories import hold, robot_of, swing

from robot_retarget.base.errors import RobotError, UsageError
from robot_retarget.judge.build import build_plant
from robot_retarget.judge.compensate import compensated
from robot_retarget.judge.feedback import with_feedback
from robot_retarget.judge.plant import Plant
from robot_retarget.judge.playback import Playback, Rollout, roll_out
from robot_retarget.judge.rollout import plant_of, rollouts, simulate
from robot_retarget.judge.worlds import Draw, Spread, drawn, draws
from robot_retarget.robot import Robot, load_robot
from robot_retarget.trajectory import Trajectory

OP3 = load_robot("op3")
BACKLASH = np.radians(0.25)
STAND = hold(OP3, 0.5)
ARM = """<mujoco><option timestep="0.001" gravity="{gravity}" viscosity="{viscosity}" integrator="implicitfast"/>
<worldbody><body><joint name="elbow" axis="0 1 0" range="-90 90" armature=".01"/>
<geom type="capsule" fromto="0 0 0 .3 0 0" size=".02" mass=".5"/>{more}</body></worldbody>
<actuator><position joint="elbow" kp="{stiffness}" kv="2"/></actuator></mujoco>"""
"""A horizontal arm on a servo."""


def arm(
    folder: Path, gravity: str = "0 0 -9.81", viscosity: float = 0.0, stiffness: float = 50.0, more: str = ""
) -> Robot:
    mjcf = ARM.format(gravity=gravity, viscosity=viscosity, stiffness=stiffness, more=more)
    return robot_of(mjcf, folder / "arm.xml")


def played(plant: Plant, trajectory: Trajectory) -> tuple[Rollout, np.ndarray]:
    """A pinned rollout, and the play (N, n) of the joints [rad]."""
    found = roll_out(plant, trajectory, "pinned")
    return found, found.qpos[:, plant.robot.qpos_index] - found.hinges


def test_without_backlash_the_plant_is_the_plain_one() -> None:
    plain, none = plant_of(OP3, "free"), plant_of(OP3, "free", backlash=0.0)
    assert none.model.nq == OP3.model.nq
    assert np.array_equal(roll_out(plain, STAND, "free").qpos, roll_out(none, STAND, "free").qpos)


def test_goals_do_not_depend_on_backlash() -> None:
    moving = swing(OP3, "l_sho_pitch", 0.5, 1.0, 1.0)
    for mode in ("pinned", "free"):
        plain, loose = (compensated(plant_of(OP3, mode, backlash=b), moving, mode) for b in (0.0, BACKLASH))
        np.testing.assert_allclose(loose.angles, plain.angles, rtol=0, atol=1e-12)


def test_a_tiny_backlash_is_nearly_none() -> None:
    moving = swing(OP3, "l_sho_pitch", 0.5, 1.0, 1.0)
    plain, loose = (roll_out(plant_of(OP3, "free", backlash=b), moving, "free") for b in (0.0, 1e-5))
    assert np.abs(plain.qpos - loose.qpos).max() < 1e-3


def test_an_arm_under_gravity_rests_at_the_edge_of_its_play_and_the_servo_does_not_know(tmp_path: Path) -> None:
    """The droop of the shaft is τ / k = m g l cos q / k; the link is lower by the backlash."""
    robot = arm(tmp_path)
    found, play = played(build_plant(robot, "pinned", None, BACKLASH), hold(robot, 1.0))
    angle = float(found.hinges[-1, 0])
    assert play[-1, 0] == pytest.approx(BACKLASH, rel=0.01)
    assert angle == pytest.approx(0.5 * 9.81 * 0.15 * np.cos(angle + BACKLASH) / 50.0, rel=1e-3)
    plain, _ = played(build_plant(robot, "pinned"), hold(robot, 1.0))
    assert angle == pytest.approx(float(plain.hinges[-1, 0]), rel=1e-3)


def test_a_reversal_loses_twice_the_backlash(tmp_path: Path) -> None:
    """In a viscous medium the link lags on the way out and on the way back: its way back is shorter than the shaft's."""
    robot = arm(tmp_path, gravity="0 0 0", viscosity=50.0, stiffness=500.0)
    there_and_back = swing(robot, "elbow", 0.2, 0.25, 3.0)  # 0.2 at 1 s, −0.2 at 3 s
    found, _ = played(build_plant(robot, "pinned", None, BACKLASH), there_and_back)
    moving = (found.times > 0.5) & (found.times < 2.8)
    shaft, link = (angles[moving, 0] for angles in (found.hinges, found.qpos))
    way = np.ptp(shaft) - np.ptp(link)
    assert way == pytest.approx(2 * BACKLASH, rel=0.05)


def test_the_play_never_exceeds_the_backlash_by_more_than_its_stops_give() -> None:
    moving = swing(OP3, "l_knee", 0.3, 1.0, 1.0)
    _, play = played(plant_of(OP3, "pinned", backlash=BACKLASH), moving)
    assert 0.9 * BACKLASH < np.abs(play).max() < BACKLASH + np.radians(0.1)


def test_the_free_robot_stands_on_loose_joints_and_feedback_reads_its_root() -> None:
    plant = plant_of(OP3, "free", backlash=BACKLASH)
    goals = with_feedback(plant, STAND, compensated(plant, STAND, "free"))
    found = roll_out(plant, STAND, "free", command=goals)
    weight = 9.81 * OP3.model.body_mass.sum()
    assert found.ground[-20:, 2].mean() == pytest.approx(weight, rel=0.01)
    assert found.qpos.shape[1] == OP3.model.nq
    assert found.added is not None and np.abs(found.added).max() < 0.05


def test_drawn_backlash_scales_the_play_and_leaves_the_other_parameters_as_they_were() -> None:
    plant = plant_of(OP3, "free", backlash=BACKLASH)
    world, _ = drawn(plant, Draw(backlash=0.5), Playback())
    np.testing.assert_allclose(world.model.jnt_range[world.places.play], [[-BACKLASH / 2, BACKLASH / 2]] * 20)
    narrow, wide = draws(5), draws(5, spread=Spread(backlash=(1.0, 1.0)))
    assert [replace(d, backlash=1.0) for d in narrow] == list(wide)
    assert len({d.backlash for d in narrow}) == 5 and all(0.4 <= d.backlash <= 1.6 for d in narrow)
    (same,) = rollouts(plant, STAND, [Draw()])
    assert np.array_equal(same.qpos, roll_out(plant, STAND, "free").qpos)


def test_a_report_on_loose_joints_says_so() -> None:
    report = simulate(STAND, OP3, mode="free", draws=0, others=False, backlash=BACKLASH)
    assert report.verdict == "pass", report.reasons
    assert "backlash of ±0.25° in every joint" in report.figures["notes"]


@pytest.mark.parametrize("backlash", [-0.001, 0.2, np.nan])
def test_a_backlash_out_of_bounds_is_refused(backlash: float) -> None:
    with pytest.raises(UsageError, match="backlash must be 0"):
        simulate(STAND, OP3, backlash=backlash)


def test_a_body_with_two_hinges_is_refused_by_name(tmp_path: Path) -> None:
    double = '<body name="wrist" pos=".3 0 0"><joint axis="1 0 0"/><joint axis="0 1 0"/><geom size=".02"/></body>'
    robot = arm(tmp_path, more=double)
    with pytest.raises(RobotError, match="'wrist' has several hinges"):
        build_plant(robot, "pinned", None, BACKLASH)
