"""Arrays and frames of numbers of data sets: DeepMimic, HumanML3D, Motion-X, PHUMA, PARC."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from robot_retarget.base.arrays import Floats
from robot_retarget.base.errors import MotionError
from robot_retarget.base.untrusted.arrays import load_arrays, rate_of, shaped
from robot_retarget.base.untrusted.documents import read_json
from robot_retarget.base.untrusted.rotations import checked_quaternions
from robot_retarget.human.capture import Capture, FileHeader, Request
from robot_retarget.human.readers.points import of_points
from robot_retarget.human.readers.positions import CONTACT, HUMANML3D, SKELETONS
from robot_retarget.human.readers.smpl import captured
from robot_retarget.human.skeleton import Skeleton

# DeepMimic's motions: JSON frames of a duration, a root and the turns of a humanoid's joints in their parents.

_JOINTS: dict[str, Any] = SKELETONS["deepmimic"]
"""By name: parent, place in the parent [m] and the numbers of the turn, 4 a quaternion w x y z, 1 an angle about z, 0 none."""
_NAMES = tuple(_JOINTS)
SKELETON = Skeleton(
    _NAMES,
    np.array([_NAMES.index(parent) if parent else -1 for parent, *_ in _JOINTS.values()]),
    np.array([place for _, *place, _ in _JOINTS.values()]),
)
DEEPMIMIC_WIDTH = 4 + sum(numbers for *_, numbers in _JOINTS.values())
"""Numbers of a frame: its duration [s], the root's place [m], then the turns."""


def is_deepmimic(header: FileHeader) -> bool:
    """Whether a file begins as a DeepMimic motion or character does."""
    text = header.text.lstrip()
    return text.startswith("{") and ('"Frames"' in text or '"TorqueLim"' in text)


def read_deepmimic(path: Path, request: Request) -> Capture:
    """Read a DeepMimic motion of the character `humanoid3d`.

    Raises:
        MotionError: no JSON, no `Frames`, a frame of another width, or a quaternion of zeros; names line or frame.
    """
    rows = _rows(path)
    turns = np.tile([1.0, 0.0, 0.0, 0.0], (len(rows), len(_JOINTS), 1))
    column = 4
    for joint, (name, (*_, numbers)) in enumerate(_JOINTS.items()):
        values = rows[:, column : column + numbers]
        column += numbers
        if numbers == 4:
            turns[:, joint] = checked_quaternions(values, f"Frames, {name}")
        elif numbers == 1:
            turns[:, joint] = Rotation.from_euler("z", values).as_quat(scalar_first=True)
    posed = SKELETON.posed(rows[:, 1:4], range(len(_JOINTS)), turns)
    fps, notes = request.rate(_rate(rows[:, 0], path))
    return Capture(SKELETON, *posed, fps, str(path), notes, up="+y")


def _rows(path: Path) -> Floats:
    content = read_json(path, MotionError)
    frames = content.get("Frames") if isinstance(content, dict) else None
    if not isinstance(frames, list) or not frames:
        found = ", ".join(content) if isinstance(content, dict) else type(content).__name__
        raise MotionError(f"expected the `Frames` of a DeepMimic motion, found {found or 'nothing'}", path)
    for frame, row in enumerate(frames):
        if not isinstance(row, list) or len(row) != DEEPMIMIC_WIDTH:
            count = len(row) if isinstance(row, list) else "no"
            raise MotionError(
                f"Frames[{frame}]: expected {DEEPMIMIC_WIDTH} numbers (the character humanoid3d), found {count}", path
            )
    try:
        rows = np.array(frames, dtype=float)
    except (TypeError, ValueError) as error:
        raise MotionError(f"Frames: expected numbers only: {error}", path) from error
    if not np.isfinite(rows).all():
        raise MotionError(f"Frames[{int(np.argwhere(~np.isfinite(rows))[0, 0])}]: a number is not finite", path)
    return rows


def _rate(durations: Floats, path: Path) -> float:
    """Frames per second; the last frame's duration is 0 by custom."""
    step = float(np.median(durations[:-1])) if len(durations) > 1 else float(durations[0])
    if step <= 0:
        raise MotionError(f"Frames: expected durations over 0 s as first numbers, found {step:g}", path)
    return round(1 / step, 2)


# The 263 features of HumanML3D: joints about a root whose place and heading are sums of its steps [Guo2022].
#
# Columns of a frame: 0 the root's turn about y (half of it), 1–2 its step along x and z as seen from the heading, 3 its
# height, 4–66 the places of the other 21 joints about it, 67–192 their turns in six numbers each, 193–258 velocities,
# 259–262 contacts of left ankle, left foot, right ankle and right foot.

HUMANML3D_WIDTH = 263
"""Columns of a frame."""
HUMANML3D_FPS = 20.0
"""Of the data set [1/s], as its library states."""
_SIX = slice(67, 193)
_UNIT_TURN = 0.2
"""How far from 1 the length of the axes in columns 67–192 may be, on the mean; normalised features are further."""


def is_humanml3d(header: FileHeader) -> bool:
    """Whether an array is as wide as the features."""
    return len(header.shape) == 2 and header.shape[1] == HUMANML3D_WIDTH


def read_humanml3d(path: Path, request: Request) -> Capture:
    """Read features and put the joints where they say.

    Raises:
        MotionError: not (T, 263) finite numbers, or features that are still normalised.
    """
    values = load_arrays(path)["positions"]
    if values.ndim != 2 or values.shape[1] != HUMANML3D_WIDTH or not len(values) or values.dtype.kind not in "fiu":
        raise MotionError(f"expected features (T, {HUMANML3D_WIDTH}), got {values.dtype} {values.shape}", path)
    features = values.astype(float)
    if not np.isfinite(features).all():
        frame, column = np.argwhere(~np.isfinite(features))[0]
        raise MotionError(f"frame {frame}, column {column} is not finite", path)
    axes = np.linalg.norm(features[:, _SIX].reshape(-1, 3), axis=1)
    if abs(float(axes.mean()) - 1) > _UNIT_TURN:
        raise MotionError("the features are normalised: multiply by the data set's Std.npy and add its Mean.npy", path)
    fps, rate_notes = request.rate(usual=HUMANML3D_FPS)
    joints = humanml3d_positions(features)
    body = {name: (parent, joints[:, k]) for k, (name, parent) in enumerate(HUMANML3D.parents.items())}
    notes = ("The file says when the feet stand: its contacts are taken.", *rate_notes)
    capture = of_points(body, fps, str(path), notes, up="+y")
    return replace(capture, contacts=features[:, 259:263] > CONTACT)


def humanml3d_positions(features: Floats) -> Floats:
    """(T, 22, 3) of the joints [m], y up.

    The heading before frame t is the sum of the turns before it, and the root's place that of the steps, each turned by the
    heading it was made in.
    """
    half = np.concatenate([[0.0], np.cumsum(features[:-1, 0])])
    heading = Rotation.from_euler("y", -2 * half[:, None])
    steps = np.zeros((len(features), 3))
    steps[1:, [0, 2]] = features[:-1, 1:3]
    root = np.cumsum(heading.apply(steps), axis=0)
    root[:, 1] = features[:, 3]
    about = features[:, 4:67].reshape(-1, 21, 3)
    turned = np.einsum("tij,tkj->tki", heading.as_matrix(), about)
    turned[:, :, [0, 2]] += root[:, None, [0, 2]]
    return np.concatenate([root[:, None], turned], axis=1)


# Motion-X and PHUMA: parameters of SMPL-X side by side, a row a frame. Root and 21 joints are vectors of rotation. The rows of
# Motion-X have hands, jaw and face behind the joints, and the shape at their end.

ROWS = {
    322: {"root_orient": slice(3), "pose_body": slice(3, 66), "trans": slice(309, 312), "betas": slice(312, 322)},
    69: {"trans": slice(3), "root_orient": slice(3, 6), "pose_body": slice(6, 69)},
}
"""Columns of each parameter, by the width of the rows: Motion-X, PHUMA."""
ROWS_FPS = 30.0
"""Of both data sets [1/s], as their libraries state."""


def is_smplx_rows(header: FileHeader) -> bool:
    """Whether an array is as wide as the rows."""
    return len(header.shape) == 2 and header.shape[1] in ROWS


def read_smplx_rows(path: Path, request: Request) -> Capture:
    """Read the rotations of the body, its place and its shape.

    Raises:
        MotionError: not (T, 322) or (T, 69) finite numbers.
    """
    rows = load_arrays(path)["positions"]
    if rows.ndim != 2 or rows.shape[1] not in ROWS or not len(rows) or rows.dtype.kind not in "fiu":
        raise MotionError(f"expected rows (T, {' or '.join(map(str, ROWS))}), got {rows.dtype} {rows.shape}", path)
    arrays = {name: rows[:, columns] for name, columns in ROWS[rows.shape[1]].items()}
    return captured({**arrays, "fps": request.fps or ROWS_FPS}, path, request)


# PARC: pickled motions of DeepMimic's body with z up. Quaternions are x y z w, those of the joints in their parents.

PARC_JOINTS = (
    "root", "chest", "neck", "right_shoulder", "right_elbow", "right_wrist", "left_shoulder", "left_elbow", "left_wrist",
    "right_hip", "right_knee", "right_ankle", "left_hip", "left_knee", "left_ankle",
)  # fmt: skip
"""Its bodies, by the joint of DeepMimic's skeleton that turns each."""


def parc_capture(motion: Mapping[str, Any], path: Path, request: Request) -> Capture:
    """Make a capture of a motion of PARC: `root_pos` (T, 3) [m], `root_rot` (T, 4), `joint_rot` (T, 14, 4), `fps`.

    Raises:
        FileError: an array is missing, has another shape, or is no rotation.
    """
    place = shaped(motion["root_pos"], (None, 3), "root_pos")
    root = shaped(motion["root_rot"], (len(place), 4), "root_rot")
    joints = shaped(motion["joint_rot"], (len(place), len(PARC_JOINTS) - 1, 4), "joint_rot")
    known = checked_quaternions(np.concatenate([root[:, None], joints], axis=1), "root_rot, joint_rot")
    x, y, z = SKELETON.offsets.T
    skeleton = Skeleton(_NAMES, SKELETON.parents, np.stack([x, -z, y], axis=1))
    posed = skeleton.posed(place, [_NAMES.index(name) for name in PARC_JOINTS], known[..., [3, 0, 1, 2]])
    fps, notes = request.rate(rate_of(motion))
    return Capture(skeleton, *posed, fps, str(path), notes, up="+z")
