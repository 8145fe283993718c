"""Poses become lines, targets of emulated ones: nothing beyond a limit, no jump over the cap."""

import io
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from made_trajectories import wander
from performers import Answer, Swing, clip

from robot_retarget.actuators.map import Servo, ServoMap, load_map
from robot_retarget.base.errors import MotionError, ServoError
from robot_retarget.graph.track import Status
from robot_retarget.live.frame import FaultCounter
from robot_retarget.live.loop import Loop
from robot_retarget.live.sinks import LineSink, ServoSink, run_servos
from robot_retarget.live.sources import Replay, load_calibration, save_calibration
from robot_retarget.robot import load_robot
from robot_retarget.robot.contacts import replay_contacts
from robot_retarget.servo.cycle import Guard
from robot_retarget.servo.link import JointScale
from robot_retarget.servo.play import emulator_process

OP3 = load_robot("op3")


def test_a_line_holds_the_pose_and_whose_it_is() -> None:
    out = io.StringIO()
    LineSink(out).show(Answer(OP3.standing(), 1.25, Status.CONVERGED, 0.004))
    row = json.loads(out.getvalue())
    assert row["time"] == 1.25 and row["status"] == "converged" and row["age"] == 0.004
    assert np.allclose(row["qpos"], OP3.standing(), atol=1e-6)


def test_a_motion_file_goes_by_in_real_time_and_frames_overdue_are_dropped() -> None:
    motion = clip(fps=60).frames(0, 60)
    source, times = Replay(motion, FaultCounter(), speed=2.0), []
    import time

    began = time.monotonic()
    while not source.ended:
        frame = source.newest(0.1)
        if frame is not None:
            times.append(frame.time)
            assert source.began is not None
            assert np.allclose(frame.positions, motion.positions[round((frame.time - source.began) * 120)])
        if len(times) == 10:
            time.sleep(0.1)
    assert time.monotonic() - began > 0.45
    assert source.dropped >= 10 and len(times) + source.dropped == 60


def test_a_map_of_other_joints_is_refused_with_their_names() -> None:
    with pytest.raises(ServoError, match="does not cover head_pan"):
        ServoSink(OP3, ServoMap("x", (Servo("l_el", 1, "XM430-W350"),)))
    with pytest.raises(ServoError, match="tail"):
        ServoSink(OP3, replace(load_map("op3"), servos=(*load_map("op3").servos, Servo("tail", 99, "XM430-W350"))))


def test_the_emulated_robot_with_its_weight_is_moved_within_every_limit(tmp_path: Path) -> None:
    servo_map = load_map("op3")
    patient = replace(servo_map.limits, approach_time=0.6, approach_speed=3.0, watchdog=2.0, silence=1.0)
    servo_map = replace(servo_map, limits=patient)  # a busy machine pauses for tenths of a second
    sink, source, log = ServoSink(OP3, servo_map), Replay(clip(), FaultCounter()), tmp_path / "play.npz"
    loop = Loop(source, lambda skeleton: Swing(OP3, skeleton), sink)
    with emulator_process(servo_map, "--physics") as port:
        outcome, tally = run_servos(loop, sink, servo_map, port, 3.0, log, lambda text: None)
    assert outcome.exit_code == 0 and outcome.state == "hold" and tally.frames > 30
    with np.load(log) as found:
        goal, present = found["goal"], found["present"]
        assert "play" in found["phases"][found["phase"]]
        low, high = np.array([servo.reach for servo in servo_map.servos]).T
        assert (goal >= low - 1e-9).all() and (goal <= high + 1e-9).all()
        assert np.abs(np.diff(goal, axis=0)).max() <= servo_map.limits.speed / 125 + 1e-9
        assert np.abs(goal[1:] - present[:-1]).max() <= servo_map.limits.jump + 1e-9


def test_goals_of_servos_keep_links_apart_whatever_the_stream_asks_for() -> None:
    servo_map = load_map("op3")
    sink, goals = ServoSink(OP3, servo_map), [OP3.standing()[OP3.qpos_index]]
    columns = [OP3.joint_names.index(joint) for joint in servo_map.joints]
    guard = Guard(JointScale(servo_map), servo_map.limits, goals[0][columns], sink.clear)
    stream = wander(OP3, 40, 10.0).qpos
    qpos = np.tile(OP3.standing(), (len(stream), 1))
    for k, pose in enumerate(stream):
        sink.show(Answer(pose, k / 10, Status.CONVERGED, 0.0))
        target = pose[OP3.qpos_index[columns]]
        goal = guard.aim(target, 0.1)
        guard.record(goal, target, goal, 0.1)
        qpos[k, OP3.qpos_index[columns]] = guard.goal
    assert (replay_contacts(OP3, stream).depth > 0.001).any()
    assert not (replay_contacts(OP3, qpos).depth > 0.001).any() and sink.guard.changed


def test_a_calibration_is_read_as_it_was_load_calibration(tmp_path: Path) -> None:
    motion = clip().frames(0, 60)
    for turned in (motion, replace(motion, rotations=None)):
        save_calibration(turned, tmp_path / "me.npz")
        found = load_calibration(tmp_path / "me.npz")
        assert found.skeleton.names == motion.skeleton.names and found.fps == motion.fps
        assert np.array_equal(found.positions, motion.positions)
        assert (found.rotations is None) == (turned.rotations is None)


def test_what_is_no_calibration_is_named(tmp_path: Path) -> None:
    np.savez(tmp_path / "other.npz", a=np.zeros(3))
    (tmp_path / "junk.npz").write_bytes(b"junk")
    for name in ("other.npz", "junk.npz", "nowhere.npz"):
        with pytest.raises(MotionError, match=name):
            load_calibration(tmp_path / name)
