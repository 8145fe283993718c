"""What a simulation reports agrees with what servos, gravity and geometry must do."""

import json
from dataclasses import replace
from functools import partial
from typing import Any

import mujoco
import numpy as np
import pytest
from made_trajectories import RAIL, hold, robot_of, swing, wander
from scipy.spatial.transform import Rotation
from shared_files import SHARED, needs_shared

import robot_retarget as rr
from robot_retarget.base.errors import TrajectoryError, UsageError
from robot_retarget.base.untrusted.documents import content_sha256
from robot_retarget.judge.playback import Playback
from robot_retarget.judge.rollout import plant_of
from robot_retarget.judge.servo_model import drives_of
from robot_retarget.judge.verdict import Thresholds
from robot_retarget.robot import load_robot
from robot_retarget.trajectory import Trajectory, fingerprint

OP3 = load_robot("op3")
simulate = partial(rr.simulate, others=False)
"""On the modelled servos alone; `test_judges.py` has the others."""
KP = 800 / 128 * (4096 / (2 * np.pi)) / 885 * 4.1
"""Of an XM430-W350 at its factory gain, 12 V [N m/rad]."""
DAMPING, FRICTION = 1.084, 0.03
SLACK = FRICTION + 0.02 + KP * np.pi / 4096
"""Friction, the last of the swing, and half a tick."""


def leaned(degrees: float) -> np.ndarray:
    qpos = OP3.standing()
    qpos[3:7] = Rotation.from_euler("y", degrees, degrees=True).as_quat(scalar_first=True)
    return qpos


def test_a_static_stand_is_tracked_and_passes():
    report = simulate(hold(OP3, 1.0), OP3)
    assert report.verdict == "pass" and report.reasons == ()
    assert report.figures["tracking_max_rad"] < 0.05


def test_a_held_pose_droops_by_gravity_over_stiffness():
    pose = OP3.standing()
    report = simulate(hold(OP3, 1.0), OP3, compensate=False)
    data = mujoco.MjData(OP3.model)
    data.qpos[:] = pose
    mujoco.mj_forward(OP3.model, data)
    gravity = data.qfrc_bias[OP3.dof_index]  # what the servo must give at rest
    np.testing.assert_allclose(-KP * report.series["error"][-1], gravity, atol=SLACK)
    assert np.abs(gravity).max() > 2 * FRICTION


def test_a_pelvis_on_its_side_loads_the_limbs_sideways():
    side = OP3.standing()
    side[3:7] = Rotation.from_euler("x", 90, degrees=True).as_quat(scalar_first=True)
    data = mujoco.MjData(OP3.model)
    data.qpos[:] = side
    mujoco.mj_forward(OP3.model, data)
    error = simulate(hold(OP3, 1.0, qpos=side), OP3, compensate=False).series["error"][-1]
    np.testing.assert_allclose(-KP * error, data.qfrc_bias[OP3.dof_index], atol=SLACK)


def test_a_slow_sine_lags_by_damping_over_stiffness():
    report = simulate(swing(OP3, "l_sho_pitch", 0.4, 0.4, 5.0), OP3, compensate=False)
    assert report.figures["lag_s"] == pytest.approx(DAMPING / KP, rel=0.5)
    assert report.verdict == "pass"


def test_a_sine_beyond_the_servo_saturates_it_and_fails_by_name():
    moving = Playback(settle_before=0.0, settle_after=0.0)
    unbounded = replace(OP3, servo_map=None)  # a map would not let goals go so fast
    moved = swing(OP3, "l_sho_pitch", 1.2, 3.0, 2.0)
    report = simulate(moved, unbounded, drives=drives_of(OP3), playback=moving)
    assert (
        report.figures["joints"]["l_sho_pitch"]["saturated_share"] > 0.4
    )  # of a sine whose goals keep the map's speed
    assert report.figures["joints"]["r_sho_pitch"]["saturated_share"] == 0
    shoulder = report.figures["joints"]["l_sho_pitch"]
    assert 4.1 * 0.99 < shoulder["peak_torque_Nm"] < 2 * 4.1  # against its own back-EMF a motor gives more than at rest
    assert shoulder["peak_current_A"] == pytest.approx(shoulder["peak_torque_Nm"] * 2.3 / 4.1, rel=1e-3)
    assert report.figures["saturated_joint"] == "l_sho_pitch"
    assert report.verdict == "fail" and report.reasons[0].startswith("l_sho_pitch tracks")
    assert report.figures["speed_ratio_joint"] == "l_sho_pitch"
    top = 1.2 * 2 * np.pi * 3 / OP3.max_speed[OP3.joint_names.index("l_sho_pitch")]
    assert report.figures["speed_ratio"] == pytest.approx(top, rel=0.02)


def test_an_arm_through_the_trunk_is_reported_as_that_pair():
    inward = swing(OP3, "l_sho_roll", 0.9, 0.25, 4.0)
    report = simulate(inward, OP3)
    pairs = {tuple(pair["bodies"]): pair for pair in report.figures["self_contacts"]}
    assert {"body_link", "l_el_link"} == set(report.figures["self_contacts"][0]["bodies"])
    pair = pairs["body_link", "l_sho_roll_link"]
    assert pair["share"] == pytest.approx(pair["frames"] / len(inward), abs=1e-4)
    assert any("body_link and l_el_link overlap" in reason for reason in report.reasons)
    assert report.figures["self_contact_share"] > 0.2


def test_the_depth_of_two_spheres_is_what_geometry_says(tmp_path):
    """A ball on a 1 m arm swings down to a ball at the origin; the chord between them is 2 sin(angle / 2)."""
    balls = """<mujoco><worldbody><body name="base"><joint name="rail" type="slide" axis="1 0 0"/><geom size=".1"/>
    <body name="arm" pos="0 0 1"><joint name="swing" axis="0 1 0"/><geom size=".01" contype="0" conaffinity="0"/>
    <body name="ball" pos="1 0 0"><joint name="spin" axis="0 1 0"/><geom size=".08"/></body></body></body>
    </worldbody></mujoco>"""
    robot = robot_of(balls, tmp_path / "balls.xml")
    short_of_down = np.array([0.3, 0.1, 0.05, 0.3])
    qpos = np.column_stack([np.zeros(4), np.pi / 2 - short_of_down, np.zeros(4)])
    report = simulate(Trajectory(qpos, 10, robot.joint_names, robot.name), robot)
    (pair,) = report.figures["self_contacts"]
    assert (pair["bodies"], pair["frames"], pair["share"]) == (["base", "ball"], 2, 0.5)
    assert pair["depth_m"] == pytest.approx(0.18 - 2 * np.sin(0.05 / 2), abs=1e-5)


def test_bodies_that_overlap_in_the_reference_pose_are_left_out(tmp_path):
    """The same two balls, one of them so large that it is always within the other's reach."""
    balls = """<mujoco><worldbody><body name="base"><joint name="rail" type="slide" axis="1 0 0"/><geom size=".3"/>
    <body name="arm"><joint name="swing" axis="0 1 0"/><geom size=".01" contype="0" conaffinity="0"/>
    <body name="ball" pos=".2 0 0"><joint name="spin" axis="0 1 0"/><geom size=".08"/></body></body></body>
    </worldbody></mujoco>"""
    robot = robot_of(balls, tmp_path / "balls.xml")
    report = simulate(hold(robot, 0.1), robot)
    assert report.figures["self_contacts"] == [] and report.figures["self_contact_share"] == 0


def test_a_joint_beyond_its_range_fails_by_that_much():
    beyond = hold(OP3, 0.2).qpos.copy()
    elbow = OP3.joint_names.index("l_el")
    beyond[3, OP3.qpos_index[elbow]] = OP3.upper[elbow] + 0.25
    report = simulate(Trajectory(beyond, 50, OP3.joint_names, "op3"), OP3)
    assert report.figures["range_excess_rad"] == pytest.approx(0.25, abs=1e-5)
    assert "l_el leaves its range by 14.3°" in report.reasons


def test_a_stand_stays_up_on_its_own():
    report = simulate(hold(OP3, 3.0), OP3, mode="free", draws=0, others=True)
    assert report.verdict == "pass" and report.figures["fall_s"] is None


def test_soles_stand_on_a_hard_floor_only_where_there_is_one(tmp_path):
    """As 20 N drag a standing robot sideways, far below what friction holds, its soles stay where they are."""
    soft = OP3.path.read_text(encoding="utf-8").replace('solref="0.004 1"', 'solref="0.02 1"')
    path = tmp_path / "op3.xml"
    path.write_text(soft, encoding="utf-8")
    model = plant_of(load_robot(path), "free").model
    data = mujoco.MjData(model)
    data.qpos[:] = OP3.standing()
    data.ctrl[:] = OP3.standing()[OP3.qpos_index]
    foot = model.body("l_ank_roll_link").id
    for _ in range(1000):
        mujoco.mj_step(model, data)
    before = data.xpos[foot].copy()
    data.xfrc_applied[foot, 1] = 4.0
    for _ in range(1000):
        mujoco.mj_step(model, data)
    assert np.linalg.norm(data.xpos[foot] - before) < 2e-3


def test_a_robot_set_down_leaning_falls():
    report = simulate(hold(OP3, 1.0, qpos=leaned(30)), OP3, mode="free", draws=0)
    assert report.verdict == "fail" and report.figures["fall_s"] is not None
    assert report.reasons[0].startswith("fell: ")


def test_where_a_trajectory_floats_above_the_floor_does_not_matter():
    high = OP3.standing()
    high[2] += 0.7
    on_floor, in_air = (simulate(hold(OP3, 1.0, qpos=q), OP3, mode="free", draws=0) for q in (OP3.standing(), high))
    assert in_air.verdict == "pass"
    np.testing.assert_allclose(in_air.series["measured"], on_floor.series["measured"], atol=1e-3)


def test_a_fall_is_dated_within_the_trajectory():
    bow = hold(OP3, 4.0).qpos.copy()
    late = np.arange(len(bow)) > 100  # from 2 s on the hips tip the trunk forward
    for joint, angle in (("l_hip_pitch", -1.2), ("r_hip_pitch", 1.2), ("l_ank_pitch", -0.9), ("r_ank_pitch", 0.9)):
        bow[late, OP3.qpos_index[OP3.joint_names.index(joint)]] = angle
    report = simulate(Trajectory(bow, 50, OP3.joint_names, "op3"), OP3, mode="free", draws=0)
    assert 2.0 < report.figures["fall_s"] < 4.0


def test_the_report_of_a_simulation_is_the_contract_and_names_the_file(tmp_path):
    trajectory = wander(OP3)
    report = rr.simulate(trajectory.save(tmp_path / "t.npz"), OP3)
    kept = json.loads(report.save(tmp_path / "report.json").read_text(encoding="utf-8"))
    contract = ["verdict", "reasons", "figures", "trajectory_sha256", "robot", "version"]
    assert list(kept) == [
        *contract,
        "format_version",
        "unlike",
        "badge",
        "mode",
        "thresholds",
        "model",
        "cures",
        "report_sha256",
    ]
    assert kept["report_sha256"] == content_sha256(kept) != content_sha256(kept | {"verdict": "pass"})
    assert report.trajectory is not None
    path = report.trajectory.save(tmp_path / "t.npz")
    assert kept["trajectory_sha256"] == fingerprint(path) == simulate(trajectory, OP3).trajectory_sha256
    assert simulate(path, OP3).trajectory_sha256 == fingerprint(path)  # judged once more it stays as it is
    assert kept["figures"] == report.figures
    assert (kept["verdict"], kept["robot"]) == ("fail", "op3")


def test_two_simulations_agree_in_everything_but_their_pace():
    first, second = (simulate(wander(OP3), OP3) for _ in range(2))
    strip = [{k: v for k, v in r.figures.items() if k != "steps_per_second"} for r in (first, second)]
    assert strip[0] == strip[1]


def test_thresholds_decide_the_verdict():
    trajectory = swing(OP3, "l_sho_pitch", 0.4, 0.4, 2.0)
    assert simulate(trajectory, OP3).verdict == "pass"
    assert simulate(trajectory, OP3, compensate=False, thresholds=Thresholds(tracking_rms=0.01)).verdict == "fail"


def test_a_robot_without_servos_or_free_root_gets_servos_and_says_so(tmp_path):
    rail = robot_of(RAIL, tmp_path / "rail.xml")
    report = simulate(swing(rail, "shoulder, left", 0.3, 0.3, 3.0), rail)
    assert report.verdict == "pass"
    assert "no position servo on every joint" in report.figures["notes"][0]
    with pytest.raises(UsageError, match="free root"):
        simulate(hold(rail), rail, mode="free", draws=0)


def test_a_simulation_that_breaks_down_is_a_verdict_and_leaves_no_log(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    wild = RAIL.replace("</worldbody>", "</worldbody><actuator>").replace(
        "<actuator></mujoco>", '<actuator><position joint="shoulder, left" kp="1e12"/></actuator></mujoco>'
    )
    robot = robot_of(wild, tmp_path / "wild.xml")
    report = simulate(swing(robot, "shoulder, left", 0.5, 1, 1.0), robot)
    assert report.verdict == "fail" and "broke down" in report.reasons[0]
    assert report.figures["unstable_s"] is not None
    report.save(tmp_path / "report.json")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["report.json", "wild.xml"]


def test_an_unknown_mode_and_another_robot_are_refused():
    with pytest.raises(UsageError, match="'hover'; known: pinned, free"):
        simulate(hold(OP3), OP3, mode="hover")  # pyright: ignore[reportArgumentType]
    with pytest.raises(TrajectoryError, match="joint 0 is 'tail'"):
        simulate(Trajectory(hold(OP3).qpos, 50, ("tail", *OP3.joint_names[1:]), "lizard"), OP3)


@needs_shared
@pytest.mark.parametrize(
    "robot", ["unitree_g1", "unitree_h1", "booster_t1", "toddlerbot_2xc", "mujoco_humanoid", "robotis_op3"]
)
def test_other_robots_hold_their_stand_pinned(robot):
    """The rods of ToddlerBot's neck hold it as still as the servos hold the other joints."""
    loaded = load_robot(next((SHARED / "robots" / robot).glob("*.xml")))
    report = simulate(hold(loaded, 1.5), loaded, draws=0)
    assert report.figures["unstable_s"] is None
    error = np.abs(report.series["measured"] - report.series["wanted"])
    assert error[len(error) // 2 :].max() < 0.05
    assert report.figures["tracking_rms_rad"] < 0.05


def test_a_hinge_that_the_model_drives_not_gets_a_servo_by_name(tmp_path):
    """Fewer actuators than joints: the two of the elbows are taken out."""
    spec = mujoco.MjSpec.from_file(str(OP3.path))
    for element in [*spec.keys, *(a for a in spec.actuators if a.target in ("l_el", "r_el"))]:
        spec.delete(element)
    robot = robot_of(spec.to_xml(), tmp_path / "op3.xml")
    report = simulate(swing(robot, "l_el", 0.3, 0.3, 1.0), robot)
    assert any(note.startswith("the model has no position servo on l_el, r_el") for note in report.figures["notes"])
    assert report.figures["joints"]["l_el"]["rms_rad"] < 0.05


def test_a_floor_is_laid_where_the_scene_has_none():
    report = simulate(hold(OP3, 0.2), OP3, mode="free", draws=0)
    assert "the model has no floor: a plane z = 0 added" in report.figures["notes"]
    assert report.figures["support_share"] == {"l": 1.0, "r": 1.0}


def test_a_playback_out_of_reason_is_refused():
    wrongs: tuple[dict[str, Any], ...] = ({"rate": 0}, {"delay": -0.1}, {"settle_before": float("nan")})
    for wrong in wrongs:
        with pytest.raises(UsageError, match="must be a number of at least"):
            Playback(**wrong)
