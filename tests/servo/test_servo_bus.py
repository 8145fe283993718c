"""Each fault of dynamixel-sdk is there on the plain SDK, and is not on our bus."""

import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from dynamixel_sdk import GroupSyncRead, PortHandler, Protocol2PacketHandler, port_handler
from emulated import ARM, Emulated, emulated

from robot_retarget.actuators.control_tables import XM430_W350
from robot_retarget.base.errors import ServoError
from robot_retarget.servo.bus import PATIENCE, Bus, NoAnswerError, PortLostError, StatusError
from robot_retarget.servo.protocol import sync_write

POSITION = XM430_W350["present_position"]
assert port_handler.LATENCY_TIMER == 16
IDS = [1, 2, 3, 4]
PATIENT = 2000
"""Latency where an answer comes [ms]."""


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Emulated]:
    with emulated(tmp_path_factory.mktemp("bus"), ARM, "--lockstep", "100") as process:
        yield process


@pytest.fixture
def emulator(running: Emulated) -> Emulated:
    """A bus as new, in lockstep: a busy machine loses no answer."""
    running.do("reset")
    return running


@pytest.fixture
def bus(emulator: Emulated) -> Iterator[Bus]:
    with Bus(emulator.port, ARM.baud, lockstep=True) as opened:
        yield opened


def plain(emulator: Emulated, latency: int = 16) -> tuple[PortHandler, Protocol2PacketHandler]:
    """The SDK's port, which waits for an answer for about twice a latency [ms]."""
    port_handler.LATENCY_TIMER = latency
    port = PortHandler(emulator.port)
    assert port.setBaudRate(ARM.baud)
    return port, Protocol2PacketHandler()


def test_writes_are_stuffed(tmp_path: Path) -> None:
    """FF FF FD in the data, as in a current of −1 before a low byte FD; a strict servo drops it unstuffed."""
    value = b"\xff\xff\xfd\x00\x00\x00"
    with emulated(tmp_path, ARM, "--strict", "--lockstep", "100") as emulator:
        port, packets = plain(emulator)
        packets.writeTxRx(port, 1, 224, len(value), list(value))
        assert bytes(packets.readTxRx(port, 1, 224, 6)[0]) != value
        port.closePort()
        with Bus(emulator.port, ARM.baud, lockstep=True) as bus:
            bus.send(sync_write(224, 6, [(1, value)]))
            assert bus.read(1, 224, 6).data == value


def test_unstuffing_loses_nothing(emulator: Emulated) -> None:
    value = bytes.fromhex("FFFFFDFFFDFD")
    with Bus(emulator.port, ARM.baud, lockstep=True) as bus:
        bus.send(sync_write(224, 6, [(1, value)]))
        assert bus.read(1, 224, 6).data == value
    port, packets = plain(emulator)
    data, result, _ = packets.readTxRx(port, 1, 224, 6)
    port.closePort()
    assert result != 0 or bytes(data) != value


def test_a_refused_read_is_an_error_and_no_index_error(emulator: Emulated, bus: Bus) -> None:
    with pytest.raises(StatusError, match="servo 1: read 4 bytes at 1000: access error"):
        bus.read(1, 1000, 4)
    bus.close()
    port, packets = plain(emulator, PATIENT)
    with pytest.raises(IndexError):
        packets.read4ByteTxRx(port, 1, 1000)
    port.closePort()


def test_after_a_pulled_cable_there_is_one_kind_of_error_and_the_bus_can_be_opened_again(emulator: Emulated) -> None:
    port, packets = plain(emulator)
    emulator.do("unplug")
    with pytest.raises(Exception) as caught:
        packets.ping(port, 1)
    assert not isinstance(caught.value, OSError)
    assert packets.ping(port, 1)[1] == -1000, "stuck: the port is in use for ever"
    emulator.do("plug")
    with Bus(emulator.port, ARM.baud, lockstep=True) as bus:
        emulator.do("unplug")
        for _ in range(2):
            with pytest.raises(PortLostError, match="is gone"):
                bus.ping(1)
        emulator.do("plug")
    with Bus(emulator.port, ARM.baud, lockstep=True) as bus:
        assert bus.ping(1) == (1020, 48)


def test_a_missing_servo_is_waited_for_less_long_than_by_the_sdk(emulator: Emulated) -> None:
    with Bus(emulator.port, ARM.baud) as bus:
        assert bus.ping(77) is None
        ours = bus._deadline(10, 1, PATIENCE) - time.monotonic()
    port, packets = plain(emulator)
    began = time.monotonic()
    packets.ping(port, 77)
    theirs = time.monotonic() - began
    port.closePort()
    assert ours < 0.033 < theirs


@pytest.mark.parametrize("fast", [False, True])
def test_a_sync_read_gives_those_who_answered(emulator: Emulated, bus: Bus, fast: bool) -> None:
    emulator.do("silent 3")
    replies = bus.read_all(POSITION.address, 4, IDS, IDS if fast else ())
    assert set(replies) == ({1, 2} if fast else {1, 2, 4})
    assert all(POSITION.decode(r.data) == ARM.servos[k - 1].zero for k, r in replies.items())
    bus.close()
    port, packets = plain(emulator)
    group = GroupSyncRead(port, packets, POSITION.address, 4)
    for identity in IDS:
        group.addParam(identity)
    (group.fastSyncRead if fast else group.txRxPacket)()
    assert not any(group.isAvailable(identity, POSITION.address, 4) for identity in IDS)
    port.closePort()


@pytest.mark.parametrize(("silent", "patience"), [(2, 60.0), (4, 0.1)])
def test_only_the_last_servo_in_turn_is_waited_for(emulator: Emulated, silent: int, patience: float) -> None:
    """When a later one has answered, an earlier one has missed its turn."""
    emulator.do(f"silent {silent}")
    with Bus(emulator.port, ARM.baud) as bus:
        began = time.monotonic()
        assert set(bus.read_all(POSITION.address, 4, IDS, patience=patience)) == {1, 2, 3, 4} - {silent}
        took = time.monotonic() - began
    assert took < 60 if silent == 2 else took >= patience


def test_a_late_answer_does_not_hide_a_fast_one(emulator: Emulated) -> None:
    emulator.do("delay 300")
    with Bus(emulator.port, ARM.baud) as bus:
        assert not bus.read_all(POSITION.address, 3, [2], patience=0.0)
        assert set(bus.read_all(POSITION.address, 4, IDS, IDS, patience=60.0)) == {1, 2, 3, 4}


@pytest.mark.parametrize("fast", [False, True])
def test_a_sync_read_keeps_each_servo_s_alert(emulator: Emulated, bus: Bus, fast: bool) -> None:
    emulator.do("overload 2")
    replies = bus.read_all(POSITION.address, 4, IDS, IDS if fast else ())
    assert [bool(replies[k].hardware) for k in IDS] == [False, True, False, False]
    bus.close()
    port, packets = plain(emulator, PATIENT)
    group = GroupSyncRead(port, packets, POSITION.address, 4)
    group.addParam(2)
    assert group.txRxPacket() == 0 and not hasattr(group, "getError"), "looks like success, and there is no way to ask"
    port.closePort()


def test_the_port_has_one_owner(emulator: Emulated, bus: Bus) -> None:
    with pytest.raises(ServoError, match="another program has it"):
        Bus(emulator.port, ARM.baud)
    errors: list[Exception] = []

    def intrude() -> None:
        try:
            bus.ping(1)
        except ServoError as error:
            errors.append(error)

    thread = threading.Thread(target=intrude)
    thread.start()
    thread.join()
    assert "belongs to another thread" in str(errors[0])
    bus.close()
    first, second = plain(emulator), plain(emulator)
    assert first[0].is_open and second[0].is_open
    first[0].closePort()
    second[0].closePort()


def test_eeprom_is_refused_under_torque_and_the_message_says_so(bus: Bus) -> None:
    bus.write(1, XM430_W350["torque_enable"], 1)
    with pytest.raises(StatusError, match="servo 1: write 4 at 11: access error"):
        bus.write(1, XM430_W350["operating_mode"], 4)


def test_a_silent_servo_is_named(emulator: Emulated, bus: Bus) -> None:
    emulator.do("silent 3")
    with pytest.raises(NoAnswerError, match="servo 3 does not answer"):
        bus.read(3, 0, 10)


def test_a_scan_finds_everybody(bus: Bus) -> None:
    assert list(bus.scan(range(12))) == [(k, 1020, 48) for k in IDS]


def test_an_unknown_baud_rate_is_refused(emulator: Emulated) -> None:
    with pytest.raises(ServoError, match="no baud rate 1234"):
        Bus(emulator.port, 1234)
