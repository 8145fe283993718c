"""Pickles as other programs write them, read as data: nested dicts of video trackers (`.pt` of GVHMR and GENMO, `.pkl` of
WHAM), frames of 4D-Humans, Multi-HMR and SAM 3D Body, and InterMimic's rows of numbers, which hold positions of joints."""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from robot_retarget.base.errors import MotionError
from robot_retarget.base.untrusted.limits import ZLIB_MAGIC
from robot_retarget.base.untrusted.pickles import load_pickle
from robot_retarget.human.capture import Capture
from robot_retarget.human.readers import positions, sam3d
from robot_retarget.human.readers.file_header import FileHeader
from robot_retarget.human.readers.request import Request
from robot_retarget.human.readers.smpl import frames
from robot_retarget.human.readers.smpl.parameters import captured, holds_turns
from robot_retarget.human.readers.smpl.strangers import sentence

_PICKLE = b"\x80"
INTERMIMIC = slice(162, 318)
"""Columns of InterMimic's rows with the positions of 52 joints [m]."""


def matches_format(header: FileHeader) -> bool:
    """Whether a file is a pickle, of PyTorch, of joblib or of Python."""
    in_zip = any(name.endswith("data.pkl") for name in header.members)
    return in_zip or (header.head.startswith((_PICKLE, *ZLIB_MAGIC)) and not header.head.isascii())


def read(path: Path, request: Request) -> Capture:
    """Read the parameters of the first body in the world, or of the body with the requested name.

    Raises:
        MotionError: it would run code, or holds no rotations of a body; lists its content.
    """
    content = load_pickle(path)
    if isinstance(content, np.ndarray) and content.ndim == 2 and content.shape[1] >= INTERMIMIC.stop:
        joints = content[:, INTERMIMIC].reshape(len(content), -1, 3)
        return replace(positions.captured({"positions": joints}, path, request), up="+z")
    if sam3d.holds_people(content):
        return sam3d.people_of(content, path, request)
    if frames.holds_people(content):
        return frames.people_of(content, path, request)
    bodies = dict(_bodies(content, ""))
    if not bodies:
        raise MotionError(sentence(content), path)
    names = sorted(bodies, key=lambda name: "incam" in name)
    which, notes = request.choose(names, path)
    capture = captured(bodies[names[which]], path, request)
    return replace(capture, notes=(*notes, *capture.notes), camera="incam" in names[which])


def _bodies(content: Any, name: str) -> Iterator[tuple[str, dict[str, Any]]]:
    """Every dict in the pickle that holds turns of a body, by the keys that lead to it."""
    if not isinstance(content, Mapping):
        return
    arrays = {str(key): np.asarray(value) for key, value in content.items() if _is_plain(value)}
    if holds_turns(arrays):
        yield name or "body", arrays
    for key, value in content.items():
        yield from _bodies(value, f"{name}/{key}" if name else str(key))


def _is_plain(value: Any) -> bool:
    """Whether a value is numbers."""
    return isinstance(value, np.ndarray | int | float) and not isinstance(value, bool)
