"""Figures of standing, load, foresight and verdict against geometry, contact forces and hand-made cases."""

import re
from dataclasses import fields, replace
from functools import partial

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from judge.motions import at_times, bob, kick, lean
from made_trajectories import hold, robot_of, swing
from scipy.spatial.transform import Rotation
from shared_files import ROOT, SHARED, needs_shared

import robot_retarget as rr
from robot_retarget.actuators.motors import MOTORS
from robot_retarget.base.errors import RobotError, UsageError
from robot_retarget.collision import warnings_of
from robot_retarget.contact.stance import Stance, margins
from robot_retarget.judge.compensate import compensated
from robot_retarget.judge.figures import fall_figures
from robot_retarget.judge.playback import Playback, roll_out
from robot_retarget.judge.rollout import plant_of, rollouts
from robot_retarget.judge.servo_model import drives
from robot_retarget.judge.stance import floor_height, slip_distances, stance_of, zero_moment_point
from robot_retarget.judge.verdict import Thresholds, read_thresholds
from robot_retarget.judge.worlds import Draw
from robot_retarget.robot import load_robot
from robot_retarget.robot.support import feet_of, level_planes
from robot_retarget.trajectory import Trajectory

OP3 = load_robot("op3")
simulate = partial(rr.simulate, others=False)
"""On the modelled servos alone; `test_judges.py` has the others."""
FREE = plant_of(OP3, "free")


@given(st.integers(0, 10_000))
@settings(max_examples=40, deadline=None)
def test_the_margin_is_the_distance_to_the_nearest_edge(seed):
    """Brute force over all pairs of corners with every other corner on one side of their line."""
    rng = np.random.default_rng(seed)
    corners = rng.normal(size=(8, 2))
    place = rng.dirichlet(np.ones(8)) @ corners
    distances = []
    for a in corners:
        for b in corners:
            side = (corners - a) @ np.array([a[1] - b[1], b[0] - a[0]])
            if (a != b).any() and side.min() > -1e-12:
                distances.append(np.cross(np.append(b - a, 0), np.append(place - a, 0))[2] / np.linalg.norm(b - a))
    found = margins(place[None, None], corners[None], np.ones((1, 8), bool))[0, 0]
    assert found == pytest.approx(min(distances), abs=1e-9) and found > 0
    far = place + 100 * rng.normal(size=2)
    assert margins(far[None, None], corners[None], np.ones((1, 8), bool))[0, 0] < 0


def test_nothing_down_is_no_support():
    corners = np.zeros((1, 3, 2))
    assert np.isnan(margins(np.zeros((1, 1, 2)), corners, np.zeros((1, 3), bool))).all()


def test_the_grounds_wrench_is_the_sum_of_mujocos_contact_forces():
    """Independent: the simulation stepped by hand, every contact's force turned into the world and added up."""
    model, data = FREE.model, mujoco.MjData(FREE.model)
    moved = bob(1.0)
    data.qpos[:] = moved.qpos[0]
    data.ctrl[:] = FREE.controls(moved.qpos[:1, OP3.qpos_index])[0]
    mujoco.mj_step(model, data, 200)
    mujoco.mj_forward(model, data)
    wrench, force = np.zeros(6), np.zeros(6)
    for k in range(data.ncon):
        mujoco.mj_contactForce(model, data, k, force)
        contact = data.contact[k]
        if 0 not in model.geom_bodyid[contact.geom]:
            continue
        sign = -1.0 if model.geom_bodyid[contact.geom[1]] == 0 else 1.0
        turn = contact.frame.reshape(3, 3).T
        push, twist = sign * turn @ force[:3], sign * turn @ force[3:]
        wrench += np.concatenate([push, twist + np.cross(contact.pos, push)])
    body, root = OP3.root_body, data.qfrc_constraint[:6]
    turn = data.xmat[body].reshape(3, 3)
    ours = np.concatenate([root[:3], turn @ root[3:] + np.cross(data.xpos[body], root[:3])])
    assert wrench[2] > 20
    np.testing.assert_allclose(ours, wrench, atol=1e-6)


def test_the_zero_moment_point_of_a_slow_squat_is_the_planned_one_to_a_centimetre():
    """Planned: c − (z / g) c̈ of the trajectory's own centre of mass; simulated: where the ground pushes."""
    moved = bob()
    rollout = roll_out(FREE, moved, "free", Playback(settle_before=2.0), compensated(FREE, moved, "free"))
    data, com = mujoco.MjData(OP3.model), []
    for qpos in moved.qpos:
        data.qpos[:] = qpos
        mujoco.mj_kinematics(OP3.model, data)
        mujoco.mj_comPos(OP3.model, data)
        com.append(data.subtree_com[OP3.root_body].copy())
    com = np.array(com)
    planned = com - com[:, 2:] / 9.81 * np.gradient(np.gradient(com, 0.02, axis=0), 0.02, axis=0)
    times = np.arange(len(moved)) / moved.fps
    planes = level_planes(len(rollout.times), floor_height(FREE.model))
    zmp = zero_moment_point(rollout.ground, planes, FREE.model.body_mass.sum())
    quiet = (times > 0.3) & (times < times[-1] - 0.3)
    for axis in (0, 1):
        seen = np.interp(times, rollout.times, zmp[:, axis])
        assert np.abs(seen - planned[:, axis])[quiet].max() < 0.01


def test_a_standing_robots_centre_of_mass_lies_over_its_zero_moment_point():
    stance = stance_of(FREE, roll_out(FREE, hold(OP3, 2.0), "free"))
    assert stance is not None and stance.touching[-1].all()
    np.testing.assert_allclose(stance.zmp[-1], stance.com[-1], atol=2e-3)
    assert 0.02 < stance.com_margin[-1] < 0.1


def test_a_slip_begins_anew_where_a_foot_is_put_down():
    feet, points, down = feet_of(OP3), np.zeros((30, 16, 3)), np.ones((30, 16), bool)
    points[..., 0] = np.interp(np.arange(30), [0, 9, 14, 24], [0.0, 0.005, 0.1, 0.104])[:, None]
    down[10:14], nowhere, unknown = False, np.zeros((30, 2)), np.full(30, np.nan)
    stance = Stance(feet, np.arange(30) / 30, down[:, :2], points, down, nowhere, nowhere, unknown, unknown)
    assert len(feet.owner) == 16 and slip_distances(stance) == pytest.approx([0.005, 0.005])


def test_a_foot_pushed_over_ice_slips_and_one_on_the_ground_does_not():
    split = swing(OP3, "l_hip_roll", 0.3, 0.5, 1.0)
    stuck = stance_of(FREE, roll_out(FREE, hold(OP3, 1.0), "free"))
    (ice,) = rollouts(FREE, split, [Draw(friction=0.02)])
    slid = stance_of(FREE, ice)
    assert stuck is not None and slid is not None
    assert slip_distances(stuck).max() < 0.002 < 0.01 < slip_distances(slid).max()


def test_energy_is_work_and_heat_for_a_motor_that_lifts():
    """Over a whole lift: what the supply gives is at least the work done plus the heat of the windings."""
    figures = simulate(at_times(OP3, {"l_sho_roll": [0.0, -0.9]}, [0.0, 1.5]), OP3).figures
    joint = figures["joints"]["l_sho_roll"]
    heat = joint["rms_current_A"] ** 2 * 12 / 2.3 * figures["duration_s"]
    assert figures["energy_J"] > 0.9 * heat
    assert figures["work_J"] > 0
    assert joint["heat_ratio"] == pytest.approx((joint["rms_current_A"] / 0.46) ** 2, abs=2e-3)


def test_a_lean_of_30_degrees_without_balance_falls():
    report = simulate(lean(OP3, 30), OP3, mode="free", draws=0)
    assert report.verdict == "fail" and report.reasons[0].startswith("fell: ")
    assert not any("too soft" in reason for reason in report.reasons)
    assert report.figures["fall_s"] > 0 and report.figures["com_margin_m"] < 0


@needs_shared
def test_a_robot_of_which_only_the_feet_can_touch_the_floor_falls_all_the_same():
    toddler = load_robot(SHARED / "robots/toddlerbot_2xc/toddlerbot_2xc.xml")
    ends = [toddler.standing()[toddler.qpos_index[toddler.joint_names.index("left_hip_roll")]], 1.4]
    report = simulate(
        at_times(toddler, {"left_hip_roll": [*ends, ends[-1]]}, [0.0, 0.5, 3.0]), toddler, mode="free", draws=0
    )
    assert "sank to half its height" in report.reasons[0]
    assert 0 < report.figures["fall_s"] < 3 and report.figures["fall_body"] is None


def test_a_model_whose_root_has_its_frame_on_the_floor_has_not_fallen():
    still = hold(OP3, 0.5)
    rollout, height = roll_out(FREE, still, "free"), float(still.qpos[0, 2])
    down = np.eye(len(still.qpos[0]))[2] * (height + 0.03)
    lower = replace(rollout, qpos=rollout.qpos - down), OP3, replace(still, qpos=still.qpos - down)
    assert fall_figures(*lower)["fall_s"] is None
    sunk = np.where(rollout.times > 0.3, 0.7 * height, 0.0)[:, None] * np.eye(len(down))[2]
    assert fall_figures(replace(lower[0], qpos=lower[0].qpos - sunk), *lower[1:])["fall_s"] > 0.3


def test_ankles_softer_than_gravity_are_named_where_the_robot_falls(tmp_path):
    """Potential energy of the standing robot by MuJoCo, turned as a whole about its ankles: −d²E/dφ² is m g h."""
    spec = mujoco.MjSpec.from_file(str(ROOT / "models/g1_class/g1_class.xml"))
    for actuator in spec.actuators:
        if "ankle_pitch" in actuator.name:
            actuator.gainprm[0], actuator.biasprm[1] = 20.0, -20.0
    robot = robot_of(spec.to_xml(), tmp_path / "soft.xml")
    report = simulate(hold(robot, 3.0), robot, mode="free", draws=0)
    model, data = robot.model, mujoco.MjData(robot.model)
    energies, place = [], robot.standing()
    for turn in (-1e-3, 0.0, 1e-3):
        data.qpos[:] = place
        mujoco.mj_kinematics(model, data)
        ankle = data.xanchor[model.joint("left_ankle_pitch_joint").id].copy()
        tipped = Rotation.from_rotvec([0.0, turn, 0.0])
        data.qpos[:3] = ankle + tipped.apply(place[:3] - ankle)
        data.qpos[3:7] = (tipped * Rotation.from_quat(place[[4, 5, 6, 3]])).as_quat()[[3, 0, 1, 2]]
        mujoco.mj_kinematics(model, data)
        energies.append(-model.opt.gravity[2] * model.body_mass @ data.xipos[:, 2])
    assert report.figures["fall_s"] > 0 and report.figures["ankle_stiffness_Nm_rad"] == 40.0
    assert report.figures["tipping_stiffness_Nm_rad"] == pytest.approx(-np.diff(energies, 2)[0] / 1e-6, rel=1e-3)
    assert any("its ankles are too soft to stand on: 40 N m/rad" in reason for reason in report.reasons)


def test_a_kick_at_full_speed_falls_and_says_when():
    report = simulate(kick(OP3), OP3, mode="free", draws=0)
    assert report.verdict == "fail"
    assert report.reasons[0].startswith("fell: ") and 0 < report.figures["fall_s"] < 3
    assert simulate(kick(OP3), OP3).figures["unstable_s"] is None


def test_a_limb_through_the_trunk_names_the_pair_with_its_depth():
    report = simulate(swing(OP3, "l_sho_roll", 0.9, 0.25, 4.0), OP3)
    assert report.verdict == "fail"
    assert any(reason.startswith("body_link and l_el_link overlap by up to") for reason in report.reasons)


def test_ten_times_the_speed_asks_for_more_than_servos_have():
    calm = swing(OP3, "head_pan", 0.8, 0.4, 4.0)
    assert simulate(calm, OP3).verdict == "pass"
    quick = Trajectory(calm.qpos, 10 * calm.fps, calm.joint_names, calm.robot)
    report = simulate(quick, OP3)
    assert report.verdict == "fail"
    assert any("head_pan would have to turn 5" in reason for reason in report.reasons)


def test_a_step_through_the_hip_between_two_frames_is_seen():
    through = at_times(
        OP3, {"l_sho_roll": [1.45, 1.45], "l_sho_pitch": [0.9, -0.9], "l_el": [-0.7, -0.7]}, [0.0, 0.1], fps=10
    )
    report = simulate(through, OP3)
    figures = report.figures
    assert figures["self_contact_depth_m"] < figures["between_frames_depth_m"]
    assert any("pass through each other" in reason for reason in report.reasons)
    assert 0 < figures["between_frames_s"] < 0.1


def test_contacts_that_were_warned_of_count_as_foreseen():
    inward = swing(OP3, "l_sho_roll", 0.9, 0.25, 4.0)
    foreseen = simulate(inward, OP3, warnings=warnings_of(inward, OP3)).figures["foreseen"]
    assert foreseen["tracked_contacts"] > 0
    assert foreseen["tracked_contacts_foreseen"] == foreseen["tracked_contacts"]
    calm = simulate(hold(OP3, 0.5), OP3, warnings=warnings_of(hold(OP3, 0.5), OP3)).figures["foreseen"]
    assert (calm["tracked_contacts"], calm["warnings_fulfilled"], calm["median_lead_s"]) == (0, 0, None)


def test_thresholds_come_from_a_file_line_by_line(tmp_path):
    path = tmp_path / "strict.toml"
    path.write_text("tracking_rms = 0.01\nfoot_slip = inf\n")
    strict = read_thresholds(path)
    assert strict == Thresholds(tracking_rms=0.01, foot_slip=float("inf"))
    moved = swing(OP3, "l_el", 0.5, 0.5, 1.0)
    assert simulate(moved, OP3, compensate=False, thresholds=strict).verdict == "fail"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("slip = 1", "no threshold 'slip'; did you mean 'foot_slip'\\? known: tracking_rms, penetration"),
        ("foot_slip = 'far'", "the threshold foot_slip must be a number"),
        ("foot_slip = -1", "must be a number, 0 or more"),
        ("foot_slip", "not TOML"),
    ],
)
def test_a_threshold_file_with_a_mistake_is_refused_by_name(tmp_path, text, message):
    path = tmp_path / "wrong.toml"
    path.write_text(text)
    with pytest.raises((UsageError, RobotError), match=message):
        read_thresholds(path)


def test_a_robot_without_feet_still_gets_a_verdict(tmp_path):
    brick = robot_of(
        """<mujoco><worldbody><body name="brick" pos="0 0 .1"><freejoint/><geom type="box" size=".1 .1 .1" mass="1"/>
        <body name="flap" pos="0 0 .12"><joint name="flap" axis="0 1 0" range="-1 1"/>
        <geom type="box" size=".02 .02 .05" pos="0 0 .05" mass=".1"/></body></body></worldbody></mujoco>""".replace(
            'range="-1 1"', 'range="-57 57"'
        ),
        tmp_path / "brick.xml",
    )
    report = simulate(swing(brick, "flap", 0.2, 0.5, 1.0), brick, mode="free", draws=0)
    assert report.figures["fall_s"] is None and report.figures["foot_slip_m"] is None
    assert any("no feet" in note for note in report.figures["notes"])
    assert any("no floor" in note for note in report.figures["notes"])


def test_a_turned_robot_has_the_same_margins():
    """Facing elsewhere changes nothing that is measured against its own soles."""
    turned = hold(OP3, 1.0).qpos.copy()
    turn = Rotation.from_euler("z", 70, degrees=True)
    turned[:, :3] = turn.apply(turned[:, :3])
    turned[:, 3:7] = (turn * Rotation.from_quat(turned[:, 3:7], scalar_first=True)).as_quat(scalar_first=True)
    rounds = [hold(OP3, 1.0), Trajectory(turned, 50, OP3.joint_names, "op3")]
    first, second = (simulate(t, OP3, mode="free", draws=0).figures for t in rounds)
    assert first["com_margin_m"] == pytest.approx(second["com_margin_m"], abs=1e-3)


def test_the_documentation_has_the_thresholds_and_the_servos_as_they_are():
    page = (ROOT / "docs/simulation.md").read_text(encoding="utf-8")
    rows = dict(re.findall(r"^\| `(\w+)` \| ([\d.]+)", page, re.MULTILINE))
    for field in fields(Thresholds):
        said = float(rows[field.name])
        assert field.default in (said, said / 1000, said / 100), field.name
    for name, stiffness in re.findall(r"^\| (\S+) \|(?:[^|]*\|){5} ([\d.]+) \|", page, re.MULTILINE):
        if name in MOTORS:
            servo = drives([MOTORS[name]], np.ones(1))
            assert servo.stiffness[0] == pytest.approx(float(stiffness), abs=0.06)
