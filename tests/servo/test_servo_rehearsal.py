"""An own robot is rehearsed on the scene in which it was judged; an emulator's name has one owner."""

from pathlib import Path

import numpy as np
import pytest
from emulated import ARM, emulated
from forked import run as call
from shared_files import ROOT

from robot_retarget.actuators.inertial import Reading, rest_faults
from robot_retarget.actuators.map import load_map
from robot_retarget.robot import load_robot
from robot_retarget.servo.bus import Bus
from robot_retarget.servo.protocol import sync_write
from robot_retarget.servo.twin import Twin

BARE = ROOT / "models" / "op3" / "op3.xml"
OP3 = load_map("op3")
STEPS = ("--lockstep", "100")


def test_a_model_without_a_floor_is_set_down_on_the_floor_of_its_simulation(tmp_path: Path) -> None:
    assert not (load_robot(str(BARE)).model.geom_type == 0).any()
    with (
        emulated(tmp_path, "op3", "--physics", "--model", str(BARE), "--lockstep", "125") as twin,
        Bus(twin.port, OP3.baud, lockstep=True) as bus,
    ):
        bus.send(sync_write(64, 1, [(i, b"\1") for i in OP3.ids]))
        goals = sync_write(116, 4, [(s.id, s.zero.to_bytes(4, "little")) for s in OP3.servos])
        for _ in range(250):
            bus.send(goals)
        body = twin.do("state")["body"]
    assert not body["held"]
    assert body["upright"] > 0.99 and body["height"] == pytest.approx(0.279, abs=0.01)


def test_a_robot_above_its_floor_is_let_go_only_on_it() -> None:
    spec = load_robot(str(BARE)).spec()
    spec.bodies[1].pos[2] += 0.2
    twin = Twin(spec, OP3, support=0.1)
    standing = [0.0] * len(OP3.servos)
    for _ in range(round(0.5 / twin.step)):
        twin.advance(standing, [True] * len(standing))
    assert twin.held and twin.state()["upright"] == pytest.approx(1)


def test_a_falling_robot_is_named_as_a_cause_of_a_small_weight() -> None:
    falling = [Reading(np.zeros(3), np.array([0.0, 0.01 * k, 1.6])) for k in range(3)]
    assert OP3.imu
    (fault,) = rest_faults(falling, OP3.imu, still=False)
    assert "1.6 m/s² at rest" in fault and "falls freely, without a floor" in fault


def test_the_link_of_a_living_emulator_is_not_taken_over(tmp_path: Path) -> None:
    with emulated(tmp_path, ARM, *STEPS) as first:
        second = call("servos", "emulate", "--map", "op3", "--link", first.port)
        assert second.returncode == 2
        assert f"{first.port} is the port of another emulator" in second.stderr
        with Bus(first.port, ARM.baud, lockstep=True) as bus:
            assert bus.ping(1) is not None
            assert call("servos", "emulate", "--map", "op3", "--link", first.port).returncode == 2
    assert not Path(first.port).is_symlink()
    with emulated(tmp_path, ARM, *STEPS) as again, Bus(again.port, ARM.baud, lockstep=True) as bus:
        assert bus.ping(1) is not None


def test_the_link_of_a_killed_emulator_is_taken_over(tmp_path: Path) -> None:
    with emulated(tmp_path, ARM, *STEPS) as first:
        first.process.kill()
        first.process.join()
        with emulated(tmp_path, ARM, *STEPS) as second, Bus(second.port, ARM.baud, lockstep=True) as bus:
            assert bus.ping(1) is not None
