"""One door for every motion file: the suffix chooses the reader, `upright` does the rest."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from robot_retarget.errors import MotionError, UsageError, known
from robot_retarget.motion.capture import Capture
from robot_retarget.motion.formats.bvh import read_bvh
from robot_retarget.motion.formats.positions import read_positions
from robot_retarget.motion.skeleton import Motion
from robot_retarget.motion.upright import upright

Reader = Callable[[Path, float | None, Sequence[str] | None], Capture]


def _bvh(path: Path, fps: float | None, names: Sequence[str] | None) -> Capture:
    if names is not None:
        raise UsageError(f"{path}: joint names come from the file; give them for arrays only")
    capture = read_bvh(path)
    if fps is None:
        return capture
    note = f"Read at {fps:g} frames per second; the file says {capture.fps:.4g}."
    return replace(capture, fps=fps, notes=(*capture.notes, note))


READERS: dict[str, Reader] = {".bvh": _bvh, ".npy": read_positions, ".npz": read_positions}
"""What reads which suffix."""


def read_motion(path: str | Path, *, fps: float | None = None, names: Sequence[str] | None = None) -> Motion:
    """Read a human motion, in metres and z up.

    Args:
        path: a BVH file, or joint positions as `.npy` or `.npz`.

    Other arguments:
        fps: frames per second, in place of what the file says.
        names: joint names, for arrays that carry none.

    Raises:
        MotionError: the file cannot be read; names the line, or the frame and joint, and what was expected.
        UsageError: `fps` is not positive, or `names` are given for a file that has its own.
    """
    path = Path(path)
    if fps is not None and not 0 < fps < float("inf"):
        raise UsageError(f"frames per second must be positive, got {fps}")
    if path.is_dir():
        raise MotionError("is a folder; expected a motion file", path)
    if not path.exists():
        raise MotionError("no such file", path)
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        raise MotionError(f"unknown kind of motion file {path.suffix!r}; {known(READERS)}", path)
    try:
        capture = reader(path, fps, names)
    except OSError as error:
        raise MotionError(f"cannot be read: {error.strerror or error}", path) from error
    return upright(capture)
