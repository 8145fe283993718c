"""Motion-X: rows of 322 numbers, the parameters of SMPL-X side by side.

Columns of a frame: 0–2 the root's vector of rotation, 3–65 those of 21 joints, 66–158 hands and jaw, 159–308 the face,
309–311 the place, 312–321 the shape.
"""

from pathlib import Path

from robot_retarget.base.errors import MotionError
from robot_retarget.base.untrusted.arrays import load_arrays
from robot_retarget.human.capture import Capture
from robot_retarget.human.readers.file_header import FileHeader
from robot_retarget.human.readers.request import Request
from robot_retarget.human.readers.smpl.parameters import captured

WIDTH = 322
FPS = 30.0
"""Of the data set [1/s]."""


def matches_format(header: FileHeader) -> bool:
    """Whether an array is as wide as the rows."""
    return len(header.shape) == 2 and header.shape[1] == WIDTH


def read(path: Path, request: Request) -> Capture:
    """Read the rotations of the body, its place and its shape.

    Raises:
        MotionError: not (T, 322) finite numbers.
    """
    rows = load_arrays(path)["positions"]
    if rows.ndim != 2 or rows.shape[1] != WIDTH or not len(rows) or rows.dtype.kind not in "fiu":
        raise MotionError(f"expected rows (T, {WIDTH}), got {rows.dtype} {rows.shape}", path)
    arrays = {"root_orient": rows[:, :3], "pose_body": rows[:, 3:66], "trans": rows[:, 309:312], "betas": rows[:, 312:]}
    return captured({**arrays, "fps": request.fps or FPS}, path, request)
