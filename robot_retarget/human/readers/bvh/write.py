"""Motions as BVH files: centimetres, y up, position and Z X Y rotation channels."""

import warnings
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from robot_retarget.base.arrays import Floats
from robot_retarget.base.files import replacing
from robot_retarget.human.kinematics import backward
from robot_retarget.human.motion import Motion

_POSITION = ("Xposition", "Yposition", "Zposition")
_ROTATION = ("Zrotation", "Xrotation", "Yrotation")
_TO_FILE = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
"""z up to y up: x' = y, y' = z, z' = x."""
_RIGID = 1e-6
"""A joint that moves less than this in its parent has no position channels [m]."""


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
