"""The digital twin stands on its floor and follows what is played on its servos."""

from dataclasses import replace

import numpy as np
import pytest
from shared_files import ROOT

from robot_retarget.actuators.control_tables import OVERLOAD
from robot_retarget.actuators.map import Servo, ServoMap, load_map
from robot_retarget.base.errors import ServoError
from robot_retarget.servo.emulator import scene_of
from robot_retarget.servo.emulator.device import rested
from robot_retarget.servo.emulator.world import World
from robot_retarget.servo.outcome import PlaybackEnd, PlaybackOptions
from robot_retarget.servo.play import play_emulated
from robot_retarget.servo.twin import Twin
from robot_retarget.trajectory import Trajectory

OP3 = load_map("op3")


def test_with_torque_on_the_robot_stands_when_the_hand_lets_go() -> None:
    twin = Twin(scene_of("op3"), OP3, support=0.2)
    devices = [rested(s.type, s.id, 4, s.zero) for s in OP3.servos]
    world = World(devices, twin)
    for device in devices:
        device.boot()
        device.write(64, b"\x01")
    for _ in range(40):
        world.advance(world.time + 0.05)
    assert not twin.held
    assert twin.state()["upright"] > 0.99 and twin.state()["height"] > 0.27


def test_without_torque_it_is_held_and_its_arms_sink() -> None:
    twin = Twin(scene_of("op3"), OP3)
    devices = [rested(s.type, s.id, 4, s.zero) for s in OP3.servos]
    world = World(devices, twin)
    for _ in range(20):
        world.advance(world.time + 0.05)
    assert twin.held and twin.state()["upright"] == pytest.approx(1)
    left = devices[OP3.joints.index("l_sho_roll")]
    assert left.motor.position - 2048 > 5


def test_a_joint_driven_against_its_stop_overloads_its_servo_and_no_other() -> None:
    twin = Twin(scene_of("op3"), OP3)
    devices = [rested(s.type, s.id, 4, s.zero) for s in OP3.servos]
    world = World(devices, twin)
    head = OP3.joints.index("head_pan")
    for device in devices:
        device.boot()
        device.write(64, b"\x01")
    devices[head].write(116, (4095).to_bytes(4, "little"))
    for _ in range(50):
        world.advance(world.time + 0.05)
    assert {device.id for device in devices if device.hardware} == {devices[head].id}
    assert not devices[head].torque and devices[head].registers["hardware_error_status"] == 1 << OVERLOAD


def test_a_servo_s_sense_is_the_joint_s_whatever_its_sign_and_zero() -> None:
    mirrored = ServoMap("op3", tuple(Servo(s.joint, s.id, s.model, -1, 1500) for s in OP3.servos))
    twin = Twin(scene_of("op3"), mirrored)
    twin.data.qpos[7:] = 0.1
    ticks, _ = twin.shafts()
    assert ticks == pytest.approx([s.zero + s.sign * 0.1 * 4096 / (2 * np.pi) for s in mirrored.servos])


def test_a_joint_that_the_model_lacks_is_named() -> None:
    with pytest.raises(ServoError, match="no joint 'tail' as the servo map has; known: root, head_pan"):
        Twin(ROOT / "models" / "op3" / "op3.xml", ServoMap("x", (Servo("tail", 1, "XM430-W350"),)))


def test_waving_arms_are_followed_on_the_emulated_robot() -> None:
    times = np.arange(0, 1.01, 0.02)
    names = tuple(reversed(OP3.joints))
    qpos = np.zeros((len(times), 27))
    qpos[:, 3] = 1
    qpos[:, 7 + names.index("l_el")] = 0.3 * np.sin(np.pi * times)
    hasty = replace(OP3, limits=replace(OP3.limits, approach_time=0.5))
    outcome = play_emulated(Trajectory(qpos, 50, names, "op3"), hasty, options=PlaybackOptions(end_pose=False))
    assert outcome.ended is PlaybackEnd.FINISHED, outcome.reason
    assert outcome.figures["tracking_rms_rad"] < 0.05
