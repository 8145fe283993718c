"""C3D files of labelled markers: joint centres by published regressions (`markers`)."""

import importlib.util
import struct
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from robot_retarget.base.errors import MotionError, install_line
from robot_retarget.base.untrusted import child
from robot_retarget.base.untrusted.arrays import load_npz
from robot_retarget.human.capture import Capture, FileHeader, Request
from robot_retarget.human.readers import c3d_child
from robot_retarget.human.readers.points import LabelledPoints, labelled_capture, metres_in, title_of

_BIG_ENDIAN = 86
"""The kind of processor, in the format's header, whose numbers begin with their highest byte."""


def matches_format(header: FileHeader) -> bool:
    """Whether a file begins as C3D does: number of its block of parameters, then 0x50; that block has a processor's code, 84 to 86."""
    return header.head[1:2] == b"P" and header.head[512 * max(header.head[0], 1) - 509 :][:1] in (b"T", b"U", b"V")


def read(path: Path, request: Request) -> Capture:
    """Read the markers of a C3D file and compute joint centres from them.

    Raises:
        MotionError: broken, no points, a unit that is not known, or a marker set without joint regressions; says
            which are missing.
    """
    titles, points, stored = _points(path)
    capture = labelled_capture(LabelledPoints(titles, points, stored), path, request)
    if (announced := _announced(path)) > len(points):
        raise MotionError(f"truncated: {len(points)} of {announced} frames are present", path)
    return capture


def _points(path: Path) -> tuple[list[tuple[str, str]], Any, float | None]:
    """Each point's subject and label, the points (T, M, 3) in metres, NaN where lost, and their rate [1/s]."""
    stated = _decoded(path)
    points = np.moveaxis(stated["points"], 0, 2).transpose(1, 0, 2)
    if not points.size:
        raise MotionError("POINT: it holds no points over time", path)
    points[(points == 0).all(axis=2)] = np.nan
    titles = [title_of(label) for label in stated["labels"].tolist()]
    titles = [*titles, *[("", "")] * points.shape[1]][: points.shape[1]]
    rate = stated["rate"][stated["rate"] > 0]
    units = {unit.strip().lower() for unit in stated["units"].tolist()} - {""} or {"mm"}
    metres = metres_in(", ".join(sorted(units)), "POINT:UNITS", path)
    return titles, points * metres, float(rate[0]) if rate.size else None


def _decoded(path: Path) -> dict[str, np.ndarray]:
    """The points and parameters of a file, decoded in another process.

    Raises:
        MotionError: ezc3d is not installed, or refuses the file, or crashes at it.
    """
    if importlib.util.find_spec("ezc3d") is None:
        raise MotionError(f"C3D files need ezc3d: {install_line('c3d')}", path)
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "points.npz"
        code, said = child.run(c3d_child.__file__, str(path.absolute()), str(out), patience=2 * c3d_child.SECONDS)
        if code == child.BROKEN:
            raise MotionError(f"not a C3D file that can be read: {said}", path)
        if code != 0:
            raise MotionError("not a C3D file that can be read: ezc3d crashes at it, so its counts are broken", path)
        return dict(load_npz(out).items())


def _announced(path: Path) -> int:
    """The number of frames by the header; ezc3d replaces it by the number of frames in the data."""
    data = path.read_bytes()
    kind = data[512 * (data[0] - 1) + 3]
    first, last = struct.unpack_from(">HH" if kind == _BIG_ENDIAN else "<HH", data, 6)
    return last - first + 1
