"""Compensated goals bring the joints where they should be: against forward dynamics, a QP solver and plain playback."""

import daqp
import mujoco
import numpy as np
import pytest
from judge.motions import bob
from made_trajectories import hold, robot_of, swing, wander
from shared_files import SHARED, needs_shared

from robot_retarget.actuators.map import load_map
from robot_retarget.judge.compensate import _rates, _spline, _torques, compensated, torque_limited_reference
from robot_retarget.judge.figures import at_frames
from robot_retarget.judge.playback import Playback, plain_goals, roll_out
from robot_retarget.judge.rollout import plant_of, simulate
from robot_retarget.robot import load_robot
from robot_retarget.trajectory import Trajectory

OP3 = load_robot("op3")
PINNED, FREE = plant_of(OP3, "pinned"), plant_of(OP3, "free")


def rms(plant, trajectory, mode, command=None, playback=None) -> float:
    error = at_frames(trajectory, OP3, roll_out(plant, trajectory, mode, playback, command)).error
    return float(np.sqrt((error**2).mean()))


def nod(joint: str, amplitude: float, hertz: float, seconds: float) -> Trajectory:
    """The standing pose with one joint going to `amplitude` [rad] and back, from rest to rest."""
    qpos = hold(OP3, seconds, 100).qpos.copy()
    phase = 2 * np.pi * hertz * np.arange(len(qpos)) / 100
    qpos[:, OP3.qpos_index[OP3.joint_names.index(joint)]] += amplitude * (1 - np.cos(phase)) / 2
    return Trajectory(qpos, 100, OP3.joint_names, "op3", "nod")


def test_the_torques_make_forward_dynamics_accelerate_as_wanted():
    """Independent of the inverse: MuJoCo's forward dynamics under these torques gives these accelerations back."""
    qpos = _spline(FREE, wander(OP3), 125.0)
    qvel, qacc = _rates(FREE.model, qpos, 125.0)
    data = mujoco.MjData(FREE.model)
    FREE.model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT | mujoco.mjtDisableBit.mjDSBL_ACTUATION
    try:
        for k in (20, 60):
            data.qpos[:], data.qvel[:], data.qacc[:] = qpos[k], qvel[k], qacc[k]
            mujoco.mj_inverse(FREE.model, data)
            data.qfrc_applied[:] = data.qfrc_inverse
            mujoco.mj_forward(FREE.model, data)
            np.testing.assert_allclose(data.qacc, qacc[k], atol=1e-6)
    finally:
        FREE.model.opt.disableflags &= ~int(
            mujoco.mjtDisableBit.mjDSBL_CONSTRAINT | mujoco.mjtDisableBit.mjDSBL_ACTUATION
        )


def test_standing_takes_the_torques_that_a_standing_simulation_shows():
    still = hold(OP3, 2.0)
    torque, speed = _torques(FREE, _spline(FREE, still, 125.0), 125.0, "free")
    shown = roll_out(FREE, still, "free", command=compensated(FREE, still, "free")).torque[-1]
    pitch = [OP3.joint_names.index(j) for j in ("l_knee", "r_knee", "l_hip_pitch", "r_hip_pitch")]
    assert np.abs(torque[50, pitch]).max() > 0.2
    np.testing.assert_allclose(torque[50, pitch], shown[pitch], atol=0.12)  # dry friction holds some of it
    assert np.abs(speed).max() < 1e-9


@pytest.mark.parametrize("hertz", [0.4, 0.8])
def test_a_swing_within_the_servos_means_is_tracked_ten_times_better(hertz):
    moved = nod("l_sho_pitch", 1.2, hertz, 5.0)
    assert rms(PINNED, moved, "pinned", compensated(PINNED, moved)) < 0.1 * rms(PINNED, moved, "pinned")


def test_a_swing_too_quick_for_the_servo_is_halved_by_leaving_early():
    moved = nod("l_sho_pitch", 1.2, 1.0, 4.0)
    assert rms(PINNED, moved, "pinned", compensated(PINNED, moved)) < 0.5 * rms(PINNED, moved, "pinned")


def test_a_squat_on_its_feet_goes_as_deep_as_it_should():
    moved = bob()
    assert rms(FREE, moved, "free", compensated(FREE, moved, "free")) < 0.2 * rms(FREE, moved, "free")


def test_the_delay_of_the_playback_is_made_up_for():
    moved, late = nod("l_el", 1.0, 0.5, 4.0), Playback(delay=0.02)
    blind, knowing = (compensated(PINNED, moved, playback=p) for p in (Playback(delay=0.0), late))
    assert rms(PINNED, moved, "pinned", knowing, late) < 0.4 * rms(PINNED, moved, "pinned", blind, late)


def test_goals_last_as_long_as_the_motion_and_its_settling_and_begin_and_end_at_rest():
    moved = nod("l_el", 1.0, 0.5, 4.0)
    goals = compensated(PINNED, moved, playback=Playback(settle_before=0.8, settle_after=0.4))
    assert (goals.rate, goals.lead_in, goals.lead_out) == (125, pytest.approx(0.8), pytest.approx(0.4))
    assert goals.duration == pytest.approx(moved.duration + 1.2)
    still = compensated(PINNED, hold(OP3, 1.0)).angles[0]
    for rest in (goals.angles[:100], goals.angles[-51:]):
        np.testing.assert_allclose(rest, np.tile(still, (len(rest), 1)), atol=1e-6)


def test_no_goal_leaves_the_servo_map_s_ranges_or_its_speed():
    """A swing beyond both; the bounds are those of the file."""
    servo_map = load_map("op3")
    quick = swing(OP3, "l_el", 1.6, 1.5, 2.0)
    for goals in (compensated(PINNED, quick), plain_goals(PINNED, quick)):
        speeds = np.abs(np.diff(goals.angles, axis=0)) * goals.rate
        assert 3.9 < speeds.max() <= servo_map.limits.speed * (1 + 1e-12)
        for joint, column in zip(OP3.joint_names, goals.angles.T, strict=True):
            assert servo_map[joint].lower <= column.min() and column.max() <= servo_map[joint].upper
        assert goals.servos == servo_map.fingerprint


def test_the_plant_is_not_changed_by_compensating():
    before = int(FREE.model.opt.disableflags)
    compensated(FREE, hold(OP3, 0.5), "free")
    assert FREE.model.opt.disableflags == before


def test_the_nearest_motion_within_the_torque_is_what_a_qp_solver_finds():
    count, dt, inertia, damping, bound = 60, 0.02, 0.05, 1.1, 1.5
    times = dt * np.arange(count)
    torque = 2.5 * np.sin(2 * np.pi * times / times[-1])
    rows = np.zeros((count, count))
    for k in range(count):
        for j, weight in ((k - 1, inertia / dt**2 - damping / 2 / dt), (k, -2 * inertia / dt**2),
                          (k + 1, inertia / dt**2 + damping / 2 / dt)):  # fmt: skip
            if 0 <= j < count:
                rows[k, j] = weight
    best, _, flag, _ = daqp.solve(np.eye(count), np.zeros(count), rows, bound - torque, -bound - torque)
    assert flag == 1 and np.abs(best).max() > 0.01
    found = torque_limited_reference(torque, bound, inertia, damping, dt)
    np.testing.assert_allclose(found, best, atol=0.03 * np.abs(best).max())
    assert not torque_limited_reference(torque, 3.0, inertia, damping, dt).any()


def test_the_report_tells_plain_and_compensated_tracking_apart():
    moved = nod("l_el", 1.0, 0.5, 2.0)
    plain, better = (simulate(moved, OP3, compensate=c, others=False).figures for c in (False, True))
    assert better["plain_tracking_rms_rad"] == plain["tracking_rms_rad"] > 5 * better["tracking_rms_rad"]
    assert plain["plain_tracking_rms_rad"] is None and not plain["compensated"]


@needs_shared
def test_a_robot_with_its_own_actuators_is_compensated_too():
    g1 = load_robot(SHARED / "robots/unitree_g1/unitree_g1.xml")
    moved = swing(g1, "left_shoulder_pitch_joint", 0.5, 0.5, 2.0)
    figures = simulate(moved, g1).figures
    assert figures["tracking_rms_rad"] < 0.2 * figures["plain_tracking_rms_rad"]


COUPLED = """<mujoco><option timestep="0.002" integrator="implicitfast"/><worldbody>
<body name="base"><geom size=".02"/><body name="first"><joint name="first" axis="0 1 0" range="-90 90" damping=".5"/>
<geom type="capsule" fromto="0 0 0 .3 0 0" size=".02" mass=".2" contype="0" conaffinity="0"/></body>
<body name="second" pos="0 .2 0"><joint name="second" axis="0 1 0" range="-90 90" damping=".1"/>
<geom type="capsule" fromto="0 0 0 .3 0 0" size=".02" mass="1" contype="0" conaffinity="0"/></body></body></worldbody>
{gear}<actuator><position joint="first" kp="40"/></actuator></mujoco>"""
EQUALITY = """<equality><joint joint1="second" joint2="first" polycoef="0 1 0 0 0" solref="0.004 1"/></equality>"""
TENDON = """<tendon><fixed limited="true" range="-.001 .001" solreflimit="0.004 1"><joint joint="first" coef="-1"/>
<joint joint="second" coef="1"/></fixed></tendon>"""


@pytest.mark.parametrize("gear", [EQUALITY, TENDON], ids=["equality constraint", "tendon without play"])
def test_a_servo_carries_what_is_geared_to_it(gear: str, tmp_path):
    """One servo, two arms geared one to one: it must hold the weight of both, m g l / 2 each."""
    robot = robot_of(COUPLED.format(gear=gear), tmp_path / "coupled.xml")
    plant = plant_of(robot, "pinned")
    assert plant.servos.tolist() == [0, -1]
    torque, _ = _torques(plant, np.zeros((5, 2)), 125.0, "pinned")
    assert torque[2, 0] == pytest.approx(-1.2 * 9.81 * 0.15, rel=1e-3) and torque[2, 1] == pytest.approx(0, abs=1e-9)
    still = hold(robot, 2.0)
    sagged, held = (roll_out(plant, still, "pinned", command=c) for c in (None, compensated(plant, still)))
    assert np.abs(held.hinges[-1]).max() < 0.1 * np.abs(sagged.hinges[-1]).max()
