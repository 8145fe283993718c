"""BVH in and out: a HIERARCHY of joints and a MOTION of channel values ↔ positions and rotations."""

import re
import warnings
from itertools import pairwise
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from robot_retarget.base.arrays import Floats
from robot_retarget.base.errors import MotionError
from robot_retarget.base.files import replacing
from robot_retarget.human.capture import Capture, FileHeader, Request
from robot_retarget.human.motion import Motion
from robot_retarget.human.readers.bvh_text import Hierarchy, Rows, parse_hierarchy, parse_rows
from robot_retarget.human.skeleton import backward, forward

# BVH files: a HIERARCHY of joints and a MOTION of channel values → positions and rotations in file units.

_HIERARCHY = re.compile(r"(?im)^[ \t]*HIERARCHY\b")
_MOTION = re.compile(r"(?im)^[ \t]*MOTION\b")


def matches_format(header: FileHeader) -> bool:
    """Whether a file begins as BVH does."""
    return _HIERARCHY.search(header.text) is not None


def read_bvh(path: str | Path, request: Request | None = None) -> Capture:
    """Read a BVH file: every joint's position and rotation at every frame, in the file's unit and axes.

    Raises:
        MotionError: the file cannot be read as BVH; names the line and the expected content.
    """
    return captured(Path(path).read_bytes(), path, request)


def captured(data: bytes, path: str | Path, request: Request | None = None) -> Capture:
    """Parse the bytes of a BVH file; `path` is for messages."""
    hierarchy, rows = parse_bvh(_text(data), path)
    _check_finite(hierarchy, rows, path)
    translations, turns, notes = local_pose(hierarchy, rows.values)
    positions, rotations = forward(hierarchy.skeleton.parents, translations, turns)
    rate, rate_notes = (request or Request()).rate(_rate(rows.frame_time))
    spoken = any(channel.endswith("rotation") for channels in hierarchy.channels for channel in channels)
    return Capture(
        hierarchy.skeleton,
        positions,
        rotations if spoken else None,
        rate,
        str(path),
        (*hierarchy.notes, *rows.notes, *notes, *rate_notes),
    )


def _rate(frame_time: float) -> float:
    """Frames per second; a whole number where the frame time is that number's, rounded to five digits or more, as is usual."""
    whole = round(1 / frame_time)
    return float(whole) if whole and abs(1 / whole - frame_time) < 5e-6 else 1 / frame_time


def parse_bvh(text: str, path: str | Path) -> tuple[Hierarchy, Rows]:
    """The two parts of a BVH text.

    Raises:
        MotionError: a part is missing or broken.
    """
    if not text.strip():
        raise MotionError("the file is empty; expected HIERARCHY", path)
    head = _HIERARCHY.search(text)
    if head is None:
        raise MotionError(f"expected HIERARCHY, found {text.split()[0][:40]!r}", path, 1)
    motion = _MOTION.search(text, head.end())
    if motion is None:
        raise MotionError(
            "expected MOTION after the hierarchy, found the end of the file", path, _line(text, len(text.rstrip()))
        )
    hierarchy = parse_hierarchy(text[head.end() : motion.start()], path, _line(text, head.end()))
    return hierarchy, parse_rows(text[motion.end() :], path, _line(text, motion.end()), hierarchy.width)


def local_pose(hierarchy: Hierarchy, rows: Floats) -> tuple[Floats, Floats, tuple[str, ...]]:
    """Each joint's pose in its parent, from the channel values.

    Returns:
        translations (T, J, 3) in file units, rotations (T, J, 4) w x y z, and notes about decisions.
    """
    count = len(hierarchy.channels)
    translations = np.tile(hierarchy.skeleton.offsets, (len(rows), 1, 1))
    turns = np.tile([1.0, 0.0, 0.0, 0.0], (len(rows), count, 1))
    placed, column = np.zeros((count, 3), dtype=bool), 0
    for joint, channels in enumerate(hierarchy.channels):
        values = rows[:, column : column + len(channels)]
        column += len(channels)
        for channel, value in zip(channels, values.T, strict=True):
            if channel.endswith("position"):
                translations[:, joint, "XYZ".index(channel[0])] = value
                placed[joint, "XYZ".index(channel[0])] = True
        turning = [k for k, channel in enumerate(channels) if channel.endswith("rotation")]
        if turning:
            order = "".join(channels[k][0] for k in turning)
            turns[:, joint] = _euler(order, values[:, turning]).as_quat(scalar_first=True)
    if not _relative(hierarchy, translations, placed):
        return translations, turns, ()
    translations += hierarchy.skeleton.offsets * placed
    return translations, turns, ("Position channels are relative: they were added to OFFSET.",)


def _relative(hierarchy: Hierarchy, translations: Floats, placed: np.ndarray) -> bool:
    """Whether position channels below the roots add to OFFSET: then they are nearer to zero than to OFFSET."""
    moved = placed.all(axis=1) & (hierarchy.skeleton.parents >= 0)
    values, offsets = translations[:, moved], hierarchy.skeleton.offsets[moved]
    return bool(np.linalg.norm(values - offsets, axis=2).sum() > np.linalg.norm(values, axis=2).sum())


def _euler(order: str, degrees: Floats) -> Rotation:
    """R = R_1 R_2 R_3 about the joint's own axes in the order of its channels; any count of them."""
    if len(order) <= 3 and all(a != b for a, b in pairwise(order)):
        return Rotation.from_euler(order, degrees, degrees=True)
    total = Rotation.identity(len(degrees))
    for axis, angle in zip(order, degrees.T, strict=True):
        total = total * Rotation.from_euler(axis, angle[:, None], degrees=True)
    return total


def _check_finite(hierarchy: Hierarchy, rows: Rows, path: str | Path) -> None:
    if np.isfinite(rows.values).all():
        return
    frame, column = (int(k) for k in np.argwhere(~np.isfinite(rows.values))[0])
    joint = int(np.searchsorted(np.cumsum([len(c) for c in hierarchy.channels]), column, side="right"))
    name, value = hierarchy.skeleton.names[joint], rows.values[frame, column]
    raise MotionError(
        f"frame {frame}, joint {name!r}: expected a finite number, found {value}", path, rows.lines[frame]
    )


def _text(data: bytes) -> str:
    """The text with `\\n` line ends, from any usual encoding."""
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        text = data.decode("utf-16", errors="replace")
    else:
        try:
            text = data.decode("utf-8-sig")
        except UnicodeDecodeError:
            text = data.decode("latin-1")
    return text.replace("\r\n", "\n").replace("\r", "\n")


def _line(text: str, position: int) -> int:
    return text.count("\n", 0, position) + 1


# Motions as BVH files: centimetres, y up, position and Z X Y rotation channels.

_POSITION = ("Xposition", "Yposition", "Zposition")
_ROTATION = ("Zrotation", "Xrotation", "Yrotation")
_TO_FILE = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
"""z up to y up: x' = y, y' = z, z' = x."""
_RIGID = 1e-6
"""A joint that moves less than this in its parent has no position channels [m]: the rounding of six decimals in a file."""


def write_bvh(motion: Motion, path: str | Path) -> None:
    """Write a motion as BVH.

    Roots, and joints that move in their parents, have absolute position channels. A leaf called `PARENT_end` is written
    as End Site. A motion without rotations has position channels on every joint and no rotation channels; `read_motion`
    gives it back without rotations. Joints may come back in another order, depth first.

    Raises:
        OutputError: the file cannot be written.
    """
    tree = _Tree(motion)
    with replacing(path) as scratch, scratch.open("w", encoding="utf-8", newline="\n") as file:
        file.write("HIERARCHY\n" + "".join(tree.lines(root, 0) for root in tree.children[-1]))
        file.write(f"MOTION\nFrames: {len(motion)}\nFrame Time: {1 / motion.fps:.9g}\n")
        np.savetxt(file, tree.rows(), fmt="%.6f")


class _Tree:
    """The joints of a motion as BVH sees them: offsets, channels and their values, in centimetres and y up."""

    def __init__(self, motion: Motion):
        skeleton = motion.skeleton
        self.names, self.parents = skeleton.names, skeleton.parents
        self.children: dict[int, list[int]] = {joint: [] for joint in range(-1, len(skeleton))}
        for joint, parent in enumerate(self.parents):
            self.children[int(parent)].append(joint)
        self.turns: Floats | None = None
        self.translations = motion.positions - np.where(self.parents[:, None] < 0, 0, motion.positions[:, self.parents])
        if motion.rotations is not None:
            self.translations, local = backward(self.parents, motion.positions, motion.rotations)
            self.turns = _degrees(local)
        self.translations = 100 * self.translations @ _TO_FILE.T
        self.offsets = np.median(self.translations, axis=0)
        moves = np.ptp(self.translations, axis=0).max(axis=1) > 100 * _RIGID
        self.ends = [
            motion.rotations is not None
            and not (self.children[joint] or moves[joint])
            and self.parents[joint] >= 0
            and name == f"{self.names[self.parents[joint]]}_end"
            for joint, name in enumerate(self.names)
        ]
        self.placed = moves | (self.parents < 0) | (motion.rotations is None)
        self.offsets[self.parents < 0] = 0.0

    def channels(self, joint: int) -> tuple[str, ...]:
        if self.ends[joint]:
            return ()
        return (*(_POSITION if self.placed[joint] else ()), *(_ROTATION if self.turns is not None else ()))

    def lines(self, joint: int, depth: int) -> str:
        """The joint's block of the hierarchy, its children within."""
        pad, inner = "\t" * depth, "\t" * (depth + 1)
        kind = "End Site" if self.ends[joint] else f"{'JOINT' if depth else 'ROOT'} {self.names[joint]}"
        offset = " ".join(f"{value:.6f}" for value in self.offsets[joint])
        channels = self.channels(joint)
        channel_line = "" if self.ends[joint] else f"{inner}CHANNELS {len(channels)} {' '.join(channels)}\n"
        below = "".join(self.lines(child, depth + 1) for child in self.children[joint])
        return f"{pad}{kind}\n{pad}{{\n{inner}OFFSET {offset}\n{channel_line}{below}{pad}}}\n"

    def rows(self) -> Floats:
        """The channel values (T, C) of the joints depth first."""
        stack, columns = list(reversed(self.children[-1])), []
        while stack:
            joint = stack.pop()
            stack.extend(reversed(self.children[joint]))
            channels = self.channels(joint)
            if _POSITION[0] in channels:
                columns.append(self.translations[:, joint])
            if _ROTATION[0] in channels and self.turns is not None:
                columns.append(self.turns[:, joint])
        return np.concatenate(columns, axis=1)


def _degrees(local: Floats) -> Floats:
    """Z X Y angles (T, J, 3) of rotations (T, J, 4) in their parents, y up: M R Mᵀ, of a quaternion (w, M v)."""
    shape = (*local.shape[:2], 3)
    turned = np.concatenate([local[..., :1], local[..., 1:] @ _TO_FILE.T], axis=2)
    with warnings.catch_warnings():
        # In gimbal lock one of many right answers is chosen.
        warnings.filterwarnings("ignore", message="Gimbal lock")
        return Rotation.from_quat(turned.reshape(-1, 4), scalar_first=True).as_euler("ZXY", degrees=True).reshape(shape)
