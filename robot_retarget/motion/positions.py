"""Joint positions as arrays: `.npy` and `.npz` of shape (T, J, 3), with joint names or from a known set of joints."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
from scipy.spatial.transform import Rotation

from robot_retarget.arrays import Floats, Ints
from robot_retarget.errors import MotionError, known
from robot_retarget.motion.capture import Capture
from robot_retarget.motion.joint_sets import JOINT_SETS, JointSet
from robot_retarget.motion.skeleton import Skeleton
from robot_retarget.motion.tree import infer_parents, sorted_tree

POSITION_KEYS = ("positions", "joints", "posed_joints", "joint_positions", "joints3d", "xyz")
ROTATION_KEYS = ("rotations", "global_rot_mats", "global_rotations")
NAME_KEYS = ("names", "joint_names")
FPS_KEYS = ("fps", "framerate", "frame_rate", "mocap_framerate")
DEFAULT_FPS = 30.0


def read_positions(path: Path, fps: float | None = None, names: Sequence[str] | None = None) -> Capture:
    """Read an array of joint positions (T, J, 3).

    An `.npz` may hold `names`, `parents`, `fps` and rotations in the world frame, (T, J, 4) w x y z or (T, J, 3, 3).

    Raises:
        MotionError: no such array, a wrong shape, joints that no known set has, or a number that is not finite.
    """
    arrays = _arrays(path)
    positions = _positions(arrays, path)
    notes: list[str] = []
    joints = _joint_set(arrays, names, positions, path, notes)
    skeleton, order = _skeleton(joints, positions)
    rotations = _rotations(arrays, positions, path)
    return Capture(
        skeleton,
        positions[:, order],
        None if rotations is None else rotations[:, order],
        fps or _fps(arrays, joints, path, notes),
        str(path),
        tuple(notes),
    )


def _arrays(path: Path) -> dict[str, Any]:
    try:
        loaded = np.load(path, allow_pickle=False)
        return {"positions": loaded} if isinstance(loaded, np.ndarray) else dict(loaded.items())
    except (ValueError, EOFError, BadZipFile) as error:
        raise MotionError(f"not an array file that numpy reads without pickle: {error}", path) from error


def _first(arrays: Mapping[str, Any], keys: Sequence[str]) -> Any | None:
    return next((arrays[key] for key in keys if key in arrays), None)


def _positions(arrays: Mapping[str, Any], path: Path) -> Floats:
    values = _first(arrays, POSITION_KEYS)
    if values is None:
        shaped = [array for array in arrays.values() if array.ndim == 3 and array.shape[2] == 3]
        values = shaped[0] if len(shaped) == 1 else None
    if values is None:
        raise MotionError(f"no array of positions among {', '.join(arrays) or 'nothing'}; {known(POSITION_KEYS)}", path)
    if values.ndim != 3 or values.shape[2] != 3 or 0 in values.shape or values.dtype.kind not in "fiu":
        raise MotionError(f"positions must be numbers (T, J, 3), got {values.dtype} {values.shape}", path)
    return values.astype(float)


def _joint_set(
    arrays: Mapping[str, Any], names: Sequence[str] | None, positions: Floats, path: Path, notes: list[str]
) -> JointSet:
    count = positions.shape[1]
    stored = _first(arrays, NAME_KEYS)
    called = tuple(names) if names is not None else () if stored is None else tuple(stored.astype(str).ravel().tolist())
    parents = arrays.get("parents")
    if not called:
        for joints in JOINT_SETS:
            if len(joints.names) == count:
                notes.append(f"{count} joints without names: taken as {joints.title}.")
                return joints
        sets = (f"{len(joints.names)} ({joints.title})" for joints in JOINT_SETS)
        raise MotionError(f"{count} joints without names are no known set; {known(sets)}", path)
    if len(called) != count or len(set(called)) != count:
        raise MotionError(f"{count} joints need as many different names, got {len(set(called))} of {len(called)}", path)
    for joints in JOINT_SETS:
        if called == joints.names and parents is None:
            return joints
    if parents is None:
        notes.append("No parents are given: the tree was found from distances that stay the same.")
        parents = infer_parents(positions)
    parents = np.asarray(parents)
    if parents.shape != (count,) or parents.dtype.kind not in "iu" or not np.all((parents >= -1) & (parents < count)):
        raise MotionError(f"parents must be {count} indices of joints, −1 at a root", path)
    return JointSet("its own joints", called, tuple(parents.tolist()), None)


def _skeleton(joints: JointSet, positions: Floats) -> tuple[Skeleton, Ints]:
    """The tree with parents before children and the offsets of the first frame, and the order of its joints."""
    parents, order = sorted_tree(np.array(joints.parents))
    placed = positions[0, order]
    offsets = np.where(parents[:, None] < 0, 0.0, placed - placed[np.maximum(parents, 0)])
    return Skeleton(tuple(joints.names[k] for k in order), parents, offsets), order


def _rotations(arrays: Mapping[str, Any], positions: Floats, path: Path) -> Floats | None:
    values = _first(arrays, ROTATION_KEYS)
    if values is None:
        return None
    if values.shape not in ((*positions.shape[:2], 4), (*positions.shape[:2], 3, 3)):
        raise MotionError(
            f"rotations must be (T, J, 4) or (T, J, 3, 3) for {positions.shape}, got {values.shape}", path
        )
    try:
        if values.ndim == 4:
            turns = Rotation.from_matrix(values.reshape(-1, 3, 3).astype(float))
        else:
            turns = Rotation.from_quat(values.reshape(-1, 4).astype(float), scalar_first=True)
    except ValueError as error:
        raise MotionError(f"rotations: {error}", path) from error
    return turns.as_quat(scalar_first=True).reshape(*positions.shape[:2], 4)


def _fps(arrays: Mapping[str, Any], joints: JointSet, path: Path, notes: list[str]) -> float:
    stored = _first(arrays, FPS_KEYS)
    if stored is not None:
        if stored.size != 1 or stored.dtype.kind not in "fiu" or not 0 < stored.item() < np.inf:
            raise MotionError(f"frames per second must be one positive number, got {stored}", path)
        return float(stored.item())
    value = joints.fps or DEFAULT_FPS
    notes.append(f"The file says no frame rate; {value:g} frames per second were taken.")
    return value
