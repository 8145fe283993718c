"""The codec speaks as the e-manual's examples do, and survives any bytes."""

import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robot_retarget.servo import protocol
from robot_retarget.servo.protocol import (
    HEADER,
    Instruction,
    Parser,
    crc16,
    fast_blocks,
    frame,
    status,
    stuff,
    unstuff,
)

GOLDEN = {
    "ping": (frame(1, Instruction.PING), "01 03 00 01 19 4E"),
    "ping status": (status(1, 0, bytes.fromhex("060426")), "01 07 00 55 00 06 04 26 65 5D"),
    "read": (protocol.read(1, 132, 4), "01 07 00 02 84 00 04 00 1D 15"),
    "read status": (status(1, 0, bytes.fromhex("A6000000")), "01 08 00 55 00 A6 00 00 00 8C C0"),
    "write": (protocol.write(1, 116, bytes.fromhex("00020000")), "01 09 00 03 74 00 00 02 00 00 CA 89"),
    "write status": (status(1), "01 04 00 55 00 A1 0C"),
    "factory reset": (frame(1, Instruction.FACTORY_RESET, b"\x01"), "01 04 00 06 01 A1 E6"),
    "reboot": (frame(1, Instruction.REBOOT), "01 03 00 08 2F 4E"),
    "clear": (frame(1, Instruction.CLEAR, protocol.CLEAR_MULTI_TURN), "01 08 00 10 01 44 58 4C 22 B1 DC"),
    "sync read": (protocol.sync_read(132, 4, (1, 2)), "FE 09 00 82 84 00 04 00 01 02 CE FA"),
    "sync write": (
        protocol.sync_write(116, 4, ((1, bytes((150, 0, 0, 0))), (2, bytes((170, 0, 0, 0))))),
        "FE 11 00 83 74 00 04 00 01 96 00 00 00 02 AA 00 00 00 82 87",
    ),
    "fast sync read": (protocol.sync_read(132, 4, (3, 7, 4), fast=True), "FE 0A 00 8A 84 00 04 00 03 07 04 20 F2"),
    "fast status": (
        protocol.fast_status(
            ((0, 3, bytes.fromhex("A6000000")), (0, 7, bytes.fromhex("1F080000")), (0, 4, bytes.fromhex("FF030000")))
        ),
        "FE 19 00 55 00 03 A6 00 00 00 84 08 00 07 1F 08 00 00 16 CA 00 04 FF 03 00 00 D1 9E",
    ),
}
HEADERISH = st.lists(st.sampled_from([0xFF, 0xFD, 0x00, 0x01, 0x55]), max_size=60).map(bytes) | st.binary(max_size=60)


@pytest.mark.parametrize("name", GOLDEN)
def test_the_manual_s_examples_come_out_byte_for_byte(name: str) -> None:
    made, printed = GOLDEN[name]
    assert made == HEADER + bytes.fromhex(printed)
    (back,) = Parser().feed(made)
    assert (back.id, back.instruction) == (made[4], made[7])


def test_the_checksum_is_that_of_umts() -> None:
    assert crc16(b"123456789") == 0xFEE8


def test_stuffing_round_trips_on_a_hundred_thousand_strings() -> None:
    rng = random.Random(2)
    for _ in range(100_000):
        data = bytes(rng.choices((0xFF, 0xFD, 0x00, 0x42), weights=(6, 4, 1, 1), k=rng.randrange(1, 24)))
        assert unstuff(stuff(data)) == data
        assert HEADER not in stuff(data)


@given(st.integers(0, 252), st.sampled_from(list(Instruction)), HEADERISH)
@settings(max_examples=500)
def test_a_frame_comes_back_from_the_parser_whole(identity: int, instruction: int, params: bytes) -> None:
    (back,) = Parser(strict=True).feed(frame(identity, instruction, params))
    assert (back.id, back.instruction, back.params) == (identity, instruction, params)


@given(HEADERISH, HEADERISH, st.lists(st.integers(1, 9), min_size=1, max_size=20))
@settings(max_examples=500)
def test_after_noise_and_a_pause_the_parser_finds_the_next_frame(noise: bytes, params: bytes, cuts: list[int]) -> None:
    parser, sent = Parser(), frame(7, Instruction.WRITE, params)
    stream, found = noise + sent, []
    while stream:
        cut = cuts[len(stream) % len(cuts)]
        found += parser.feed(stream[:cut])
        stream = stream[cut:]
    while parser.pending:
        found += parser.give_up()
    assert found[-1].params == params


def test_a_damaged_frame_is_counted_and_passed_over() -> None:
    good = status(3, 0, b"\x01\x02")
    bad = bytearray(good)
    bad[9] ^= 0x10
    parser = Parser()
    assert [f.data for f in parser.feed(bytes(bad) + good)] == [b"\x01\x02"]
    assert parser.broken == 1


def test_strict_parsing_drops_a_frame_sent_without_stuffing() -> None:
    body = b"\x03\x66\x00\xff\xff\xfd\x01"
    whole = HEADER + b"\x01" + protocol.word(len(body) + 2) + body
    unstuffed = whole + protocol.word(crc16(whole))
    assert Parser().feed(unstuffed)[0].params == body[1:]
    assert not Parser(strict=True).feed(unstuffed)


@given(st.lists(st.tuples(st.sampled_from([0, 0x80]), st.integers(0, 252), st.binary(min_size=4, max_size=4))))
def test_a_broken_fast_answer_yields_the_blocks_that_came_whole(blocks: list[tuple[int, int, bytes]]) -> None:
    raw = protocol.fast_status(blocks) if blocks else b""
    assert list(fast_blocks(raw, [4] * len(blocks))) == blocks
    for cut in range(len(raw)):
        came = list(fast_blocks(raw[:cut], [4] * len(blocks)))
        assert came == blocks[: max(0, cut - 8) // 8]


def test_a_sync_write_refuses_a_value_of_another_length() -> None:
    with pytest.raises(ValueError, match="servo 2 gets 2 bytes, 4 announced"):
        protocol.sync_write(116, 4, ((1, b"1234"), (2, b"12")))
