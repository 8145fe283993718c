"""Pickles as other programs write them, read as data: nested dicts of video trackers (`.pt` of GVHMR and GENMO, `.pkl` of
WHAM), frames of 4D-Humans, Multi-HMR and SAM 3D Body, and InterMimic's rows of numbers, which hold positions of joints.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from math import hypot
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from robot_retarget.base.arrays import Floats
from robot_retarget.base.errors import MotionError
from robot_retarget.base.untrusted.arrays import load_npz, rate_of
from robot_retarget.base.untrusted.limits import LIMITS, ZLIB_MAGIC
from robot_retarget.base.untrusted.pickles import load_pickle, parse_pickle
from robot_retarget.human.capture import Capture, FileHeader, Request
from robot_retarget.human.readers import datasets, positions
from robot_retarget.human.readers.points import LabelledPoints, bridged, labelled_capture
from robot_retarget.human.readers.smpl import SOMA, captured, holds_turns

# Results of video frame by frame, people with parameters of the SMPL family in the frame of the camera.
#
# 4D-Humans (tracks of PHALP): a dict of frames, each with lists over people, `smpl` (`global_orient` (1, 3, 3), `body_pose`
# (23, 3, 3), `betas` (10,)), `camera` (3,) [m], `tid`, `size` (height, width) and `tracked_time`, 0 where the person is seen.
# Multi-HMR: a list of frames, each a list of people with `rotvec` (53, 3), `transl_pelvis` (3,) [m] and `shape`.

FOCAL = 5000 / 256
"""The focal length that 4D-Humans assumes, by the longer side of the picture [-]. Places away from the camera are too far by its
ratio to the true one, for which the picture's diagonal is taken."""


def holds_smpl_people(content: Any) -> bool:
    """Whether a pickle is a dict of PHALP's frames or a list of Multi-HMR's."""
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
    found = captured({key: [one[key] for one in seen.values()] for key in next(iter(seen.values()))}, path, request)
    whole = _bridged(found, np.array(list(seen)), str(path))
    return replace(whole, notes=(*notes, *whole.notes), up="-y", camera=True)


def _people(frame: Any) -> Iterator[tuple[str, dict[str, Any]]]:
    """The people of a frame by name, with the fields of SMPL's parameters."""
    if isinstance(frame, Mapping) and {"smpl", "tid", "camera"} <= frame.keys():
        for k, (name, body, place) in enumerate(zip(frame["tid"], frame["smpl"], frame["camera"], strict=True)):
            if not frame.get("tracked_time", {k: 0})[k]:
                tall, wide = frame["size"][k]
                nearer = [1.0, 1.0, hypot(tall, wide) / (FOCAL * max(tall, wide))]
                yield str(name), {**body, "transl": np.asarray(place, dtype=float).reshape(-1)[:3] * nearer}
    elif isinstance(frame, list | tuple):
        for k, one in enumerate(frame):
            if isinstance(one, Mapping) and {"rotvec", "transl_pelvis"} <= one.keys():
                place = np.asarray(one["transl_pelvis"]).reshape(3)
                yield str(k), {"poses": np.asarray(one["rotvec"]).reshape(-1), "transl": place, "betas": one["shape"]}


def _bridged(capture: Capture, frames: np.ndarray, source: str) -> Capture:
    """The capture at every frame from the first to the last, of the frames in which the person is seen."""
    every = np.arange(frames[0], frames[-1] + 1)
    positions = np.full((len(every), *capture.positions.shape[1:]), np.nan)
    positions[frames - frames[0]] = capture.positions
    positions, _, notes = bridged(positions, capture.skeleton.names, capture.fps, source)
    assert capture.rotations is not None
    turns = [Slerp(frames, Rotation.from_quat(q, scalar_first=True))(every) for q in capture.rotations.swapaxes(0, 1)]
    rotations = np.stack([turn.as_quat(scalar_first=True) for turn in turns], axis=1)
    return replace(capture, positions=positions, rotations=rotations, notes=(*capture.notes, *notes))


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
COUNT = 70
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
    points = people[list(people)[which]]
    joints = np.stack([points[:, list(at)].mean(axis=1) for at in _AT.values()], axis=1)
    fps = rate_of(content) if isinstance(content, Mapping) else None
    capture = labelled_capture(
        LabelledPoints([("", label) for label in _AT], joints, fps), path, replace(request, clip=None)
    )
    return replace(capture, notes=(*notes, *capture.notes), up="-y", camera=True)


def _arrays(content: Mapping[str, Any], path: Path) -> dict[str, Floats]:
    """Per person (T, 70, 3) in the camera's frame [m]."""
    points = np.asarray(content[POINTS], dtype=float)
    points = points[:, None] if points.ndim == 3 else points
    camera = np.asarray(content.get(CAMERA, np.zeros(3)), dtype=float)
    camera = camera[:, None] if camera.ndim == 2 else camera
    if points.ndim != 4 or points.shape[2:] != (COUNT, 3) or camera.shape not in ((3,), (*points.shape[:2], 3)):
        shapes = f"{points.shape} and {camera.shape}"
        raise MotionError(f"{POINTS}, {CAMERA}: expected (T, {COUNT}, 3) and (T, 3), got {shapes}", path)
    placed = points + camera[..., None, :]
    return {str(k): placed[:, k] for k in range(points.shape[1])}


def _tracks(frames: Sequence[Any], path: Path) -> dict[str, Floats]:
    people: dict[str, Floats] = {}
    for t, frame in enumerate(frames):
        for k, person in enumerate(_persons(frame)):
            place = np.asarray(person[POINTS], dtype=float).reshape(-1, 3)
            if len(place) != COUNT:
                raise MotionError(f"frame {t}: expected {COUNT} keypoints, got {len(place)}", path)
            name = str(person.get(TRACK, k))
            path_of = people.setdefault(name, np.full((len(frames), COUNT, 3), np.nan))
            path_of[t] = place + np.asarray(person.get(CAMERA, np.zeros(3)), dtype=float).reshape(3)
    return people


def _persons(frame: Any) -> list[Any]:
    return list(frame) if isinstance(frame, list | tuple) else [frame] if frame else []


_PICKLE = b"\x80"
INTERMIMIC = slice(162, 318)
"""Columns of InterMimic's rows with the positions of 52 joints [m]."""
PARC = "motion_data"
"""The pickle within PARC's pickle that holds its motion."""
OMOMO, OMOMO_WIDTH, OMOMO_PLACES, OMOMO_FPS = ("motion", "trans2joint"), 276, slice(72), 30.0
"""Keys, width, columns of positions of the 24 joints of SMPL [m], and rate of OMOMO's windows, as hhtools keeps them [1/s]."""


def is_pickle(header: FileHeader) -> bool:
    """Whether a file is a pickle, of PyTorch, of joblib or of Python."""
    in_zip = any(name.endswith("data.pkl") for name in header.members)
    return in_zip or (header.head.startswith((_PICKLE, *ZLIB_MAGIC)) and not header.head.isascii())


def read_pickle(path: Path, request: Request) -> Capture:
    """Read the parameters of the first body in the world, or of the body with the requested name.

    Raises:
        MotionError: it would run code, or holds no rotations of a body; lists its content.
    """
    content = load_pickle(path)
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
    names = sorted(bodies, key=lambda name: "incam" in name)
    which, notes = request.choose(names, path)
    capture = captured(bodies[names[which]], path, request)
    return replace(capture, notes=(*notes, *capture.notes), camera="incam" in names[which])


def _bodies(content: Any, name: str) -> Iterator[tuple[str, dict[str, Any]]]:
    """Every dict in the pickle that holds turns of a body, by the keys that lead to it."""
    if not isinstance(content, Mapping):
        return
    arrays = {str(key): np.asarray(value) for key, value in content.items() if _is_plain(value)}
    if holds_turns(arrays):
        yield name or "body", arrays
    for key, value in content.items():
        yield from _bodies(value, f"{name}/{key}" if name else str(key))


def _is_plain(value: Any) -> bool:
    """Whether a value is numbers."""
    return isinstance(value, np.ndarray | int | float) and not isinstance(value, bool)
