"""DeepMimic's motions: JSON frames of a duration, a root and the turns of a humanoid's joints in their parents."""

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from robot_retarget.base.arrays import Floats
from robot_retarget.base.errors import MotionError
from robot_retarget.base.untrusted.documents import read_json
from robot_retarget.human.capture import Capture
from robot_retarget.human.kinematics import forward
from robot_retarget.human.readers.file_header import FileHeader
from robot_retarget.human.readers.request import Request
from robot_retarget.human.skeleton import Skeleton

# Joint, its parent, its place in the parent [m] and the numbers of its turn: 4 a quaternion w x y z, 1 an angle about z,
# 0 none. From the character file `humanoid3d` [Peng2018]: x ahead, y up, z to the right. The last three are the middle of
# the head's sphere and the front ends of the feet's boxes, which the file has as shapes.
_JOINTS: tuple[tuple[str, str, tuple[float, float, float], int], ...] = (
    ("root", "", (0.0, 0.0, 0.0), 4),
    ("chest", "root", (0.0, 0.236151, 0.0), 4),
    ("neck", "chest", (0.0, 0.223894, 0.0), 4),
    ("right_hip", "root", (0.0, 0.0, 0.084887), 4),
    ("right_knee", "right_hip", (0.0, -0.421546, 0.0), 1),
    ("right_ankle", "right_knee", (0.0, -0.409870, 0.0), 4),
    ("right_shoulder", "chest", (-0.02405, 0.24350, 0.18311), 4),
    ("right_elbow", "right_shoulder", (0.0, -0.274788, 0.0), 1),
    ("left_hip", "root", (0.0, 0.0, -0.084887), 4),
    ("left_knee", "left_hip", (0.0, -0.421546, 0.0), 1),
    ("left_ankle", "left_knee", (0.0, -0.409870, 0.0), 4),
    ("left_shoulder", "chest", (-0.02405, 0.24350, -0.18311), 4),
    ("left_elbow", "left_shoulder", (0.0, -0.274788, 0.0), 1),
    ("right_wrist", "right_elbow", (0.0, -0.258947, 0.0), 0),
    ("left_wrist", "left_elbow", (0.0, -0.258947, 0.0), 0),
    ("head", "neck", (0.0, 0.175, 0.0), 0),
    ("right_toe", "right_ankle", (0.1335, -0.0225, 0.0), 0),
    ("left_toe", "left_ankle", (0.1335, -0.0225, 0.0), 0),
)
_NAMES = tuple(name for name, *_ in _JOINTS)
SKELETON = Skeleton(
    _NAMES,
    np.array([_NAMES.index(parent) if parent else -1 for _, parent, *_ in _JOINTS]),
    np.array([place for _, _, place, _ in _JOINTS]),
)
WIDTH = 4 + sum(numbers for *_, numbers in _JOINTS)
"""Numbers of a frame: its duration [s], the root's place [m], then the turns."""
_SHORTEST = 0.5
"""Least length of a quaternion: those of motions that were resampled are up to a fifth short of 1."""


def matches_format(header: FileHeader) -> bool:
    """Whether a file begins as a DeepMimic motion or character does."""
    text = header.text.lstrip()
    return text.startswith("{") and ('"Frames"' in text or '"TorqueLim"' in text)


def read(path: Path, request: Request) -> Capture:
    """Read a DeepMimic motion of the character `humanoid3d`.

    Raises:
        MotionError: no JSON, no `Frames`, a frame of another width, or a quaternion of zeros; names line or frame.
    """
    rows = _rows(path)
    turns = np.tile([1.0, 0.0, 0.0, 0.0], (len(rows), len(_JOINTS), 1))
    column = 4
    for joint, (name, _, _, numbers) in enumerate(_JOINTS):
        values = rows[:, column : column + numbers]
        column += numbers
        if numbers == 4:
            turns[:, joint] = _unit(values, name, path)
        elif numbers == 1:
            turns[:, joint] = Rotation.from_euler("z", values).as_quat(scalar_first=True)
    translations = np.tile(SKELETON.offsets, (len(rows), 1, 1))
    translations[:, 0] = rows[:, 1:4]
    positions, rotations = forward(SKELETON.parents, translations, turns)
    fps, notes = request.rate(_rate(rows[:, 0], path))
    return Capture(SKELETON, positions, rotations, fps, str(path), notes, up="+y")


def _rows(path: Path) -> Floats:
    content = read_json(path, MotionError)
    frames = content.get("Frames") if isinstance(content, dict) else None
    if not isinstance(frames, list) or not frames:
        found = ", ".join(content) if isinstance(content, dict) else type(content).__name__
        raise MotionError(f"expected the `Frames` of a DeepMimic motion, found {found or 'nothing'}", path)
    for frame, row in enumerate(frames):
        if not isinstance(row, list) or len(row) != WIDTH:
            count = len(row) if isinstance(row, list) else "no"
            raise MotionError(
                f"Frames[{frame}]: expected {WIDTH} numbers (the character humanoid3d), found {count}", path
            )
    try:
        rows = np.array(frames, dtype=float)
    except (TypeError, ValueError) as error:
        raise MotionError(f"Frames: expected numbers only: {error}", path) from error
    if not np.isfinite(rows).all():
        raise MotionError(f"Frames[{int(np.argwhere(~np.isfinite(rows))[0, 0])}]: a number is not finite", path)
    return rows


def _unit(values: Floats, name: str, path: Path) -> Floats:
    size = np.linalg.norm(values, axis=1)
    wrong = np.flatnonzero((size < _SHORTEST) | (size > 1 / _SHORTEST))
    if wrong.size:
        frame = int(wrong[0])
        raise MotionError(f"Frames[{frame}], {name}: expected a unit quaternion w x y z, found {values[frame]}", path)
    return values / size[:, None]


def _rate(durations: Floats, path: Path) -> float:
    """Frames per second; the last frame's duration is 0 by custom."""
    step = float(np.median(durations[:-1])) if len(durations) > 1 else float(durations[0])
    if step <= 0:
        raise MotionError(f"Frames: expected durations over 0 s as first numbers, found {step:g}", path)
    return round(1 / step, 2)
