"""An emulated servo means by its registers what the e-manual says."""

import itertools
import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robot_retarget.actuators.control_tables import OVERLOAD, XM430_W350, model_named
from robot_retarget.servo import protocol
from robot_retarget.servo.emulator.device import Device, rested
from robot_retarget.servo.emulator.motor import OVERLOAD_TIME, time_based, velocity_based
from robot_retarget.servo.emulator.network import Network
from robot_retarget.servo.emulator.server import TURNAROUND, WireTiming
from robot_retarget.servo.emulator.world import World
from robot_retarget.servo.protocol import BROADCAST, DynamixelPacket, Error, Instruction, Parser, frame

XM = model_named("XM430-W350")

VELOCITY, ACCELERATION = 0.229 * 4096 / 60, 214.577 * 4096 / 3600
"""Units of the X series' registers [ticks/s] and [ticks/s²], from the manual."""


def made(count: int = 1, model: str = "XM430-W350") -> tuple[Network, World]:
    devices = [rested(model_named(model), k + 1, 3) for k in range(count)]
    return Network(devices), World(devices)


def ask(network: Network, request: bytes) -> list[DynamixelPacket]:
    """What a host hears after it has sent `request`."""
    answers = [a.data for sent in Parser().feed(request) for a in network.answer(sent)]
    return Parser(strict=True).feed(b"".join(answers))


def put(network: Network, name: str, value: int, identity: int = 1) -> int:
    register = network.devices[identity - 1].registers.by_name[name]
    (status,) = ask(network, protocol.write(identity, register.address, register.encode(value)))
    return status.error


def get(network: Network, name: str, identity: int = 1) -> int:
    register = network.devices[identity - 1].registers.by_name[name]
    (status,) = ask(network, protocol.read(identity, register.address, register.size))
    return register.decode(status.data)


def test_ping_read_and_write_answer_as_the_manual_s_examples() -> None:
    network, _ = made()
    network.devices[0].registers["model_number"], network.devices[0].registers["firmware_version"] = 1030, 38
    network.devices[0].place(166)
    (answer,) = [a for f in Parser().feed(frame(1, Instruction.PING)) for a in network.answer(f)]
    assert answer.data.hex() == "fffffd00010700550006042" + "6655d"
    (answer,) = [a for f in Parser().feed(protocol.read(1, 132, 4)) for a in network.answer(f)]
    assert answer.data.hex() == "fffffd0001080055" + "00a60000008cc0"
    (answer,) = [a for f in Parser().feed(protocol.write(1, 116, b"\0\2\0\0")) for a in network.answer(f)]
    assert answer.data.hex() == "fffffd00010400" + "5500a10c"


def test_a_fast_sync_read_answers_as_the_manual_s_example() -> None:
    network, _ = made(7)
    for identity, ticks in ((3, 166), (7, 2079), (4, 1023)):
        network.devices[identity - 1].place(ticks)
    request = protocol.sync_read(132, 4, (3, 7, 4), fast=True)
    (answer,) = [a for f in Parser().feed(request) for a in network.answer(f)]
    assert answer.data.hex() == "fffffd00fe1900550003a60000008408" + "00071f08000016ca" + "0004ff030000d19e"


@pytest.mark.parametrize("kind", [Instruction.FAST_SYNC_READ, Instruction.SYNC_READ])
def test_a_read_of_more_than_a_status_holds_leaves_the_servos_answering(kind: Instruction) -> None:
    network, _ = made(2)
    request = frame(BROADCAST, kind, b"\0\0\xff\xff\1\2")
    answers = [a for f in Parser().feed(request) for a in network.answer(f)]
    assert not answers or kind == Instruction.SYNC_READ
    assert get(network, "id", 2) == 2


def test_eeprom_is_locked_while_torque_is_on() -> None:
    network, _ = made()
    assert put(network, "return_delay_time", 10) == 0
    assert put(network, "torque_enable", 1) == 0
    assert put(network, "return_delay_time", 20) == Error.ACCESS
    assert get(network, "return_delay_time") == 10


@pytest.mark.parametrize(
    ("name", "value", "error"),
    [
        ("present_position", 5, Error.ACCESS),
        ("operating_mode", 7, Error.DATA_RANGE),
        ("goal_position", -150_000, Error.DATA_RANGE),
        ("goal_position", 4096, Error.DATA_RANGE),
        ("goal_velocity", 201, Error.DATA_LIMIT),
        ("led", 2, Error.DATA_RANGE),
        ("led", 1, Error.NONE),
    ],
)
def test_a_value_that_does_not_fit_gets_its_error(name: str, value: int, error: int) -> None:
    network, _ = made()
    assert put(network, name, value) == error


def test_outside_the_table_and_parts_of_registers_are_refused() -> None:
    network, _ = made()
    assert ask(network, protocol.read(1, 1000, 4))[0].error == Error.ACCESS
    assert ask(network, protocol.write(1, 116, b"\1\2"))[0].error == Error.DATA_LENGTH
    assert ask(network, frame(1, 0x77))[0].error == Error.INSTRUCTION


def test_the_status_return_level_decides_who_answers() -> None:
    network, _ = made()
    put(network, "status_return_level", 1)
    assert not ask(network, protocol.write(1, 65, b"\1")) and ask(network, protocol.read(1, 65, 1))
    ask(network, protocol.write(1, 68, b"\0"))
    assert not ask(network, protocol.read(1, 65, 1)) and ask(network, frame(1, Instruction.PING))


def test_indirect_data_reads_and_writes_what_its_address_points_to() -> None:
    network, _ = made()
    ask(network, protocol.write(1, 168, protocol.word(65) + protocol.word(146)))
    assert ask(network, protocol.write(1, 224, b"\1"))[0].error == 0
    assert get(network, "led") == 1
    assert ask(network, protocol.read(1, 224, 2))[0].data == bytes((1, 30))
    assert ask(network, protocol.write(1, 168, protocol.word(11)))[0].error == Error.DATA_RANGE


def test_a_change_of_mode_brings_defaults_back_and_the_goal_to_the_shaft() -> None:
    network, _ = made()
    put(network, "position_p_gain", 123)
    put(network, "profile_velocity", 50)
    network.devices[0].place(3000)
    put(network, "operating_mode", 4)
    assert (get(network, "position_p_gain"), get(network, "profile_velocity"), get(network, "goal_position")) == (
        800,
        0,
        3000,
    )


def test_torque_on_does_not_bring_the_goal_to_the_shaft() -> None:
    network, world = made()
    network.devices[0].place(2500)
    put(network, "torque_enable", 1)
    world.advance(0.05)
    world.advance(0.1)
    assert get(network, "present_position") < 2450 and network.devices[0].writes.largest_step == 452


@pytest.mark.parametrize("mode", [3, 4, 5])
def test_a_servo_reaches_its_goal(mode: int) -> None:
    network, world = made()
    put(network, "operating_mode", mode)
    put(network, "torque_enable", 1)
    put(network, "goal_position", 2300)
    run(world, 1.0)
    assert abs(get(network, "present_position") - 2300) <= 5 and get(network, "moving_status") & 1


def test_reverse_mode_and_homing_offset_change_what_hosts_see() -> None:
    network, _ = made()
    network.devices[0].place(2148)
    put(network, "homing_offset", 100)
    assert get(network, "present_position") == 2248
    put(network, "homing_offset", 2000)
    assert get(network, "present_position") == 2148, "beyond 1024 it has no effect in position mode"
    put(network, "homing_offset", 0)
    put(network, "drive_mode", 1)
    assert get(network, "present_position") == 1948


def test_a_silent_host_stops_the_servo_and_locks_its_goal() -> None:
    network, world = made()
    put(network, "torque_enable", 1)
    put(network, "profile_velocity", 20)
    put(network, "goal_position", 3000)
    put(network, "bus_watchdog", 5)
    run(world, 0.2)
    here = get(network, "present_position")
    assert get(network, "bus_watchdog") == -1 and put(network, "goal_position", 2000) == Error.DATA_RANGE
    run(world, 0.3)
    assert abs(get(network, "present_position") - here) < 10
    assert put(network, "bus_watchdog", 0) == 0 and put(network, "goal_position", 2000) == 0


def test_a_hardware_error_alerts_lets_go_and_needs_a_reboot() -> None:
    network, _ = made()
    put(network, "torque_enable", 1)
    network.devices[0].fail(5)
    (status,) = ask(network, frame(1, Instruction.PING))
    assert status.error == 0x80
    assert ask(network, protocol.read(1, 64, 1))[0].data == b"\0"
    assert put(network, "torque_enable", 1) == 0x80 | Error.RESULT_FAIL
    ask(network, frame(1, Instruction.REBOOT))
    assert put(network, "torque_enable", 1) == 0


@pytest.mark.parametrize("model", ["XM430-W350", "XL430-W250"])
def test_a_load_beyond_its_output_is_an_overload_after_a_while(model: str) -> None:
    network, world = made(2, model)
    for device, goal in zip(network.devices, (2048 + 600, 2048 + 20), strict=True):
        device.motor.jammed = True
        put(network, "torque_enable", 1, device.id)
        put(network, "goal_position", goal, device.id)
    run(world, OVERLOAD_TIME - 0.1)
    assert get(network, "hardware_error_status", 1) == 0
    run(world, 0.2)
    assert get(network, "hardware_error_status", 1) == 1 << OVERLOAD
    assert get(network, "torque_enable", 1) == 0 and get(network, "torque_enable", 2) == 1
    ask(network, frame(1, Instruction.REBOOT))
    assert get(network, "hardware_error_status", 1) == 0


def test_current_is_the_datasheet_s_at_standstill_and_small_at_full_speed() -> None:
    network, world = made()
    put(network, "operating_mode", 4)
    put(network, "torque_enable", 1)
    put(network, "goal_position", 1_000_000)
    network.devices[0].motor.jammed = True
    run(world, 0.1)
    assert get(network, "present_current") * XM.current_unit == pytest.approx(XM.motor.stall_current, abs=0.01)
    network.devices[0].motor.jammed = False
    run(world, 1.0)
    assert 0 < get(network, "present_current") * XM.current_unit < 0.05 * XM.motor.stall_current


def test_a_servo_that_moves_its_load_is_not_overloaded() -> None:
    network, world = made()
    put(network, "operating_mode", 4)
    put(network, "torque_enable", 1)
    put(network, "goal_position", 1_000_000)
    run(world, 3.0)
    assert get(network, "hardware_error_status") == 0


def test_too_hot_and_too_little_voltage_are_hardware_errors() -> None:
    network, world = made()
    network.devices[0].motor.temperature = 90
    run(world, 0.01)
    assert network.devices[0].registers["hardware_error_status"] == 4
    network, world = made()
    world.supply = 9.0
    run(world, 0.01)
    assert network.devices[0].registers["hardware_error_status"] == 1


def test_factory_reset_keeps_what_it_is_told() -> None:
    network, _ = made(2)
    put(network, "return_delay_time", 7, 2)
    assert ask(network, frame(2, Instruction.FACTORY_RESET, b"\2"))[0].error == 0
    assert (get(network, "return_delay_time", 2), get(network, "baud_rate", 2)) == (250, 3)


def test_a_mode_without_a_position_does_not_turn_the_shaft() -> None:
    network, world = made()
    put(network, "operating_mode", 16)
    put(network, "torque_enable", 1)
    put(network, "goal_pwm", 200)
    run(world, 0.3)
    assert get(network, "present_velocity") == 0 and get(network, "operating_mode") == 16


@pytest.mark.parametrize("kind", [0x04, 0x05, 0x20, 0x92, 0x93, 0x9A])
def test_instructions_that_no_client_here_sends_are_refused_or_ignored(kind: int) -> None:
    network, _ = made(2)
    for identity, errors in ((1, [Error.INSTRUCTION]), (BROADCAST, [])):
        assert [status.error for status in ask(network, frame(identity, kind, b"\x41\0\1"))] == errors
    assert get(network, "led") == 0


def test_a_fast_read_longer_than_a_status_is_ignored() -> None:
    network, _ = made(2)
    assert ask(network, protocol.sync_read(0, 65_535, (1, 2), fast=True)) == []


def test_clear_forgets_whole_turns() -> None:
    network, _ = made()
    put(network, "operating_mode", 4)
    network.devices[0].place(4096 * 3 + 10)
    assert get(network, "present_position") == 4096 * 3 + 10
    assert ask(network, frame(1, Instruction.CLEAR, protocol.CLEAR_MULTI_TURN))[0].error == 0
    assert get(network, "present_position") == 10


def test_the_realtime_tick_counts_milliseconds() -> None:
    network, world = made()
    run(world, 1.5)
    assert get(network, "realtime_tick") == pytest.approx(1500, abs=3)


def test_an_xl430_has_no_current_and_no_current_modes() -> None:
    network, _ = made(model="XL430-W250")
    assert put(network, "operating_mode", 0) == put(network, "operating_mode", 5) == Error.DATA_RANGE
    assert get(network, "present_load") == 0


@given(st.integers(1, 300), st.integers(0, 300), st.integers(-3000, 3000))
def test_a_profile_ends_at_its_goal_and_never_breaks_its_limits(speed: int, pull: int, distance: int) -> None:
    path = velocity_based(100.0, 100.0 + distance, speed * VELOCITY, pull * ACCELERATION)
    assert path.position(path.total) == pytest.approx(100 + distance)
    step = max(path.total, 1e-3) / 500
    places = [path.position(k * step) for k in range(501)]
    speeds = [(b - a) / step for a, b in itertools.pairwise(places)]
    if path.total:
        assert max(map(abs, speeds)) <= speed * VELOCITY * 1.001 + 1e-6
        if pull:
            turns = [abs(b - a) / step for a, b in itertools.pairwise(speeds)]
            assert max(turns) <= pull * ACCELERATION * 1.001 + 1e-3


def test_a_profile_takes_the_manual_s_times() -> None:
    """t₁ = 64 V / A and t₂ = 64 Δ / V in ms, to the rounding of 64."""
    path = velocity_based(0, 2000, 100 * VELOCITY, 20 * ACCELERATION)
    assert 1000 * path.ramp == pytest.approx(64 * 100 / 20, rel=0.01)
    assert 1000 * (path.total - path.ramp) == pytest.approx(64 * 2000 / 100, rel=0.01)
    timed = time_based(0, 2000, 500, 400)
    assert (timed.total, timed.ramp) == (0.5, 0.25)


def test_pace_is_the_sum_of_wire_delay_and_turnaround() -> None:
    timing = WireTiming(1_000_000, usb_latency=1e-3)
    timing.request(0.0, 14)
    assert timing.answer(0.0, 15, 500e-6) == pytest.approx(14e-5 / 1 + TURNAROUND + 500e-6 + 15e-5 + 1e-3)


@given(st.binary(max_size=120), st.integers(0, 255), st.sampled_from(list(Instruction)))
@settings(max_examples=300)
def test_no_parameters_whatever_crash_a_servo(params: bytes, identity: int, instruction: Instruction) -> None:
    network, world = made(3)
    network.answer(DynamixelPacket(identity, instruction, params))
    run(world, 0.01)
    assert all(d.read(0, 147)[0] == 0 for d in network.devices)


def test_random_writes_leave_a_servo_that_answers() -> None:
    rng = random.Random(3)
    network, world = made(2)
    for _ in range(3000):
        request = protocol.write(1, rng.randrange(662), rng.randbytes(rng.randrange(1, 12)))
        ask(network, request)
        world.advance(world.time + 0.002)
    device: Device = network.devices[0]
    device.registers["status_return_level"] = 2
    assert device.read(XM430_W350["present_position"].address, 4)[0] == 0


def run(world: World, seconds: float) -> None:
    """Let time pass."""
    end = world.time + seconds
    while world.time + world.step <= end:
        world.advance(world.time + world.step * 1.01)
