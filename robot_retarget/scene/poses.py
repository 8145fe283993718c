"""Poses of a body over time from files of other programs: OMOMO, InterMimic, OmniRetarget, and rigid bodies of OptiTrack."""

import csv
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from robot_retarget.base.arrays import Floats
from robot_retarget.base.errors import SceneError, known
from robot_retarget.base.untrusted.arrays import load_npz, rate_of, shaped
from robot_retarget.base.untrusted.limits import refusing
from robot_retarget.base.untrusted.pickles import load_pickle
from robot_retarget.base.untrusted.rotations import checked_quaternions, quaternions_of_matrices, quaternions_of_vectors
from robot_retarget.scene.scene import interpolated

COLUMNS = (("Position", "XYZ"), ("Rotation", "WXYZ"))
"""Channels of a pose and their axes, in the order x y z, w x y z."""
KIND = "Rigid Body"
"""The heading of columns of rigid bodies; those of their markers are `Rigid Body Marker`."""


def read_rigid_body(path: Path, name: str) -> tuple[Floats, float | None, str | None]:
    """Read one rigid body.

    Args:
        path: the CSV.
        name: of the rigid body.

    Returns:
        Poses (T, 7) x y z, w x y z in the file's unit, NaN where the body was not seen; frames per second; the unit.

    Raises:
        SceneError: the file is no export of Motive, rotations are not quaternions, no rigid body has the name, or a cell is no number.
    """
    with path.open(newline="", encoding="utf-8-sig") as file:
        rows = list(csv.reader(file))
    start = next((k for k, row in enumerate(rows) if row and row[0].strip() == "Frame"), None)
    if start is None or start < 3:
        raise SceneError(f"{path}: no CSV export of Motive; expected a row that begins with 'Frame' under the headings")
    facts = dict(zip(rows[0][::2], rows[0][1::2], strict=False))
    if facts.get("Rotation Type", "Quaternion") != "Quaternion":
        raise SceneError(f"{path}:1: rotations are {facts['Rotation Type']}; export them from Motive as quaternions")
    columns = _columns(path, rows[:start], rows[start], name)
    table = [_numbers(path, k, row, columns) for k, row in enumerate(rows[start + 1 :], start + 2) if row]
    rate = facts.get("Export Frame Rate", facts.get("Capture Frame Rate"))
    return np.array(table).reshape(-1, 7), float(rate) if rate else None, facts.get("Length Units")


def _columns(path: Path, headings: list[list[str]], axes: list[str], name: str) -> list[int]:
    """Return the columns of a rigid body, in the order of `COLUMNS`."""
    kinds = next((row for row in headings if KIND in row), [])
    names, channels = headings[headings.index(kinds) + 1] if kinds else [], headings[-1]
    rigid = {k: names[k] for k, kind in enumerate(kinds) if kind == KIND and k < len(names)}
    found = {(channels[k], axes[k]): k for k, title in rigid.items() if title == name and k < len(channels)}
    wanted = [(channel, axis) for channel, letters in COLUMNS for axis in letters]
    if not all(key in found for key in wanted):
        raise SceneError(f"{path}: no rigid body {name!r}; {known(dict.fromkeys(rigid.values()), typed=name)}")
    return [found[key] for key in wanted]


def _numbers(path: Path, line: int, row: list[str], columns: list[int]) -> list[float]:
    """Return the numbers of some columns, NaN where a cell is empty or absent."""
    cells = [row[k] if k < len(row) else "" for k in columns]
    try:
        return [float(cell) if cell.strip() else np.nan for cell in cells]
    except ValueError as error:
        raise SceneError(f"{path}:{line}: {error}") from error


ORDERS = ("wxyz", "xyzw")
INTERMIMIC = slice(318, 325)
"""Columns of InterMimic's rows with the pose of the object: x y z [m], quaternion x y z w."""
POSE_KEYS = ("poses", "object_poses", "object_pose")
LONGEST_GAP = 0.5
"""Longest time in which a body, or a point of a human, was not seen that is bridged [s]; a longer one is refused."""
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
        body: name of the body in the CSV, unless the path names another.
        order: of the quaternions, for arrays whose format does not fix it, of `ORDERS`.

    Raises:
        SceneError: the file does not exist, holds no poses, or does not say the order of its quaternions.
        FileError: the file cannot be read.
    """
    name, mark, part = path.name.partition("#")
    file = path.with_name(name) if name else path
    if not file.is_file():
        raise SceneError(f"no such file: {file}")
    ending = file.suffix.lower()
    if ending not in READERS:
        raise SceneError(f"{file}: poses are read from {known(READERS)}")
    with refusing(file, "file of poses"):
        return READERS[ending](file, part if mark else body, order)


def _motive(file: Path, name: str, order: str | None) -> PoseTable:
    poses, fps, unit = read_rigid_body(file, name)
    return PoseTable(_bridged(poses, fps), fps, "y", unit)


def _bridged(poses: Floats, fps: float | None) -> Floats:
    """Poses (T, 7) whose gaps of up to `LONGEST_GAP` are bridged along the shortest way; longer ones stay NaN."""
    turns = checked_quaternions(poses[:, 3:], "Rotation", gaps=True)
    poses = np.concatenate([poses[:, :3], turns], axis=1)
    seen, frames = np.isfinite(poses).all(axis=1), np.arange(len(poses))
    known = np.flatnonzero(seen)
    if fps is None or not known.size:
        return poses
    led = interpolated(poses[known], np.interp(frames, known, np.arange(len(known))))
    after = known[np.minimum(np.searchsorted(known, frames), len(known) - 1)]
    before = known[np.maximum(np.searchsorted(known, frames, "right") - 1, 0)]
    short = (before < frames) & (frames < after) & (after - before - 1 <= LONGEST_GAP * fps)
    return np.where((seen | short)[:, None], np.where(short[:, None], led, poses), np.nan)


def _pickled(file: Path, name: str, order: str | None) -> PoseTable:
    """Poses in named arrays, or the object's pose in InterMimic's rows, at the 30 frames a second of that data."""
    rows = load_pickle(file)
    if isinstance(rows, dict):
        arrays = {key: value for key, value in rows.items() if isinstance(key, str) and isinstance(value, np.ndarray)}
        return _named(file, arrays, order)
    if not isinstance(rows, np.ndarray) or rows.ndim != 2 or rows.shape[1] < INTERMIMIC.stop:
        raise SceneError(
            f"{file}: expected rows of at least {INTERMIMIC.stop} numbers, as InterMimic's OMOMO files have"
        )
    return PoseTable(_ordered(rows[:, INTERMIMIC].astype(float), "xyzw"), 30.0)


def _archive(file: Path, name: str, order: str | None) -> PoseTable:
    return _named(file, load_npz(file), order)


def _named(file: Path, arrays: Mapping[str, np.ndarray], order: str | None) -> PoseTable:
    """Poses in named arrays: `poses`; `trans` and `angles` of InterAct; `obj_trans` and `obj_rot` or `obj_rot_mat` of OMOMO and
    CHOIS; the last columns of OmniRetarget's `qpos`."""
    fps = rate_of(arrays)
    for key in POSE_KEYS:
        if key in arrays:
            return PoseTable(_ordered(shaped(arrays[key], (None, 7), key), order, f"{file}: {key}"), fps)
    for place, turn in (("trans", "angles"), ("obj_trans", "obj_rot"), ("obj_trans", "obj_rot_mat")):
        if place in arrays and turn in arrays:
            return PoseTable(_turning(arrays[place], arrays[turn], place, turn), fps)
    if "qpos" in arrays and np.ndim(arrays["qpos"]) == 2 and arrays["qpos"].shape[1] > 2 * ROBOT:
        return PoseTable(np.asarray(arrays["qpos"][:, -ROBOT:], float), fps)
    wanted = (*POSE_KEYS, "trans + angles", "obj_trans + obj_rot", "obj_trans + obj_rot_mat", "qpos with an object")
    raise SceneError(f"{file}: no poses of a body among {', '.join(arrays) or 'nothing'}; {known(wanted)}")


def _turning(places: np.ndarray, turns: np.ndarray, place: str, turn: str) -> Floats:
    """Return poses (T, 7) of places (T, 3) and rotations, as vectors (T, 3) [rad] or matrices (T, 3, 3)."""
    where = shaped(places.reshape(len(places), -1), (None, 3), place)
    if turns.shape[1:] == (3, 3):
        made = quaternions_of_matrices(shaped(turns, (len(where), 3, 3), turn), turn)
    else:
        made = quaternions_of_vectors(shaped(turns.reshape(len(turns), -1), (len(where), 3), turn), turn)
    return np.concatenate([where, made], axis=1)


READERS = {".npz": _archive, ".pt": _pickled, ".pkl": _pickled, ".p": _pickled, ".csv": _motive}
"""By the ending of the file name."""


def _ordered(poses: Floats, order: str | None, title: str = "") -> Floats:
    """Return poses with quaternions w x y z."""
    if order is None:
        raise SceneError(f'{title} does not say the order of its quaternions: add order = "wxyz" or order = "xyzw"')
    return poses if order == "wxyz" else poses[:, [0, 1, 2, 6, 3, 4, 5]]
