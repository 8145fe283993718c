"""Poses of a body over time from files of other programs: OMOMO, InterMimic, OmniRetarget, OptiTrack."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from robot_retarget.arrays import Floats
from robot_retarget.errors import FileError, SceneError, known
from robot_retarget.scene.formats import optitrack
from robot_retarget.untrusted.arrays import load_npz
from robot_retarget.untrusted.fields import rate_of
from robot_retarget.untrusted.pickles import load_pickle

ORDERS = ("wxyz", "xyzw")
INTERMIMIC = slice(318, 325)
"""Columns of InterMimic's rows with the pose of the object: x y z [m], quaternion x y z w."""
POSE_KEYS = ("poses", "object_poses", "object_pose")
ROBOT = 7
"""Columns of a root before the joints of a robot, and of an object behind them."""


@dataclass(frozen=True, eq=False)
class PoseTable:
    """Poses of one body over time, as a file has them."""

    poses: Floats
    """(T, 7) x y z, quaternion w x y z; NaN where the body was not seen."""
    fps: float | None = None
    """[1/s]"""
    up: str = "z"
    """The axis of the file that points up."""
    unit: str | None = None
    """The unit that the file states, or None."""


def read_poses(path: Path, body: str, order: str | None) -> PoseTable:
    """Read the poses of a body.

    Args:
        path: an `.npz`, `.pt` or `.csv`; `FILE#NAME` names a rigid body in a CSV.
        body: name of the body, for messages, and in the CSV unless the path names another.
        order: of the quaternions, for arrays whose format does not fix it: `wxyz` or `xyzw`.

    Raises:
        SceneError: the file cannot be read, holds no poses, or does not say the order of its quaternions.
    """
    if order is not None and order not in ORDERS:
        raise SceneError(f"body {body!r}: no order of quaternions {order!r}; {known(ORDERS)}")
    name, mark, part = path.name.partition("#")
    file = path.with_name(name)
    if not file.is_file():
        raise SceneError(f"body {body!r}: no such file: {file}")
    if file.suffix.lower() == ".csv":
        found, fps, unit = optitrack.read(file, part if mark else body)
        return PoseTable(found, fps, "y", unit)
    try:
        return _rows(file, load_pickle(file)) if file.suffix.lower() == ".pt" else _arrays(file, load_npz(file), order)
    except FileError as error:
        raise SceneError(f"body {body!r}: {error}") from error


def _rows(file: Path, rows: object) -> PoseTable:
    """The object's pose in InterMimic's rows, at the 30 frames a second of that data."""
    if not isinstance(rows, np.ndarray) or rows.ndim != 2 or rows.shape[1] < INTERMIMIC.stop:
        raise SceneError(
            f"{file}: expected rows of at least {INTERMIMIC.stop} numbers, as InterMimic's OMOMO files have"
        )
    return PoseTable(_ordered(rows[:, INTERMIMIC].astype(float), "xyzw"), 30.0)


def _arrays(file: Path, arrays: Mapping[str, np.ndarray], order: str | None) -> PoseTable:
    """Poses in named arrays: `poses`; OMOMO's and InterMimic's `trans` and `angles` or `obj_trans` and `obj_rot`; the
    last columns of OmniRetarget's `qpos`."""
    fps = rate_of(arrays)
    for key in POSE_KEYS:
        if key in arrays:
            return PoseTable(_ordered(_table(file, key, arrays[key], 7), order, f"{file}: {key}"), fps)
    for place, turn in (("trans", "angles"), ("obj_trans", "obj_rot")):
        if place in arrays and turn in arrays:
            places = np.asarray(arrays[place], float).reshape(-1, 3)
            rows = np.asarray(arrays[turn], float).reshape(len(places), -1)
            made = Rotation.from_matrix(rows.reshape(-1, 3, 3)) if rows.shape[1] == 9 else Rotation.from_rotvec(rows)
            return PoseTable(np.concatenate([places, made.as_quat(scalar_first=True)], axis=1), fps)
    if "qpos" in arrays and np.ndim(arrays["qpos"]) == 2 and arrays["qpos"].shape[1] > 2 * ROBOT:
        return PoseTable(np.asarray(arrays["qpos"][:, -ROBOT:], float), fps)
    wanted = (*POSE_KEYS, "trans + angles", "obj_trans + obj_rot", "qpos with an object")
    raise SceneError(f"{file}: no poses of a body among {', '.join(arrays) or 'nothing'}; {known(wanted)}")


def _table(file: Path, key: str, values: np.ndarray, width: int) -> Floats:
    if values.ndim != 2 or values.shape[1] != width:
        raise SceneError(f"{file}: {key} must be (T, {width}), got {values.shape}")
    return np.asarray(values, float)


def _ordered(poses: Floats, order: str | None, title: str = "") -> Floats:
    """Return poses with quaternions w x y z."""
    if order is None:
        raise SceneError(f'{title} does not say the order of its quaternions: add order = "wxyz" or order = "xyzw"')
    return poses if order == "wxyz" else poses[:, [0, 1, 2, 6, 3, 4, 5]]
