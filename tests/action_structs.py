"""Action pages by the C struct of ROBOTIS's sources."""

import ctypes
from collections.abc import Sequence
from pathlib import Path


class Header(ctypes.Structure):
    """PageHeader of action_file_define.h."""

    _fields_ = [
        ("name", ctypes.c_char * 14), ("reserved1", ctypes.c_uint8), ("repeat", ctypes.c_uint8), ("schedule", ctypes.c_uint8),
        ("reserved2", ctypes.c_uint8 * 3), ("stepnum", ctypes.c_uint8), ("reserved3", ctypes.c_uint8), ("speed", ctypes.c_uint8),
        ("reserved4", ctypes.c_uint8), ("accel", ctypes.c_uint8), ("next", ctypes.c_uint8), ("exit", ctypes.c_uint8),
        ("reserved5", ctypes.c_uint8 * 4), ("checksum", ctypes.c_uint8), ("pgain", ctypes.c_uint8 * 31), ("reserved6", ctypes.c_uint8),
    ]  # fmt: skip


class Step(ctypes.Structure):
    _fields_ = [("position", ctypes.c_uint16 * 31), ("pause", ctypes.c_uint8), ("time", ctypes.c_uint8)]


class Page(ctypes.Structure):
    _fields_ = [("header", Header), ("step", Step * 7)]


def pages_of(path: Path) -> list[Page]:
    data = path.read_bytes()
    assert ctypes.sizeof(Page) == 512 and len(data) == 256 * 512
    return [Page.from_buffer_copy(data, 512 * k) for k in range(256)]


def write_pages(pages: Sequence[Page], path: Path) -> None:
    """Write pages with bytes that add up to 255."""
    for page in pages:
        page.header.checksum = (page.header.checksum + 255 - sum(bytes(page))) % 256
    path.write_bytes(b"".join(map(bytes, pages)))
