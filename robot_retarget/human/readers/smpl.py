"""Where the joints of the SMPL family are at rest, with no body model or with the user's."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from robot_retarget.base.arrays import Floats
from robot_retarget.base.errors import MotionError
from robot_retarget.base.untrusted.arrays import load_arrays, rate_of
from robot_retarget.base.untrusted.rotations import quaternions_of_matrices, quaternions_of_vectors
from robot_retarget.human.capture import USUAL_FPS, Capture, FileHeader, Request
from robot_retarget.human.readers.positions import SMPL
from robot_retarget.human.skeleton import Skeleton

JOINTS = 22
"""Of the body, in the order of the format of SMPL, SMPL-H and SMPL-X."""
NAMES, PARENTS = SMPL.names, np.array(SMPL.parent_indices(SMPL.names))
_MEAN = np.array(list((SMPL.places or {}).values()))
"""(J, 3) place of each joint in its parent in the rest pose of the mean body, x to the left, y up, z ahead [m], of the format."""
_STATURE, _PER_BETA = 1.66, 0.1
"""Of the mean body, and how much the first shape parameter adds to it: the rule of GMR's library for SMPL-X files [m]."""


def mean_skeleton(betas: Floats | None) -> tuple[Skeleton, str]:
    """The mean body, as tall as the first of the shape parameters says, and a sentence; limbs are right to centimetres."""
    first = float(betas[0]) if betas is not None and betas.size else 0.0
    tall = max(_STATURE + _PER_BETA * first, 0.5 * _STATURE)
    note = f"Without a body model the mean SMPL skeleton was taken, {tall:.2f} m tall; bones are right to centimetres."
    return Skeleton(NAMES, PARENTS, _MEAN * tall / _STATURE), note


def model_skeleton(path: Path, betas: Floats | None) -> tuple[Skeleton, str]:
    """The joints of the user's body model: J (v + S β), with J `J_regressor`, v `v_template` and S `shapedirs`.

    Raises:
        MotionError: it is no `.npz` with these arrays, or they do not fit each other.
    """
    arrays = load_arrays(path)
    lacking = [key for key in ("J_regressor", "v_template") if key not in arrays]
    if lacking:
        raise MotionError(f"a body model needs the array {lacking[0]!r}; it has {', '.join(arrays)}", path)
    regressor, vertices = (np.asarray(arrays[key], dtype=float) for key in ("J_regressor", "v_template"))
    if "shapedirs" in arrays and betas is not None:
        count = min(betas.size, arrays["shapedirs"].shape[-1])
        vertices = vertices + arrays["shapedirs"][..., :count] @ betas[:count]
    if regressor.ndim != 2 or regressor.shape[0] < JOINTS or vertices.shape != (regressor.shape[1], 3):
        raise MotionError(f"J_regressor {regressor.shape} does not fit v_template {vertices.shape}", path)
    place = regressor[:JOINTS] @ vertices
    offsets = place - np.where(PARENTS[:JOINTS, None] < 0, 0.0, place[np.maximum(PARENTS[:JOINTS], 0)])
    return Skeleton(NAMES, PARENTS, np.concatenate([offsets, _MEAN[JOINTS:]])), f"The skeleton is that of {path.name}."


# Parameters of the SMPL family: AMASS files and what video trackers (GVHMR, WHAM) give, with no body model.

WHOLE = ("pose_world", "poses", "pose", "full_pose", "fullpose", "smpl_poses")
"""The turns of root and joints together (T, 3 n), n at least 22; those in the world before those in a camera."""
ROOT = ("root_orient", "global_orient")
BODY = ("pose_body", "body_pose")
PLACE = ("trans_world", "trans", "transl", "translation", "smpl_trans")
SCALE = "smpl_scaling"
"""Of AIST++: places are in metres times this number."""
SOMA = "identity_coeffs"
"""The shape of SOMA's body, whose 77 joints are not those of SMPL."""
AIST_FPS = 60.0
"""Of the motions of AIST++ [1/s], as its library states."""
_PREFIXES = ("", "smpl_params_global/", "smpl_params_global.", "smpl_params_global_")


def matches_format(header: FileHeader) -> bool:
    """Whether an `.npz` holds turns of a body by one of their names."""
    return holds_turns(_bare(dict.fromkeys(header.arrays)))


def holds_turns(arrays: Mapping[str, Any]) -> bool:
    """Whether there are turns of a body among arrays, by their names."""
    if SOMA in arrays:
        return False
    return bool(arrays.keys() & set(WHOLE) or (arrays.keys() & set(BODY) and arrays.keys() & set(ROOT)))


def read(path: Path, request: Request) -> Capture:
    """Read turns of the SMPL family's joints and let them turn a rest skeleton.

    Raises:
        MotionError: a field is missing or of another width; names it and the expected width.
    """
    return captured(_bare(load_arrays(path)), path, request)


def captured(arrays: Mapping[str, Any], path: Path, request: Request) -> Capture:
    """Make a capture from the arrays of one body; as `read`."""
    turns = _turns(arrays, path)
    place, notes = _place(arrays, len(turns), path)
    betas = _betas(arrays, path)
    skeleton, note = mean_skeleton(betas) if request.body_model is None else model_skeleton(request.body_model, betas)
    posed = skeleton.posed(skeleton.offsets[0] + place, range(JOINTS), turns)
    fps, rate_notes = request.rate(rate_of(arrays), AIST_FPS if SCALE in arrays else USUAL_FPS)
    return Capture(skeleton, *posed, fps, str(path), (note, *notes, *rate_notes))


def _bare(arrays: Mapping[str, Any]) -> dict[str, Any]:
    """The arrays by names without the prefix that a nested result was written with."""
    best = max(_PREFIXES, key=lambda prefix: (prefix != "") * sum(name.startswith(prefix) for name in arrays))
    inside = {name.removeprefix(best): value for name, value in arrays.items() if name.startswith(best)}
    return {**arrays, **inside}


def _first(arrays: Mapping[str, Any], keys: tuple[str, ...]) -> tuple[str, Any | None]:
    return next(((key, arrays[key]) for key in keys if key in arrays), (keys[0], None))


def _turns(arrays: Mapping[str, Any], path: Path) -> Floats:
    """(T, 22, 4) w x y z of the joints in their parents, from vectors of rotation or matrices."""
    root_key, root = _first(arrays, ROOT)
    body_key, body = _first(arrays, BODY)
    if root is not None and body is not None:
        parts = _quaternions(root, 1, root_key, path), _quaternions(body, JOINTS - 1, body_key, path)
        if len(parts[0]) != len(parts[1]):
            raise MotionError(f"{root_key} has {len(parts[0])} frames, {body_key} {len(parts[1])}", path)
        return np.concatenate(parts, axis=1)
    key, whole = _first(arrays, WHOLE)
    if whole is None:
        wanted = f"{WHOLE[1]}, or {' or '.join(ROOT)} with {' or '.join(BODY)}"
        raise MotionError(f"no turns of a body: expected {wanted}; it has {', '.join(arrays)}", path)
    return _quaternions(whole, JOINTS, key, path)


def _quaternions(values: Any, least: int, key: str, path: Path) -> Floats:
    """(T, least, 4) of the first joints of (T, 3 n), (T, n, 3) or (T, n, 3, 3)."""
    values = np.asarray(values)
    if values.dtype.kind not in "fiu" or values.ndim < 2 or not len(values):
        raise MotionError(f"{key}: expected numbers (T, {3 * least}), got {values.dtype} {values.shape}", path)
    if not np.isfinite(values).all():
        raise MotionError(f"{key}: frame {int(np.argwhere(~np.isfinite(values))[0, 0])} is not finite", path)
    square = values.ndim >= 3 and values.shape[-2:] == (3, 3) and values.size % (9 * len(values)) == 0
    flat = values.astype(float).reshape(len(values), -1)
    size = 9 if square and (values.ndim == 4 or least == 1) else 3
    if flat.shape[1] % size or flat.shape[1] < size * least:
        raise MotionError(
            f"{key}: expected {3 * least} numbers a frame or more, a joint three, got {values.shape}", path
        )
    first = flat[:, : size * least].reshape(-1, size)
    matrices = first.reshape(-1, 3, 3) if size == 9 else None
    turns = quaternions_of_vectors(first, key) if matrices is None else quaternions_of_matrices(matrices, key)
    return turns.reshape(len(values), least, 4)


def _place(arrays: Mapping[str, Any], frames: int, path: Path) -> tuple[Floats, tuple[str, ...]]:
    """(T, 3) how far the root is from its place at rest; 0 where the file does not say."""
    key, values = _first(arrays, PLACE)
    if values is None:
        return np.zeros((frames, 3)), (f"No {' or '.join(PLACE[1:3])}: the body stays in place.",)
    values = np.asarray(values)
    if values.size != 3 * frames or values.dtype.kind not in "fiu" or not np.isfinite(values).all():
        raise MotionError(f"{key}: expected finite numbers ({frames}, 3), got {values.dtype} {values.shape}", path)
    scale = np.asarray(arrays.get(SCALE, 1.0), dtype=float)
    if scale.size != 1 or not 0 < scale.item() < np.inf:
        raise MotionError(f"{SCALE}: expected one positive number, got {scale}", path)
    return values.astype(float).reshape(frames, 3) / scale.item(), ()


def _betas(arrays: Mapping[str, Any], path: Path) -> Floats | None:
    """The shape's parameters (B,), their mean where every frame has its own."""
    values = arrays.get("betas")
    if values is None or np.asarray(values).size == 0:
        return None
    values = np.asarray(values)
    if values.dtype.kind not in "fiu" or not np.isfinite(values).all():
        raise MotionError(f"betas: expected finite numbers, got {values.dtype} {values.shape}", path)
    return values.astype(float).reshape(-1, values.shape[-1]).mean(axis=0)
