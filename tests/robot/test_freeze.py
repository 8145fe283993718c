"""Frozen joints keep their angle, in a clip, a stream, a balanced playback and a map file."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from made_trajectories import hold, swing
from shared_files import ROOT

import robot_retarget as rr
from robot_retarget.base.choices import Balance
from robot_retarget.base.errors import TrajectoryError, UsageError
from robot_retarget.robot import Robot, recognise
from robot_retarget.robot.model import assumed_speed_notes
from robot_retarget.robot.override import held

SAMPLES = ROOT / "samples"


def off(trajectory: rr.Trajectory, robot: Robot, joint: str, angle: float) -> float:
    """The largest distance of a joint from an angle [rad]."""
    return float(np.abs(trajectory.qpos[:, robot.qpos_index[robot.joint_names.index(joint)]] - angle).max())


def test_a_frozen_waist_stands_while_the_human_bows() -> None:
    free = rr.load_robot("g1_class")
    robot = rr.freeze(free, ["waist_*", "left_wrist_roll_joint=0.3"])
    moved, held = (
        rr.retarget(SAMPLES / "hips_and_bow.bvh", each, fps=10, balance="off").trajectory for each in (free, robot)
    )
    assert off(moved, free, "waist_pitch_joint", 0.0) > 0.1
    assert off(held, robot, "waist_pitch_joint", 0.0) == 0 and off(held, robot, "left_wrist_roll_joint", 0.3) < 1e-9


def test_arms_alone_move_in_a_balanced_playback_and_the_rest_stands() -> None:
    robot = rr.freeze(rr.load_robot("op3"), only="arms")
    qpos = rr.retarget(SAMPLES / "wave.bvh", robot, fps=10, balance="static", legs="stand").trajectory.qpos
    arms = np.array(["sho" in name or name.endswith("_el") for name in robot.joint_names])
    assert np.ptp(qpos[:, robot.qpos_index[~arms]], axis=0).max() == 0
    assert np.ptp(qpos[:, robot.qpos_index[arms]], axis=0).max() > 1
    assert np.ptp(qpos[:, :3], axis=0).max() < 2e-3


@pytest.mark.parametrize("part", ["arms", "upper"])
@pytest.mark.parametrize("arms", [0, 1])
def test_a_robot_without_two_arms_is_told_that_no_part_is_left(part: str, arms: int, tmp_path: Path) -> None:
    spec = rr.load_robot("op3").spec()
    for name in ("l_sho_pitch_link", "r_sho_pitch_link")[arms:]:
        spec.delete(spec.body(name))
    for element in [*spec.actuators, *spec.sensors, *spec.keys, *spec.excludes]:
        spec.delete(element)
    (tmp_path / "armless.xml").write_text(spec.to_xml())
    with pytest.raises(UsageError, match=f"only '{part}': armless has no two arms .*--freeze"):
        rr.freeze(rr.load_robot(str(tmp_path / "armless.xml")), only=part)


def test_joints_at_an_assumed_speed_are_named_and_those_at_a_stated_one_are_not() -> None:
    robot = rr.load_robot("g1_class")
    assumed = replace(robot, max_speed=np.full(len(robot.joint_names), 10.0))
    angles = np.zeros((3, len(robot.joint_names)))
    angles[1, 4] = 10 / 30 - 1e-6
    (note,) = assumed_speed_notes(assumed, angles, 30.0)
    assert note.startswith(f"{robot.joint_names[4]}: at 10 rad/s, a bound that is assumed") and "limits.toml" in note
    assert not assumed_speed_notes(assumed, 0.9 * angles, 30.0)
    assert not assumed_speed_notes(replace(robot, max_speed=assumed.max_speed + 2), angles, 30.0)


def test_a_stream_holds_frozen_joints() -> None:
    robot, motion = rr.freeze(rr.load_robot("op3"), ["head_*", "l_el=-0.4"]), rr.read_motion(SAMPLES / "wave.bvh")
    stream = rr.Stream(robot, motion.skeleton)
    turns = motion.rotations
    poses = [
        stream.push(motion.positions[t], None if turns is None else turns[t], time=t / motion.fps) for t in range(60)
    ]
    elbow = robot.qpos_index[robot.joint_names.index("l_el")]
    assert poses[-1].qpos[elbow] == pytest.approx(-0.4, abs=1e-9)


def test_a_joint_of_a_stream_follows_a_file_from_its_first_frame_on(tmp_path: Path) -> None:
    op3, motion = rr.load_robot("op3"), rr.read_motion(SAMPLES / "wave.bvh").resample(30)
    turning = swing(op3, "head_pan", 0.4, 0.5, 3.0)
    turning.save(tmp_path / "turn.npz")
    robot = rr.freeze(op3, [f"head_pan={tmp_path / 'turn.npz'}"])
    stream = rr.Stream(robot, motion.skeleton, calibration=motion.frames(0, 30), native=False)
    pan, turns = robot.qpos_index[robot.joint_names.index("head_pan")], motion.rotations
    assert turns is not None
    found = [stream.push(motion.positions[t], turns[t], time=7 + t / 30).qpos[pan] for t in range(40)]
    at = np.interp(np.arange(40) / 30, np.arange(len(turning)) / turning.fps, turning.qpos[:, pan])
    np.testing.assert_allclose(found, at, atol=1e-9)


def test_a_map_file_freezes_too(tmp_path: Path) -> None:
    (tmp_path / "map.toml").write_text('[robot]\nfreeze = ["head_*=0.1"]\n')
    result = rr.retarget(SAMPLES / "wave.bvh", "op3", fps=10, balance="off", overrides=tmp_path / "map.toml")
    assert off(result.trajectory, result.robot, "head_pan", 0.1) < 1e-9


@pytest.mark.parametrize("balance", ["off", "static"])
def test_joints_follow_the_motion_of_a_file(balance: Balance, tmp_path: Path) -> None:
    """At every frame the angle of the file at the time of the human's motion, which balance slows down."""
    op3 = rr.load_robot("op3")
    turning = swing(op3, "head_pan", 0.4, 0.5, 3.0, fps=50)
    turning.save(tmp_path / "turn.npz")
    robot = rr.freeze(op3, [f"head_pan={tmp_path / 'turn.npz'}", "head_tilt=0.1"])
    motion = rr.read_motion(SAMPLES / "wave.bvh").frames(0, 24)
    made = rr.retarget(motion, robot, balance=balance, legs="stand" if balance == "static" else "auto").trajectory
    pan = robot.qpos_index[robot.joint_names.index("head_pan")]
    expected = 0.4 * np.sin(np.pi * (made.source_time - made.source_time[0]))
    np.testing.assert_allclose(made.qpos[:, pan], expected, atol=5e-3)
    assert off(made, robot, "head_tilt", 0.1) < 1e-9
    again = held(rr.Trajectory(0 * turning.qpos + robot.standing(), 50, op3.joint_names, "op3"), robot)
    np.testing.assert_allclose(again.qpos[:, pan], turning.qpos[:, pan], atol=1e-12)


def test_a_file_without_the_joint_is_named(tmp_path: Path) -> None:
    other = rr.load_robot("g1_class")
    hold(other).save(tmp_path / "g1.npz")
    with pytest.raises(TrajectoryError, match="freeze head_pan: the trajectory lacks this joint"):
        rr.freeze(rr.load_robot("op3"), [f"head_pan={tmp_path / 'g1.npz'}"])


def test_keypoints_do_not_depend_on_what_is_frozen() -> None:
    robot = rr.load_robot("g1_class")
    assert recognise(rr.freeze(robot, ["*_elbow_*", "*_hip_*=0.0"])) is recognise(robot)


@pytest.mark.parametrize(
    ("joints", "message"),
    [
        (["wrist_*"], r"fits no joint of op3; .*r_sho_pitch"),
        (["head_pan=9"], r"head_pan=9: outside its range"),
        (["head_pan=left"], "expected an angle in radians or a trajectory"),
    ],
)
def test_what_cannot_be_frozen_is_named(joints: list[str], message: str) -> None:
    with pytest.raises(UsageError, match=message):
        rr.freeze(rr.load_robot("op3"), joints)
