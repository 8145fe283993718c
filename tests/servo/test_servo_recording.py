"""A motion that a person makes with a robot's joints is recorded: the emulator's shafts are turned from outside meanwhile."""

import os
from collections.abc import Callable, Iterator
from pathlib import Path
from threading import Timer

import numpy as np
import pytest
from emulated import ARM, Emulated, emulated
from test_servo_play import assert_match

from robot_retarget.actuators.map import load_map
from robot_retarget.base.errors import ServoError
from robot_retarget.robot import load_robot, recognise
from robot_retarget.robot.anatomy import joints_by_limb
from robot_retarget.servo.outcome import PlaybackEnd, PlaybackOptions, PlaybackOutcome
from robot_retarget.servo.recording import RECORDED_RATE, HandTake, limp_joints, record

LOCKSTEP = PlaybackOptions(lockstep=True)
STEP = 2 * np.pi / 4096
"""Of the encoder [rad]."""


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Emulated]:
    with emulated(tmp_path_factory.mktemp("bus"), ARM, "--lockstep", f"{RECORDED_RATE:g}") as emulator:
        yield emulator


@pytest.fixture
def emulator(running: Emulated) -> Emulated:
    """A bus as new, the arm in the middle."""
    running.do("reset")
    running.spread(ARM, (0.0, 0.0, 0.0, 0.0))
    return running


def swing(k: int) -> float:
    """Where the hand has joint j2 at a pose [rad]: 0.5 rad at 1 Hz, from rest."""
    return 0.25 * (1 - np.cos(2 * np.pi * k / RECORDED_RATE))


def turned(
    emulator: Emulated, folder: Path, poses: int, act: Callable[[], object] = lambda: None, countdown: int = 0
) -> tuple[HandTake, PlaybackOutcome]:
    """Record j2 while a hand turns it, and do something at the beginning of the take."""

    def say(text: str) -> None:
        if text.startswith("recording"):
            now = emulator.do("state")["time"]
            for k in range(poses):
                emulator.do(f"after {now + (k + 0.5) / RECORDED_RATE} place 2 {ARM['j2'].ticks(swing(k))}")
            act()

    end = None if poses > 80 else poses / RECORDED_RATE
    return record(ARM, emulator.port, ["j2"], end, countdown, LOCKSTEP, folder / "record.npz", say)


def test_the_motion_of_a_hand_comes_back_within_a_step_and_the_others_hold(emulator: Emulated, tmp_path: Path) -> None:
    emulator.do("torque 3")
    take, outcome = turned(emulator, tmp_path, 60, countdown=1)
    assert (outcome.ended, outcome.state, outcome.exit_code) == (PlaybackEnd.FINISHED, "hold", 0), outcome.reason
    assert "torque is as before: on in 1 of 4 servos" in outcome.reason
    hand = np.array([swing(k) for k in range(60)])
    shift = int(np.argmin([np.abs(take.angles[s : s + 50, 1] - hand[:50]).max() for s in range(6)]))
    same = take.angles[shift : shift + 55, 1], hand[:55]
    assert np.abs(same[0] - same[1]).max() <= STEP / 2 + 1e-9
    smooth = take.smoothed().angles[shift : shift + 55, 1]
    assert np.abs(smooth - hand[:55])[5:-5].max() <= STEP
    assert np.abs(take.angles[:, [0, 2, 3]]).max() < 2 * STEP
    seen = emulator.servos()
    assert [seen[k]["torque_enable"] for k in ARM.ids] == [0, 0, 1, 0]


def test_a_limp_joint_gets_no_goal(emulator: Emulated, tmp_path: Path) -> None:
    written = []
    turned(emulator, tmp_path, 20, lambda: written.append(emulator.servos()[2]["goals"]))
    assert emulator.servos()[2]["goals"] == written[0]
    assert emulator.servos()[1]["goals"] > written[0] + 15


FAULTS = {
    "heat 2 75": ("hot; torque is as before: on in 1 of 4 servos", [1, 0, 0, 0]),
    "silent 3": (r"j3 \(servo 3\) no longer answers", [1, 0, None, 0]),
    "supply 9.2": (r"supply is 9\.2 V|input voltage", [1, 0, 0, 0]),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_after_a_fault_the_take_is_kept_and_torque_is_as_before(emulator: Emulated, tmp_path: Path, fault: str) -> None:
    emulator.do("torque 1")
    take, outcome = turned(
        emulator, tmp_path, 40, lambda: emulator.do(f"after {emulator.do('state')['time'] + 0.4} {fault}")
    )
    reason, torque = FAULTS[fault]
    assert outcome.ended is PlaybackEnd.FAULT and outcome.exit_code == 1
    assert_match(reason, outcome.reason)
    assert 15 <= len(take.angles) < 40
    emulator.do("heard all")
    seen = emulator.servos()
    assert [t in (None, seen[k]["torque_enable"]) for k, t in zip(ARM.ids, torque, strict=True)] == [True] * 4


def test_a_pulled_cable_keeps_the_take(emulator: Emulated, tmp_path: Path) -> None:
    act = lambda: emulator.do(f"after {emulator.do('state')['time'] + 0.4} unplug")  # noqa: E731
    take, outcome = turned(emulator, tmp_path, 40, act)
    assert (outcome.ended, outcome.state) == (PlaybackEnd.LOST, "watchdog") and len(take.angles) > 15
    emulator.do("plug")


@pytest.mark.parametrize(("number", "ended"), [(2, PlaybackEnd.FINISHED), (15, PlaybackEnd.INTERRUPTED)])
def test_ctrl_c_and_sigterm_end_a_take(emulator: Emulated, tmp_path: Path, number: int, ended: PlaybackEnd) -> None:
    emulator.do("torque all")
    take, outcome = turned(emulator, tmp_path, 100, Timer(0.1, lambda: os.kill(os.getpid(), number)).start)
    assert outcome.ended is ended and outcome.state == "hold", outcome.reason
    assert all(servo["torque_enable"] for servo in emulator.servos().values())
    assert (tmp_path / "record.npz").is_file() and len(take.angles) > 1


def test_a_limb_means_its_joints() -> None:
    robot, op3 = load_robot("op3"), load_map("op3")
    limbs = joints_by_limb(robot, recognise(robot))
    arm = limp_joints(op3, ["l_arm"], limbs)
    assert sorted(arm) == ["l_el", "l_sho_pitch", "l_sho_roll"] == sorted(limp_joints(op3, ["left_arm"], limbs))
    assert limp_joints(op3, ["l_kn*", "head_pan"], limbs) == [j for j in op3.joints if j in ("l_knee", "head_pan")]
    with pytest.raises(ServoError, match="no joint and no limb 'tail'; "):
        limp_joints(op3, ["tail"], limbs)
