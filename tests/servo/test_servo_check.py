"""What the check of servos refuses, on both sides of each limit, and when zeros are recorded."""

from collections.abc import Iterator
from dataclasses import replace

import pytest
from emulated import ARM, Emulated, emulated

from robot_retarget.base.errors import ServoError
from robot_retarget.servo.bus import Bus
from robot_retarget.servo.check import check, fix, record_zeros, require_fit

LIMITS = ARM.limits


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Emulated]:
    with emulated(tmp_path_factory.mktemp("check"), ARM, "--lockstep", "100") as process:
        yield process


@pytest.fixture
def emulator(running: Emulated) -> Emulated:
    """Servos as new, all at their zeros."""
    running.do("reset")
    running.spread(ARM, (0.0, 0.0, 0.0, 0.0))
    return running


@pytest.fixture
def bus(emulator: Emulated) -> Iterator[Bus]:
    with Bus(emulator.port, ARM.baud, lockstep=True) as opened:
        yield opened


def said(bus: Bus) -> list[str]:
    return [str(finding) for finding in check(bus, ARM)[1] if finding.grave]


@pytest.mark.parametrize(
    ("order", "what"),
    [
        (f"supply {LIMITS.min_voltage - 0.3}", "supply is 9.7 V, allowed 10 to 14.8 V"),
        (f"supply {LIMITS.min_voltage + 0.3}", ""),
        (f"supply {LIMITS.max_voltage - 0.3}", ""),
        (f"supply {LIMITS.max_voltage + 0.3}", "supply is 15.1 V, allowed 10 to 14.8 V"),
        (f"heat 2 {LIMITS.temperature + 1}", "°C hot, 70 at most"),
        (f"heat 2 {LIMITS.temperature - 2}", ""),
        (f"place 2 {ARM['j2'].ticks(1.54)}", ""),
        (f"place 2 {ARM['j2'].ticks(1.56)}", "stands at 1.56 rad, outside -1.50 to 1.50"),
        (f"place 2 {ARM['j2'].ticks(-1.56)}", "stands at -1.56 rad, outside -1.50 to 1.50"),
    ],
)
def test_servos_are_refused_beyond_their_limits_and_not_within(
    order: str, what: str, emulator: Emulated, bus: Bus
) -> None:
    assert not said(bus)
    emulator.do(order)
    found = said(bus)
    assert bool(found) == bool(what) and all(what in one for one in found), found


def test_a_zero_is_where_a_joint_stands_with_its_torque_off(emulator: Emulated, bus: Bus) -> None:
    emulator.do("place 2 2222")
    assert record_zeros(bus, ARM, ["j2"])["j2"].zero == 2222
    assert record_zeros(bus, ARM, ["j2"]).servos[0] == ARM.servos[0]
    bus.write(2, ARM["j2"].type.registers["torque_enable"], 1)
    with pytest.raises(ServoError, match=r"j2 \(servo 2\): torque is on"):
        record_zeros(bus, ARM, ["j1", "j2"])
    assert record_zeros(bus, ARM, ["j1"])["j1"].zero == ARM["j1"].zero


def test_a_register_is_corrected_where_the_torque_is_off(emulator: Emulated, bus: Bus) -> None:
    registers = ARM["j1"].type.registers
    for number in (1, 2):
        bus.write(number, registers["return_delay_time"], 100)
    bus.write(2, registers["torque_enable"], 1)
    findings = check(bus, ARM)[1]
    done = fix(bus, ARM, findings)
    assert done == ["j1: return_delay_time = 0", "j2: torque is on, return_delay_time not written"]
    assert [bus.value(number, registers["return_delay_time"]) for number in (1, 2)] == [0, 100]


def test_six_findings_are_told_and_the_others_counted(emulator: Emulated, bus: Bus) -> None:
    emulator.do("supply 9.2")
    emulator.spread(ARM, (1.6, 1.6, 1.6, 1.6))
    assert len(said(bus)) == 12  # a supply, its hardware error and an angle of each servo
    with pytest.raises(ServoError, match=r"; and 6 more$"):
        require_fit(bus, ARM)


def test_a_servo_in_wheel_mode_gets_the_whole_turn_of_its_ticks(emulator: Emulated, bus: Bus) -> None:
    limit = ARM["j1"].type.registers["max_position_limit"]
    bus.write(1, limit, 0)
    (finding,) = check(bus, ARM)[1]
    assert finding.grave and finding.what.startswith("no position mode: its limits are 0 and 0")
    fix(bus, ARM, [finding])
    assert bus.value(1, limit) == 4095 and not check(bus, ARM)[1]


def test_limits_of_a_map_have_an_order() -> None:
    with pytest.raises(ServoError, match=r"min_voltage 15 is not below max_voltage 14\.8"):
        replace(LIMITS, min_voltage=15.0)
