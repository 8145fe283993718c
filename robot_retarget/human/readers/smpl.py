"""Where the joints of the SMPL family are at rest, with no body model or with the user's."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from robot_retarget.base.arrays import Floats, Ints
from robot_retarget.base.errors import MotionError
from robot_retarget.base.untrusted.arrays import load_arrays, rate_of
from robot_retarget.base.untrusted.rotations import quaternions_of_matrices, quaternions_of_vectors
from robot_retarget.human.capture import USUAL_FPS, Capture, FileHeader, Request
from robot_retarget.human.readers.points import bridged
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


# Parameters of the SMPL family, with no body model: AMASS files and what programs compute from video and music.


@dataclass(frozen=True)
class BodyLayout:
    """The names of the arrays of one body over time in a program's files; of several names the first present one counts."""

    program: str
    whole: tuple[str, ...] = ()
    """Turns of root and joints together (T, 3 n), n at least 22, or as matrices (T, n, 3, 3) or (T, 9 n)."""
    root: tuple[str, ...] = ()
    body: tuple[str, ...] = ()
    """Turns of the root and of the joints in separate arrays."""
    place: tuple[str, ...] = ()
    means: Literal["shift", "pelvis", "origin"] = "shift"
    """Meaning of the place: a shift of the posed body, the place of the pelvis, or that of the point about which the root turns."""
    shape: tuple[str, ...] = ("betas",)
    frames: tuple[str, ...] = ()
    """Numbers (T,) of the frames that show the person, or for every frame whether it does."""
    flat: bool = False
    """Whether turns are matrices in rows."""
    camera: bool = False
    """Whether the body is in the frame of the camera: x right, y down, z away."""
    beside: tuple[str, ...] = ()
    """Further names by which the program is known."""

    def fits(self, names: Collection[str]) -> bool:
        """Return whether the names include turns."""
        groups = (self.whole,) if self.whole and any(k in names for k in self.whole) else (self.root, self.body)
        return all(any(k in names for k in group) for group in groups) and all(name in names for name in self.beside)


TRAM = "pred_rotmat"
LAYOUTS = (
    BodyLayout("EDGE", ("smpl_poses",), place=("smpl_trans",), means="pelvis", beside=("full_pose",)),
    BodyLayout("TRAM", (TRAM,), place=("pred_trans",), shape=("pred_shape",), frames=("frame",), camera=True),
    BodyLayout("HybrIK", ("pred_thetas",), place=("transl",), means="pelvis", shape=("pred_betas",), flat=True, camera=True),
    BodyLayout("ROMP", ("smpl_thetas",), place=("cam_trans",), shape=("smpl_betas",), frames=("frame_id",), camera=True),
    BodyLayout("Multi-HMR", ("rotvec",), place=("transl_pelvis",), means="pelvis", shape=("shape",), camera=True),
    BodyLayout("VIBE", ("pose",), frames=("frame_ids",), camera=True, beside=("orig_cam",)),
    BodyLayout(
        "GLAMR",
        root=("smpl_orient_world", "smpl_orient_cam"),
        body=("smpl_pose",),
        place=("root_trans_world", "root_trans_cam"),
        means="pelvis",
        shape=("smpl_beta",),
        frames=("exist_frames",),
    ),
    BodyLayout("EasyMocap", root=("Rh",), body=("poses",), place=("Th",), means="origin", shape=("shapes",), frames=("frames",)),
    BodyLayout(
        "another program",
        ("pose_world", "poses", "pose", "full_pose", "fullpose", "smpl_poses"),
        ("root_orient", "global_orient"),
        ("pose_body", "body_pose"),
        ("trans_world", "trans", "transl", "translation", "smpl_trans"),
        shape=("betas", "shape"),
        frames=("frames", "frame_ids", "frame_id"),
    ),
)  # fmt: skip
"""The first layout that fits reads the file. The last one is of AMASS, AIST++, GVHMR, GENMO, WHAM, PromptHMR, SLAHMR and 4D-Humans:
turns in the world stand before those in a camera."""
SCALE = "smpl_scaling"
"""Of AIST++: places are in metres times this number."""
SOMA = "identity_coeffs"
"""The shape of SOMA's body, whose 77 joints are not those of SMPL."""
AIST_FPS = 60.0
"""Of the motions of AIST++ [1/s], as its library states."""
WORLD_CAMERA = ("world_cam_R", "world_cam_T")
"""TRAM's camera in the world over all frames of the video: turns (F, 3, 3) and places (F, 3) [m]."""
_PREFIXES = ("", "smpl_params_global/", "smpl_params_global.", "smpl_params_global_")


def matches_format(header: FileHeader) -> bool:
    """Whether an `.npz` holds turns of a body by one of their names."""
    return holds_turns(_bare(dict.fromkeys(header.arrays)))


def holds_turns(arrays: Mapping[str, Any]) -> bool:
    """Whether there are turns of a body among arrays, by their names."""
    return SOMA not in arrays and any(layout.fits(arrays.keys()) for layout in LAYOUTS)


def read(path: Path, request: Request) -> Capture:
    """Read turns of the SMPL family's joints and let them turn a rest skeleton.

    Raises:
        MotionError: a field is missing or of another width; names it and the expected width.
    """
    arrays = _bare(load_arrays(path))
    people = persons(arrays)
    which, notes = request.choose(list(people), path)
    capture = captured(people[list(people)[which]], path, request)
    return replace(capture, notes=(*notes, *capture.notes))


def persons(arrays: Mapping[str, Any]) -> dict[str, Mapping[str, Any]]:
    """Return the arrays of each person by number, where all have an axis of people before that of frames, as SLAHMR's have."""
    rows = {name: np.asarray(arrays[name]) for name in ("trans", "root_orient", "pose_body") if name in arrays}
    if len(rows) < 3 or any(values.ndim != 3 for values in rows.values()) or rows["trans"].shape[2] != 3:
        return {"0": arrays}
    betas = np.asarray(arrays.get("betas", np.zeros((len(rows["trans"]), 0))))
    fps = {"fps": rate} if (rate := rate_of(arrays)) else {}
    return {
        str(k): {name: values[k] for name, values in rows.items()} | {"betas": betas[k]} | fps
        for k in range(len(rows["trans"]))
    }


def captured(arrays: Mapping[str, Any], path: Path, request: Request) -> Capture:
    """Make a capture from the arrays of one body; as `read`. Frames without the person are bridged, up to half a second."""
    layout = next((layout for layout in LAYOUTS if layout.fits(arrays.keys())), LAYOUTS[-1])
    turns = _turns(arrays, layout, path)
    place, notes = _place(arrays, layout, len(turns), path)
    betas = _betas(arrays, layout, path)
    skeleton, note = mean_skeleton(betas) if request.body_model is None else model_skeleton(request.body_model, betas)
    rows, frames = _seen(arrays, layout, len(turns))
    turns, rest = turns[rows], skeleton.offsets[0].copy()
    root = Rotation.from_quat(turns[:, 0], scalar_first=True)
    pelvis = place[rows] + {"shift": rest, "pelvis": 0.0, "origin": root.apply(rest)}[layout.means]
    moved = WORLD_CAMERA[0] in arrays
    if moved:
        camera = Rotation.from_matrix(np.asarray(arrays[WORLD_CAMERA[0]], dtype=float)[frames])
        turns[:, 0] = (camera * root).as_quat(scalar_first=True)
        pelvis = camera.apply(pelvis) + np.asarray(arrays[WORLD_CAMERA[1]], dtype=float)[frames]
    posed = skeleton.posed(pelvis, range(JOINTS), turns)
    fps, rate_notes = request.rate(rate_of(arrays), AIST_FPS if SCALE in arrays else USUAL_FPS)
    notes, up = (note, *notes, *rate_notes), "-y" if layout.camera and not moved else None
    return _bridged(Capture(skeleton, *posed, fps, str(path), notes, up=up, camera=True), frames)


def _bare(arrays: Mapping[str, Any]) -> dict[str, Any]:
    """The arrays by names without the prefix that a nested result was written with."""
    best = max(_PREFIXES, key=lambda prefix: (prefix != "") * sum(name.startswith(prefix) for name in arrays))
    inside = {name.removeprefix(best): value for name, value in arrays.items() if name.startswith(best)}
    return {**arrays, **inside}


def _first(arrays: Mapping[str, Any], keys: tuple[str, ...]) -> tuple[str, Any | None]:
    return next(((key, arrays[key]) for key in keys if key in arrays), ("", None))


def _turns(arrays: Mapping[str, Any], layout: BodyLayout, path: Path) -> Floats:
    """(T, 22, 4) w x y z of the joints in their parents, from vectors of rotation or matrices."""
    root_key, root = _first(arrays, layout.root)
    body_key, body = _first(arrays, layout.body)
    if root is not None and body is not None:
        body = np.asarray(body)
        if body.ndim == 2 and body.shape[1] == 3 * len(NAMES):
            body = body[:, 3:]
        parts = _quaternions(root, 1, root_key, path), _quaternions(body, JOINTS - 1, body_key, path)
        if len(parts[0]) != len(parts[1]):
            raise MotionError(f"{root_key} has {len(parts[0])} frames, {body_key} {len(parts[1])}", path)
        return np.concatenate(parts, axis=1)
    key, whole = _first(arrays, layout.whole)
    if whole is None:
        generic = LAYOUTS[-1]
        wanted = f"{generic.whole[1]}, or {' or '.join(generic.root)} with {' or '.join(generic.body)}"
        raise MotionError(f"no turns of a body: expected {wanted}; it has {', '.join(arrays)}", path)
    whole = np.asarray(whole)
    if layout.flat and whole.ndim == 2 and whole.shape[1] % 9 == 0:
        whole = whole.reshape(len(whole), -1, 3, 3)
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


def _place(arrays: Mapping[str, Any], layout: BodyLayout, frames: int, path: Path) -> tuple[Floats, tuple[str, ...]]:
    """(T, 3) the place of the body, by the layout's meaning; 0 where the file does not say."""
    key, values = _first(arrays, layout.place)
    if values is None:
        names = f"No {' or '.join(layout.place[:3])}" if layout.place else f"{layout.program} gives no place in space"
        return np.zeros((frames, 3)), (f"{names}: the body stays in place.",)
    values = np.asarray(values)
    if values.size != 3 * frames or values.dtype.kind not in "fiu" or not np.isfinite(values).all():
        raise MotionError(f"{key}: expected finite numbers ({frames}, 3), got {values.dtype} {values.shape}", path)
    scale = np.asarray(arrays.get(SCALE, 1.0), dtype=float)
    if scale.size != 1 or not 0 < scale.item() < np.inf:
        raise MotionError(f"{SCALE}: expected one positive number, got {scale}", path)
    return values.astype(float).reshape(frames, 3) / scale.item(), ()


def _betas(arrays: Mapping[str, Any], layout: BodyLayout, path: Path) -> Floats | None:
    """The shape's parameters (B,), their mean where every frame has its own."""
    key, values = _first(arrays, layout.shape)
    if values is None or np.asarray(values).size == 0:
        return None
    values = np.asarray(values)
    if values.dtype.kind not in "fiu" or not np.isfinite(values).all():
        raise MotionError(f"{key}: expected finite numbers, got {values.dtype} {values.shape}", path)
    return values.astype(float).reshape(-1, values.shape[-1]).mean(axis=0)


def _seen(arrays: Mapping[str, Any], layout: BodyLayout, count: int) -> tuple[Ints, Ints]:
    """The rows (N,) that show the person, and their numbers in the video: all rows where the file does not say."""
    rows, (_, values) = np.arange(count), _first(arrays, layout.frames)
    numbers = rows if values is None else np.asarray(values)
    if numbers.shape == (count,) and numbers.dtype.kind == "b" and numbers.any():
        return rows[numbers], rows[numbers]
    rising = numbers.shape == (count,) and numbers.dtype.kind in "iu" and (np.diff(numbers.astype(int)) > 0).all()
    return rows, numbers.astype(int) if rising else rows


def _bridged(capture: Capture, frames: Ints) -> Capture:
    """The capture at every frame from the first to the last, of the frames in which the person is seen."""
    every = np.arange(frames[0], frames[-1] + 1)
    if len(every) == len(frames):
        return capture
    positions = np.full((len(every), *capture.positions.shape[1:]), np.nan)
    positions[frames - frames[0]] = capture.positions
    positions, _, notes = bridged(positions, capture.skeleton.names, capture.fps, capture.source)
    assert capture.rotations is not None
    turns = [Slerp(frames, Rotation.from_quat(q, scalar_first=True))(every) for q in capture.rotations.swapaxes(0, 1)]
    rotations = np.stack([turn.as_quat(scalar_first=True) for turn in turns], axis=1)
    return replace(capture, positions=positions, rotations=rotations, notes=(*capture.notes, *notes))
