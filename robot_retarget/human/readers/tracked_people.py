"""People that trackers found in video, and other pickles read as data: nested dicts (`.pt` of GVHMR and GENMO, `.pkl` of WHAM,
VIBE, PromptHMR and GLAMR, `.npy` of TRAM), frames of 4D-Humans, Multi-HMR, ROMP and SAM 3D Body, folders of EasyMocap, and
InterMimic's rows of numbers, which hold positions of joints.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from math import hypot
from pathlib import Path
from typing import Any

import numpy as np

from robot_retarget.base.arrays import Floats
from robot_retarget.base.errors import MotionError
from robot_retarget.base.untrusted import documents
from robot_retarget.base.untrusted.arrays import load_npz, rate_of
from robot_retarget.base.untrusted.limits import LIMITS, ZLIB_MAGIC, too_large
from robot_retarget.base.untrusted.pickles import load_pickle, parse_pickle
from robot_retarget.human.capture import Capture, FileHeader, Request
from robot_retarget.human.readers import datasets, positions
from robot_retarget.human.readers.points import LabelledPoints, labelled_capture
from robot_retarget.human.readers.smpl import SOMA, TRAM, WORLD_CAMERA, captured, holds_turns

# Results of video frame by frame, people with parameters of the SMPL family in the frame of the camera.
#
# 4D-Humans (tracks of PHALP): a dict of frames, each with lists over people, `smpl` (`global_orient` (1, 3, 3), `body_pose`
# (23, 3, 3), `betas` (10,)), `camera` (3,) [m], `tid`, `size` (height, width) and `tracked_time`, 0 where the person is seen.
# Multi-HMR: a list of frames, each a list of people with `rotvec` (53, 3), `transl_pelvis` (3,) [m] and `shape`.
# ROMP and BEV (`results` of `video_results.npz`): a dict of frames with `smpl_thetas` (P, 72), `cam_trans` (P, 3) [m], `smpl_betas`
# and, where people are tracked, `track_ids` (P,).

FOCAL = 5000 / 256
"""The focal length that the library 4D-Humans assumes, by the longer side of the picture [-]. Places away from the camera are too far by its
ratio to the true one, for which the picture's diagonal is taken."""


def holds_smpl_people(content: Any) -> bool:
    """Whether a pickle is a dict of PHALP's or ROMP's frames or a list of Multi-HMR's."""
    frames = content.values() if isinstance(content, Mapping) else content if isinstance(content, list | tuple) else ()
    return any(True for frame in frames for _ in _people(frame))


def smpl_people(content: Any, path: Path, request: Request) -> Capture:
    """Make a capture of the first person, or of the requested one; gaps of up to half a second are bridged.

    Raises:
        MotionError: a field has another shape, or the person is away for longer.
    """
    frames = list(content.values()) if isinstance(content, Mapping) else list(content)
    people: dict[str, dict[int, dict[str, Any]]] = {}
    for t, frame in enumerate(frames):
        for name, person in _people(frame):
            people.setdefault(name, {})[t] = person
    which, notes = request.choose(list(people), path)
    seen = people[list(people)[which]]
    fields = {key: np.array([one[key] for one in seen.values()]) for key in next(iter(seen.values()))}
    found = captured({**fields, "frames": np.array(list(seen))}, path, request)
    return replace(found, notes=(*notes, *found.notes), up="-y")


def _people(frame: Any) -> Iterator[tuple[str, dict[str, Any]]]:
    """The people of a frame by name, with the fields of SMPL's parameters."""
    if isinstance(frame, Mapping) and {"smpl", "tid", "camera"} <= frame.keys():
        for k, (name, body, place) in enumerate(zip(frame["tid"], frame["smpl"], frame["camera"], strict=True)):
            if not frame.get("tracked_time", {k: 0})[k]:
                tall, wide = frame["size"][k]
                nearer = [1.0, 1.0, hypot(tall, wide) / (FOCAL * max(tall, wide))]
                yield str(name), {**body, "transl": np.asarray(place, dtype=float).reshape(-1)[:3] * nearer}
    elif isinstance(frame, Mapping) and {"smpl_thetas", "cam_trans", "smpl_betas"} <= frame.keys():
        for k, thetas in enumerate(frame["smpl_thetas"]):
            name = frame["track_ids"][k] if "track_ids" in frame else k
            yield str(name), {"smpl_thetas": thetas, **{key: frame[key][k] for key in ("cam_trans", "smpl_betas")}}
    elif isinstance(frame, list | tuple):
        for k, one in enumerate(frame):
            if isinstance(one, Mapping) and {"rotvec", "transl_pelvis"} <= one.keys():
                yield str(k), {key: np.asarray(one[key]).reshape(-1) for key in ("rotvec", "transl_pelvis", "shape")}


# Sentences about pickles without parameters of a human body.

ROBOT_KEYS = (
    {"root_pos", "dof_pos"},
    {"root_trans_offset", "dof"},
    {"loop_mode", "frames"},
    {"timed_sequence", "qpos"},
)
SAVE = "save them as .npz with positions (T, J, 3), names, parents and fps"


def sentence(content: Any) -> str:
    """Return the sentence about an unpickled content that holds no parameters of a body."""
    if not isinstance(content, Mapping):
        shape = f" {content.shape}" if isinstance(content, np.ndarray) else ""
        return f"no turns of a body in this pickle; it holds {type(content).__name__}{shape}"
    if "rigid_body_pos" in content:
        return f"a motion of ProtoMotions: rigid_body_pos holds positions of bodies without their names; {SAVE}"
    if any(SOMA in one for one in content.values() if isinstance(one, Mapping)):
        return f"turns of SOMA's 77 joints (GEM-X) without their places: take the joints of its SOMA layer and {SAVE}"
    inner = next((value for value in content.values() if isinstance(value, Mapping)), {})
    if any(keys <= one.keys() for keys in ROBOT_KEYS for one in (content, inner)):
        return "a motion of a robot, not of a human: robot-retarget import FILE --robot ROBOT -o T.npz"
    return f"no turns of a body in this pickle; it holds {', '.join(str(key) for key in content if content[key] is not None) or 'nothing'}"


# SAM 3D Body: 70 keypoints of the Momentum Human Rig and the camera's translation, frame by frame, in the camera's frame.
#
# `pred_keypoints_3d` (T, 70, 3) [m] and `pred_cam_t` (T, 3) [m] as arrays of an `.npz`, or a pickle of frames, each a dict or a
# list of dicts with a person each. x points right, y down, z away. A person is the n-th of every frame, or the one with the same
# `track_id`; frames without the person are gaps.

POINTS, CAMERA, TRACK = "pred_keypoints_3d", "pred_cam_t", "track_id"
RIG_KEYPOINTS = 70
"""Keypoints of the rig."""
_AT = {
    "LSHOULDER": (5,), "RSHOULDER": (6,), "LELBOW": (7,), "RELBOW": (8,), "LHIP": (9,), "RHIP": (10,), "LKNEE": (11,),
    "RKNEE": (12,), "LANKLE": (13,), "RANKLE": (14,), "LBIGTOE": (15, 16), "RBIGTOE": (18, 19), "RWRIST": (41,),
    "LWRIST": (62,), "NECK": (69,), "HEAD": (3, 4),
}  # fmt: skip
"""Keypoints of the rig whose middle each joint is; a head is between the ears."""


def is_sam3d(header: FileHeader) -> bool:
    """Whether an `.npz` holds the keypoints."""
    return POINTS in header.arrays


def read_sam3d(path: Path, request: Request) -> Capture:
    """Read the arrays of an `.npz`."""
    return keypoint_people(load_npz(path), path, request)


def holds_keypoints(content: Any) -> bool:
    """Whether a pickle is a list of such frames, or a dict of such arrays."""
    if isinstance(content, Mapping):
        return POINTS in content
    frames = [person for frame in content for person in _persons(frame)] if isinstance(content, list | tuple) else []
    return bool(frames) and all(isinstance(person, Mapping) and POINTS in person for person in frames)


def keypoint_people(content: Any, path: Path, request: Request) -> Capture:
    """Make a capture of the first person, or of the requested one.

    Raises:
        MotionError: arrays of another shape, or no person.
    """
    people = _arrays(content, path) if isinstance(content, Mapping) else _tracks(content, path)
    which, notes = request.choose(list(people), path)
    fps = rate_of(content) if isinstance(content, Mapping) else None
    capture = _joints(people[list(people)[which]], _AT, fps, path, request)
    return replace(capture, notes=(*notes, *capture.notes), up="-y")


def _joints(
    points: Floats, at: Mapping[str, tuple[int, ...]], fps: float | None, path: Path, request: Request
) -> Capture:
    """A capture of the joints that are in the middle of keypoints (T, N, 3)."""
    joints = np.stack([points[:, list(where)].mean(axis=1) for where in at.values()], axis=1)
    found = LabelledPoints([("", label) for label in at], joints, fps)
    return replace(labelled_capture(found, path, replace(request, clip=None)), camera=True)


def _arrays(content: Mapping[str, Any], path: Path) -> dict[str, Floats]:
    """Per person (T, 70, 3) in the camera's frame [m]."""
    points = np.asarray(content[POINTS], dtype=float)
    points = points[:, None] if points.ndim == 3 else points
    camera = np.asarray(content.get(CAMERA, np.zeros(3)), dtype=float)
    camera = camera[:, None] if camera.ndim == 2 else camera
    if points.ndim != 4 or points.shape[2:] != (RIG_KEYPOINTS, 3) or camera.shape not in ((3,), (*points.shape[:2], 3)):
        shapes = f"{points.shape} and {camera.shape}"
        raise MotionError(f"{POINTS}, {CAMERA}: expected (T, {RIG_KEYPOINTS}, 3) and (T, 3), got {shapes}", path)
    placed = points + camera[..., None, :]
    return {str(k): placed[:, k] for k in range(points.shape[1])}


def _tracks(frames: Sequence[Any], path: Path) -> dict[str, Floats]:
    people: dict[str, Floats] = {}
    for t, frame in enumerate(frames):
        for k, person in enumerate(_persons(frame)):
            place = np.asarray(person[POINTS], dtype=float).reshape(-1, 3)
            if len(place) != RIG_KEYPOINTS:
                raise MotionError(f"frame {t}: expected {RIG_KEYPOINTS} keypoints, got {len(place)}", path)
            name = str(person.get(TRACK, k))
            path_of = people.setdefault(name, np.full((len(frames), RIG_KEYPOINTS, 3), np.nan))
            path_of[t] = place + np.asarray(person.get(CAMERA, np.zeros(3)), dtype=float).reshape(3)
    return people


def _persons(frame: Any) -> list[Any]:
    return list(frame) if isinstance(frame, list | tuple) else [frame] if frame else []


# EasyMocap: a folder with a JSON file a frame, `000000.json`, each a list of people with `id`, and `Rh`, `Th` [m], `poses` and
# `shapes`, or `keypoints3d` (25, 4) in the order of OpenPose's body with a confidence, 0 where a point is lost [m].

_BODY_25 = {
    "LSHOULDER": (5,), "RSHOULDER": (2,), "LELBOW": (6,), "RELBOW": (3,), "LWRIST": (7,), "RWRIST": (4,), "LHIP": (12,),
    "RHIP": (9,), "LKNEE": (13,), "RKNEE": (10,), "LANKLE": (14,), "RANKLE": (11,), "LBIGTOE": (19, 20), "RBIGTOE": (22, 23),
    "NECK": (1,), "HEAD": (17, 18),
}  # fmt: skip
_KEYPOINTS = "keypoints3d"


def is_easymocap(header: FileHeader) -> bool:
    """Whether a file is a frame of EasyMocap."""
    return header.path.stem.isdecimal() and any(f'"{key}"' in header.text for key in ("Rh", _KEYPOINTS))


def frames_beside(path: Path) -> tuple[Path, ...]:
    """The other frames in the folder of a frame."""
    frames = (other for other in path.parent.glob("*.json") if other.stem.isdecimal() and other.name != path.name)
    return tuple(sorted(frames))


def read_easymocap(path: Path, request: Request) -> Capture:
    """Read all frames of the folder; the first person, or the one with the requested `id`.

    Raises:
        MotionError: a frame is no list of people with the same fields, or the person is away for longer than half a second.
    """
    people: dict[str, dict[int, Any]] = {}
    files = sorted((path, *frames_beside(path)), key=lambda file: int(file.stem))
    if sum(file.stat().st_size for file in files) > LIMITS.file:
        raise too_large(path.parent, LIMITS.file)
    for file in files:
        for person in documents.read_json(file, MotionError):
            people.setdefault(str(person["id"]), {})[int(file.stem)] = person
    which, notes = request.choose(list(people), path)
    seen = people[list(people)[which]]
    numbers = np.array(list(seen)) - min(seen)
    if _KEYPOINTS in next(iter(seen.values())):
        rows = np.array([person[_KEYPOINTS] for person in seen.values()], dtype=float)
        points = np.full((numbers[-1] + 1, len(rows[0]), 3), np.nan)
        points[numbers] = np.where(rows[..., 3:] > 0, rows[..., :3], np.nan)
        capture = _joints(points, _BODY_25, None, path, request)
    else:
        keys = ("Rh", "Th", "poses", "shapes")
        fields = {key: np.array([np.ravel(person[key]) for person in seen.values()], dtype=float) for key in keys}
        capture = captured({**fields, "frames": numbers}, path, request)
    return replace(capture, notes=(*notes, *capture.notes))


_PICKLE, _OBJECTS = b"\x80", b"'descr': '|O'"
INTERMIMIC = slice(162, 318)
"""Columns of InterMimic's rows with the positions of 52 joints [m]."""
PARC = "motion_data"
"""The pickle within PARC's pickle that holds its motion."""
OMOMO, OMOMO_WIDTH, OMOMO_PLACES, OMOMO_FPS = ("motion", "trans2joint"), 276, slice(72), 30.0
"""Keys, width, columns of positions of the 24 joints of SMPL [m], and rate of OMOMO's windows, as hhtools keeps them [1/s]."""


def is_pickle(header: FileHeader) -> bool:
    """Whether a file is a pickle, of PyTorch, of joblib or of Python."""
    in_zip = any(name.endswith("data.pkl") for name in header.members) or "results" in header.arrays
    if header.shape == () and header.head.startswith(b"\x93NUMPY"):
        return _OBJECTS in header.head
    return in_zip or (header.head.startswith((_PICKLE, *ZLIB_MAGIC)) and not header.head.isascii())


def camera_beside(path: Path) -> tuple[Path, ...]:
    """The camera of TRAM's people, `camera.npy` in the folder above them."""
    camera = path.parent.parent / "camera.npy"
    return (camera,) if path.suffix.lower() == ".npy" and camera.is_file() else ()


def read_pickle(path: Path, request: Request) -> Capture:
    """Read the parameters of the first body in the world, or of the body with the requested name.

    Raises:
        MotionError: it would run code, or holds no rotations of a body; lists its content.
    """
    content = load_pickle(path)
    if isinstance(content, Mapping) and "results" in content:
        content = content["results"]
        if not holds_smpl_people(content):
            raise MotionError("holds one frame of ROMP: give video_results.npz of the same folder", path)
    if isinstance(content, Mapping) and TRAM in content:
        camera = next((load_pickle(one) for one in camera_beside(path)), {})
        content = {**content, **{key: camera[key] for key in WORLD_CAMERA if key in camera}}
    if isinstance(content, np.ndarray) and content.ndim == 2 and content.shape[1] >= INTERMIMIC.stop:
        joints = content[:, INTERMIMIC].reshape(len(content), -1, 3)
        return replace(positions.captured({"positions": joints}, path, request), up="+z")
    if isinstance(content, Mapping) and isinstance(content.get(PARC), bytes | bytearray):
        motion = parse_pickle(bytes(content[PARC]), LIMITS.unpacked(path))
        return datasets.parc_capture(motion, path, request)
    if (
        isinstance(content, Mapping)
        and OMOMO[1] in content
        and np.shape(content.get(OMOMO[0], ()))[1:] == (OMOMO_WIDTH,)
    ):
        joints = np.asarray(content[OMOMO[0]])[:, OMOMO_PLACES].reshape(len(content[OMOMO[0]]), -1, 3)
        return replace(positions.captured({"positions": joints, "fps": OMOMO_FPS}, path, request), up="+z")
    if holds_keypoints(content):
        return keypoint_people(content, path, request)
    if holds_smpl_people(content):
        return smpl_people(content, path, request)
    bodies = dict(_bodies(content, ""))
    if not bodies:
        raise MotionError(sentence(content), path)
    names = sorted(bodies, key=lambda name: "cam" in name.rpartition("/")[2])
    which, notes = request.choose(names, path)
    capture = captured(bodies[names[which]], path, request)
    return replace(capture, notes=(*notes, *capture.notes))


def _bodies(content: Any, name: str, frames: Any = None) -> Iterator[tuple[str, dict[str, Any]]]:
    """Every dict in the pickle that holds turns of a body, by the keys that lead to it; frames may stand above it."""
    if not isinstance(content, Mapping):
        return
    frames = content.get("frames", frames)
    arrays = {str(key): np.asarray(value) for key, value in content.items() if _is_plain(value)}
    if holds_turns(arrays):
        yield name or "body", arrays if frames is None else {"frames": frames, **arrays}
    for key, value in content.items():
        yield from _bodies(value, f"{name}/{key}" if name else str(key), frames)


def _is_plain(value: Any) -> bool:
    """Whether a value is numbers."""
    return isinstance(value, np.ndarray | int | float) and not isinstance(value, bool)
