"""Programs that were not written with the emulator in mind work on it."""

import time
from collections.abc import Iterator
from pathlib import Path

import pytest
import rustypot
from dynamixel_easy_sdk import Connector
from dynamixel_sdk import GroupSyncRead, GroupSyncWrite, PortHandler, Protocol2PacketHandler, port_handler
from emulated import ARM, Emulated, emulated, until

IDS = list(ARM.ids)


@pytest.fixture(scope="module")
def emulator(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Emulated]:
    with emulated(tmp_path_factory.mktemp("clients")) as running:
        yield running


def test_dynamixel_sdk_pings_reads_writes_and_reads_fast(emulator: Emulated, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(port_handler, "LATENCY_TIMER", 2000.0)  # a busy machine answers late
    port, packets = PortHandler(emulator.port), Protocol2PacketHandler()
    assert port.setBaudRate(ARM.baud)
    found, result = packets.broadcastPing(port)
    assert result == 0 and found == {identity: [1020, 48] for identity in IDS}
    assert packets.write1ByteTxRx(port, 1, 64, 1) == (0, 0)
    writing = GroupSyncWrite(port, packets, 116, 4)
    assert writing.addParam(1, [0x00, 0x09, 0x00, 0x00]) and writing.txPacket() == 0
    reading = GroupSyncRead(port, packets, 132, 4)
    assert all(reading.addParam(identity) for identity in IDS)
    until(lambda: reading.txRxPacket() == 0 and abs(reading.getData(1, 132, 4) - 0x900) < 4, seconds=10)
    for read in (reading.txRxPacket, reading.fastSyncRead):
        assert read() == 0
        assert reading.getData(1, 132, 4) == pytest.approx(0x900, abs=3)
        assert reading.getData(4, 132, 4) == ARM["j4"].zero
    assert packets.reboot(port, 1) == (0, 0)
    assert packets.read1ByteTxRx(port, 1, 64)[0] == 0
    port.closePort()


def test_dynamixel_easy_sdk_finds_and_moves_motors(emulator: Emulated) -> None:
    connector = Connector(emulator.port, ARM.baud)
    assert len(connector.createAllMotors()) == len(IDS)
    motor = connector.createMotor(2)
    motor.enableTorque()
    motor.setGoalPosition(2000)
    time.sleep(0.6)
    assert motor.getPresentPosition() == pytest.approx(2000, abs=3)
    motor.disableTorque()


def test_rustypot_reads_and_moves_servos(emulator: Emulated) -> None:
    servos = rustypot.Xl430PyController(str(Path(emulator.port).resolve()), ARM.baud, 0.05)
    assert servos.ping(3)
    servos.sync_write_torque_enable([3], [1])
    servos.sync_write_goal_position([3], [2200])
    time.sleep(0.6)
    for fast in (False, True):
        servos.set_fast_sync_read(fast)
        assert servos.sync_read_present_position(IDS)[2] == pytest.approx(2200, abs=3)
