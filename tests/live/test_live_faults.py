"""The table of faults: every bad packet is counted and reported, none ends the stream, and the frames around it arrive."""

import json
import socket
import struct
from collections.abc import Container, Iterable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from perform import PROTOCOLS
from performers import HOST, Said, Script, Swing, clip, frames_for, listening, performing

from robot_retarget.live.frame import Fault, FaultCounter, Frame, RefusedError, SenderClock
from robot_retarget.live.loop import Loop, Patience
from robot_retarget.live.messages import LineDecoder, line_of, skeleton_line
from robot_retarget.live.receiver import NEWEST, Decoder, Packet, Receiver, UdpPort
from robot_retarget.live.sources import opened
from robot_retarget.live.vmc import VmcDecoder
from robot_retarget.robot import load_robot

MOTION = clip()
SKELETON = MOTION.skeleton
ENDS = {"Head": "Head", "LeftHand": "LeftWrist", "RightHand": "RightWrist", "LeftFoot": "LeftAnkle"}
"""Bones of VMC and the joints of the clip that they are."""


def decoder_of(protocol: str, faults: FaultCounter) -> Decoder:
    return VmcDecoder(faults) if protocol == "vmc" else LineDecoder(faults, SKELETON, True)


def packets_of(protocol: str, t: int) -> list[bytes]:
    return PROTOCOLS[protocol](MOTION)(t % len(MOTION), t / 60)


class Heard:
    """A receiver of packets that are handed to it, one after the other, 1/60 s apart unless told otherwise."""

    def __init__(self, protocol: str) -> None:
        self.said = Said()
        self.faults, self.port, self.now = FaultCounter(self.said), Script(), 100.0
        self.receiver = Receiver(self.port, decoder_of(protocol, self.faults), self.faults)
        self.protocol = protocol

    def give(self, data: bytes, sender: str = "a") -> int:
        """How many frames some bytes made."""
        self.port.packets = [Packet(data, sender, self.now)]
        before = self.receiver.dropped
        return (self.receiver.newest(0.0) is not None) + self.receiver.dropped - before

    def frame(self, t: int, sender: str = "a") -> int:
        self.now += 1 / 60
        return sum([self.give(packet, sender) for packet in packets_of(self.protocol, t)])

    def spread(self, frames: Iterable[int], apart: float, lost: Container[tuple[int, int]] = ()) -> list[int | None]:
        """Which sent frame each received one is, None for a mixture; packets come `apart`, frames 1/60 s."""
        found: list[int | None] = []
        for t in frames:
            for k, packet in enumerate(packets_of("vmc", 5 * t)):
                self.now = 100 + t / 60 + k * apart
                self.port.packets = [] if (t, k) in lost else [Packet(packet, "a", self.now)]
                frame = self.receiver.newest(0.0)
                found += [] if frame is None else [self._number(frame)]
        return found

    def _number(self, frame: Frame) -> int | None:
        joints = [SKELETON.names.index(name) for name in ENDS.values()]
        seen = frame.positions[[frame.skeleton.names.index(bone) for bone in ENDS]]
        off = np.abs(MOTION.positions[::5, joints] - seen).max(axis=(1, 2))
        return int(np.argmin(off)) if off.min() < 1e-4 else None

    def well(self, start: int = 0) -> None:
        """A few good frames; what they need to be understood comes first."""
        assert sum(self.frame(t) for t in range(start, start + 4)) >= 3

    def only(self, *kinds: Fault) -> None:
        assert set(self.faults.counts) == {str(kind) for kind in kinds}
        assert all(self.said.of(str(kind)) for kind in kinds)


@pytest.fixture(params=["vmc", "json"])
def heard(request: pytest.FixtureRequest) -> Heard:
    heard = Heard(request.param)
    heard.well()
    assert not heard.faults.counts
    return heard


@pytest.mark.parametrize(
    "junk",
    [
        b"\0",
        b"\xff" * 40,
        b"#bundle\0" + b"\xff" * 20,
        b"/VMC/Ext/Bone/Pos",
        b"[" * 2000,
        b"{}\n",
        b"#bundle\0" * 3000,
    ],
)
def test_a_malformed_packet_is_counted_and_the_next_frame_is_whole(heard: Heard, junk: bytes) -> None:
    assert heard.give(junk) == 0
    heard.only(Fault.MALFORMED)
    heard.well(start=4)


def test_a_truncated_packet_makes_nothing_up(heard: Heard) -> None:
    whole = packets_of(heard.protocol, 5)[-1]
    for size in (1, 7, len(whole) // 2 + 1, len(whole) - 3):
        assert heard.give(whole[:size]) == 0
    heard.only(Fault.MALFORMED)
    heard.well(start=6)


@settings(max_examples=40)
@given(st.sampled_from(["vmc", "json"]), st.integers(0, 10_000), st.integers(0, 255), st.booleans())
def test_whatever_byte_is_changed_nothing_breaks_and_places_stay_places(
    protocol: str, at: int, value: int, cut: bool
) -> None:
    heard = Heard(protocol)
    heard.well()
    for packet in packets_of(protocol, 4):
        spoilt = bytearray(packet)
        spoilt[at % len(spoilt)] = value
        heard.give(bytes(spoilt[: len(spoilt) - at % 5]) if cut else bytes(spoilt))
    heard.now += 1.0
    heard.well(start=64)


def test_numbers_that_are_none_are_refused(heard: Heard) -> None:
    bad = {
        "vmc": packets_of("vmc", 5)[0].replace(struct.pack(">f", 1.0), struct.pack(">f", np.nan), 1),
        "json": line_of(9.0, np.full((len(SKELETON), 3), np.nan)),
    }[heard.protocol]
    assert heard.give(bad) == 0
    heard.only(Fault.NOT_FINITE)
    heard.well(start=6)


@pytest.mark.parametrize("length", [0.0, 1e200])
def test_a_rotation_of_no_length_is_refused(length: float) -> None:
    faults = FaultCounter()
    decoder = LineDecoder(faults, SKELETON, True)
    turns = np.tile([length, 0.0, 0.0, 0.0], (len(SKELETON), 1))
    decoder.feed(line_of(9.0, np.zeros((len(SKELETON), 3)), turns), 0.0)
    with pytest.raises(RefusedError, match="has the length"):
        decoder.newest()


@pytest.mark.parametrize("stamp", ["1000000000000000000000", "1" + "0" * 400, "1e999"])
def test_a_time_of_any_number_of_digits_is_a_time_or_refused(stamp: str) -> None:
    faults = FaultCounter()
    decoder = LineDecoder(faults, SKELETON, True)
    line = line_of(9.0, np.zeros((len(SKELETON), 3))).replace(b"9.0", stamp.encode())
    assert decoder.feed(line, 0.0) == 1
    if float(stamp) < float("inf"):
        assert np.isfinite(decoder.newest().time)
    else:
        with pytest.raises(RefusedError):
            decoder.newest()


def test_a_bone_that_nobody_knows_is_counted_and_the_others_are_taken() -> None:
    heard = Heard("vmc")
    heard.well()
    heard.give(packets_of("vmc", 5)[0].replace(b"LeftUpperLeg", b"LeftUpperLig"))
    heard.only(Fault.UNKNOWN_BONE)
    assert "LeftUpperLig" in heard.said.of("unknown bone")[0]
    for packet in packets_of("vmc", 5)[1:]:
        heard.give(packet)
    heard.well(start=6)
    assert heard.faults.counts[Fault.INCOMPLETE] == 1


def test_a_packet_lost_on_the_way_costs_that_frame_its_bones_and_no_more() -> None:
    heard = Heard("vmc")
    heard.well()
    heard.now += 1 / 60
    for packet in packets_of("vmc", 5)[:-1]:
        heard.give(packet)
    heard.well(start=6)
    heard.only(Fault.INCOMPLETE)


@pytest.mark.parametrize("apart", [0.0, 0.001, 0.005])
def test_packets_of_one_frame_that_come_apart_make_one_whole_frame(apart: float) -> None:
    heard = Heard("vmc")
    assert heard.spread(range(12, 24), apart) == list(range(13, 24))
    assert not heard.faults.counts


def test_who_listens_from_the_middle_of_a_frame_mixes_none() -> None:
    heard = Heard("vmc")
    assert heard.spread(range(12, 24), 0.005, lost={(12, 0)}) == list(range(13, 24))


@pytest.mark.parametrize("lost", [0, 1, 2])
@pytest.mark.parametrize("apart", [0.0, 0.001, 0.005])
def test_a_lost_packet_mixes_no_frame_with_the_next(apart: float, lost: int) -> None:
    heard = Heard("vmc")
    heard.spread(range(12, 18), apart)
    whole = heard.spread(range(18, 24), apart, lost={(19, lost)})
    assert whole[:1] + whole[2:] == [18, 20, 21, 22, 23]
    heard.only(Fault.INCOMPLETE)
    assert heard.faults.counts[Fault.INCOMPLETE] == 1


def test_time_that_goes_backwards_or_stands_is_refused(heard: Heard) -> None:
    assert heard.frame(3) == 0 and heard.frame(1) == 0
    heard.only(Fault.BACKWARDS)
    assert heard.faults.counts[Fault.BACKWARDS] == 2
    heard.well(start=20)


def test_a_clock_that_was_set_is_followed_and_time_goes_on() -> None:
    faults = FaultCounter()
    clock, times = SenderClock(faults), []
    for k in range(200):
        stamp = k / 60 + (0 if k < 100 else 5000.0 if k < 150 else -3.0)
        times.append(clock.time(stamp, 100 + k / 60))
    assert faults.counts[Fault.CLOCK] == 2
    assert (np.diff(times) > 0).all() and abs(times[-1] - (100 + 199 / 60)) < 0.01


def test_jitter_of_the_network_is_taken_off_the_stamps() -> None:
    rng, clock = np.random.default_rng(0), SenderClock(FaultCounter())
    times = [clock.time(k / 60, 100 + k / 60 + 0.002 + 0.03 * rng.random() ** 4) for k in range(600)]
    assert np.abs(np.diff(times[60:]) - 1 / 60).max() < 1e-3


def test_frames_that_waited_and_come_all_at_once_are_no_time_backwards(heard: Heard) -> None:
    heard.now += 1.0
    heard.port.packets = [
        Packet(packet, "a", heard.now) for t in range(4, 34) for packet in packets_of(heard.protocol, t)
    ]
    frame = heard.receiver.newest(0.0)
    assert frame is not None and heard.receiver.dropped == 29 and not heard.faults.counts
    assert frame.time == pytest.approx(100 + 34 / 60, abs=0.01), "when it was made, not when it came"
    joints = [name.lower() for name in frame.skeleton.names]
    assert np.allclose(
        frame.positions[joints.index("head")], MOTION.positions[33, SKELETON.names.index("Head")], atol=1e-3
    )
    heard.well(start=64)


def test_a_clock_is_not_fooled_by_a_first_frame_that_was_slow() -> None:
    clock = SenderClock(FaultCounter())
    times = [clock.time(k / 60, 100 + k / 60 + (0.2 if k == 0 else 0.0)) for k in range(60)]
    assert (np.diff(times) > 0).all() and times[-1] == pytest.approx(100 + 59 / 60, abs=0.01)


def test_a_clock_that_runs_slow_is_followed() -> None:
    clock = SenderClock(FaultCounter())
    behind = [100 + k / 60 - clock.time(k / 60 * (1 - 2e-4), 100 + k / 60) for k in range(60 * 600)]
    assert max(behind) < 0.01


def test_stamps_that_are_not_after_the_last_are_named() -> None:
    clock = SenderClock(FaultCounter())
    clock.time(1.0, 100.0)
    with pytest.raises(RefusedError, match="backwards"):
        clock.time(0.9, 100.1)


def test_two_senders_are_not_mixed_and_the_other_takes_over_once_the_first_is_silent(heard: Heard) -> None:
    assert sum(heard.frame(t, "b") for t in range(4, 8)) == 0
    heard.only(Fault.OTHER_SENDER)
    heard.well(start=8)
    heard.now += 1.5
    assert sum(heard.frame(t, "b") for t in range(0, 4)) >= 3  # its clock begins anew, too
    assert heard.faults.counts[Fault.RESTARTED] == 1


def test_an_empty_datagram_is_no_farewell() -> None:
    faults = FaultCounter()
    receiver = Receiver(UdpPort(HOST, 0, faults), LineDecoder(faults, SKELETON, True), faults)
    assert isinstance(receiver.port, UdpPort)
    with udp() as first, udp() as second:
        first.sendto(line_of(1.0, MOTION.positions[0]), receiver.port.address)
        assert receiver.newest(0.5) is not None
        first.sendto(b"", receiver.port.address)
        second.sendto(line_of(1.1, MOTION.positions[1]), receiver.port.address)
        assert receiver.newest(0.1) is None
    receiver.close()
    assert faults.counts == {str(Fault.MALFORMED): 1, str(Fault.OTHER_SENDER): 1}


def test_only_this_machine_may_send_unless_told_otherwise() -> None:
    said = Said()
    source = opened("json", 0, say=said)
    assert isinstance(source, Receiver) and isinstance(source.port, UdpPort)
    assert source.port.address[0] == HOST and "this machine may send; --host 0.0.0.0 lets others" in said.lines[0]
    source.close()


def test_a_sender_that_is_not_the_chosen_one_is_refused() -> None:
    said = Said()
    source = opened("json", 0, "0.0.0.0", "127.0.0.2", say=said)
    assert isinstance(source, Receiver) and isinstance(source.port, UdpPort)
    for address, frames in (("127.0.0.3", 0), ("127.0.0.2", 1)):
        with udp() as out:
            out.bind((address, 0))
            out.connect((HOST, source.port.address[1]))
            out.sendall(skeleton_line(SKELETON) + line_of(1.0, MOTION.positions[0]))
            assert (source.newest(0.3) is not None) == bool(frames)
    source.close()
    assert source.faults.counts == {str(Fault.OTHER_SENDER): 1} and "only 127.0.0.2 may" in said.of("another sender")[0]


def test_a_frame_and_the_next_sender_at_once_give_the_frame_of_neither_or_one(heard: Heard) -> None:
    heard.now += 1 / 60
    last = [Packet(packet, "a", heard.now) for packet in packets_of(heard.protocol, 5)]
    gone, strange = Packet(b"", "a", heard.now), Packet(packets_of(heard.protocol, 6)[0], "b", heard.now)
    heard.port.packets = [*last, gone, strange]
    heard.receiver.newest(0.0)
    assert heard.faults.counts[Fault.RESTARTED] == 1
    assert sum(heard.frame(t, "b") for t in range(7, 12)) >= 3


def udp() -> socket.socket:
    return socket.socket(socket.AF_INET, socket.SOCK_DGRAM)


def test_after_ten_seconds_of_silence_the_same_sender_goes_on(heard: Heard) -> None:
    heard.now += 10.0
    assert sum(heard.frame(t) for t in range(604, 608)) >= 3
    assert not heard.faults.counts


def test_a_performer_who_does_not_trust_what_it_sees_is_not_followed() -> None:
    heard = Heard("vmc")
    heard.well()
    from pythonosc.osc_message_builder import OscMessageBuilder

    def ok(tracked: int) -> bytes:
        message = OscMessageBuilder("/VMC/Ext/OK")
        for value in (1, 3, 0, tracked):
            message.add_arg(value)
        return message.build().dgram

    heard.give(ok(0))
    packets = packets_of("vmc", 5)
    assert sum(map(heard.give, packets)) == 0
    heard.only(Fault.NOT_TRACKED)


def test_a_place_far_from_any_room_and_a_turn_that_is_none_are_refused() -> None:
    heard = Heard("json")
    heard.well()
    heard.give(line_of(9.0, np.full((len(SKELETON), 3), 1e6)))
    heard.give(line_of(9.1, MOTION.positions[0], np.zeros((len(SKELETON), 4))))
    heard.only(Fault.MALFORMED)


@pytest.mark.parametrize(
    "skeleton",
    [{}, {"names": ["a"], "parents": [0]}, {"names": "ab", "parents": 3}, {"names": [1], "parents": [-1]}, 7,
     {"names": ["a"], "parents": [-1], "offsets": [[1, 2]]}, {"names": ["a"], "parents": [-1], "offsets": [[1, 2, "x"]]}],
)  # fmt: skip
def test_a_skeleton_that_is_none_is_refused(skeleton: object) -> None:
    heard = Heard("json")
    heard.give(json.dumps({"skeleton": skeleton}).encode())
    heard.only(Fault.MALFORMED)
    heard.well()


def test_a_flood_is_thrown_away_unread_and_the_newest_frame_is_had() -> None:
    faults = FaultCounter()
    port = UdpPort(HOST, 0, faults)
    receiver = Receiver(port, LineDecoder(faults, SKELETON, True), faults)
    with udp() as out:
        for k in range(200):
            out.sendto(b'{"time": %d, "positions": [[0, 0, 0]]}' % k + b" " * 200, port.address)
        newest = line_of(500.0, MOTION.positions[7])
        out.sendto(newest, port.address)
        frame = receiver.newest(0.5)
    receiver.close()
    assert frame is not None and np.allclose(frame.positions, MOTION.positions[7], atol=1e-4)
    assert 201 - faults.counts[Fault.FLOOD] == pytest.approx(NEWEST / 240, abs=10)


def test_a_sender_twice_too_fast_builds_no_queue(heard: Heard) -> None:
    """Between two looks of a slow solver, four frames come."""
    before, looks = heard.receiver.dropped, 15
    for t in range(4, 4 + 4 * looks, 4):
        sent = [(heard.now + (k + 1) / 240, packet) for k in range(4) for packet in packets_of(heard.protocol, t + k)]
        heard.port.packets, heard.now = [Packet(data, "a", at) for at, data in sent], heard.now + 1 / 60
        frame = heard.receiver.newest(0.0)
        assert frame is not None and heard.now - frame.time < 1.5 / 240
    assert heard.receiver.dropped - before == 3 * looks


def test_a_sender_that_is_killed_and_restarted_is_followed_again() -> None:
    said = Said()
    with listening(VmcDecoder, said) as receiver:
        with performing(receiver, MOTION):
            assert len(frames_for(receiver, 0.4)) > 10
        assert not frames_for(receiver, 1.1)
        with performing(receiver, MOTION):
            assert len(frames_for(receiver, 0.4)) > 10
        assert receiver.faults.counts[Fault.RESTARTED] == 1 and said.of("restarted")


class Shown:
    """Keeps the poses that it is shown."""

    def __init__(self) -> None:
        self.qpos: list[np.ndarray] = []

    def show(self, pose: object) -> None:
        self.qpos.append(pose.qpos)  # type: ignore[attr-defined]


@pytest.mark.parametrize("silence", [0.1, 1.0])
def test_a_silence_is_counted_and_the_robot_is_held_without_a_jump(silence: float) -> None:
    said, shown, robot = Said(), Shown(), load_robot("op3")
    with listening(VmcDecoder, said) as receiver:
        loop = Loop(receiver, lambda skeleton: Swing(robot, skeleton), shown, said)
        with performing(receiver, MOTION):
            loop.run(0.4)
        before = loop.stats.held, len(shown.qpos)
        loop.run(silence + 0.15)
        held, poses = loop.stats.held - before[0], len(shown.qpos) - before[1]
        with performing(receiver, MOTION):
            loop.run(silence + 1.2)
    assert receiver.faults.counts[Fault.SILENCE] >= 1 and said.of("silence")
    assert 0 < poses / 2 < held
    assert np.abs(np.diff(shown.qpos, axis=0)).max() <= 3.0 * 0.1 + 1e-9


def test_a_frame_that_is_answered_is_counted_with_its_latency() -> None:
    robot, shown = load_robot("op3"), Shown()
    with listening(VmcDecoder) as receiver, performing(receiver, MOTION):
        loop = Loop(receiver, lambda skeleton: Swing(robot, skeleton), shown, patience=replace(Patience(), noted=0.2))
        figures = loop.run(0.5).figures(receiver)
    assert figures["frames"] == len(shown.qpos) - figures["held"] and figures["frames"] > 0
    assert 0 < figures["latency_p50_ms"] <= figures["latency_p99_ms"] <= figures["latency_max_ms"]
    assert figures["statuses"] == {"converged": figures["frames"]}
