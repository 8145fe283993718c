"""SAM 3D Body: 70 keypoints of the Momentum Human Rig and the camera's translation, frame by frame, in the camera's frame.

`pred_keypoints_3d` (T, 70, 3) [m] and `pred_cam_t` (T, 3) [m] as arrays of an `.npz`, or a pickle of frames, each a dict or a
list of dicts with a person each. x points right, y down, z away. A person is the n-th of every frame, or the one with the same
`track_id`; frames without the person are gaps.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from robot_retarget.base.arrays import Floats
from robot_retarget.base.errors import MotionError
from robot_retarget.base.untrusted.arrays import load_npz, rate_of
from robot_retarget.human.capture import Capture
from robot_retarget.human.readers.file_header import FileHeader
from robot_retarget.human.readers.markers.labelled import LabelledPoints, captured
from robot_retarget.human.readers.request import Request

POINTS, CAMERA, TRACK = "pred_keypoints_3d", "pred_cam_t", "track_id"
COUNT = 70
_AT = {
    "LSHOULDER": (5,), "RSHOULDER": (6,), "LELBOW": (7,), "RELBOW": (8,), "LHIP": (9,), "RHIP": (10,), "LKNEE": (11,),
    "RKNEE": (12,), "LANKLE": (13,), "RANKLE": (14,), "LBIGTOE": (15, 16), "RBIGTOE": (18, 19), "RWRIST": (41,),
    "LWRIST": (62,), "NECK": (69,), "HEAD": (3, 4),
}  # fmt: skip
"""Keypoints of the rig whose middle each joint is; a head is between the ears."""


def matches_format(header: FileHeader) -> bool:
    """Whether an `.npz` holds the keypoints."""
    return POINTS in header.arrays


def read(path: Path, request: Request) -> Capture:
    """Read the arrays of an `.npz`."""
    return people_of(load_npz(path), path, request)


def holds_people(content: Any) -> bool:
    """Whether a pickle is a list of such frames, or a dict of such arrays."""
    if isinstance(content, Mapping):
        return POINTS in content
    frames = [person for frame in content for person in _persons(frame)] if isinstance(content, list | tuple) else []
    return bool(frames) and all(isinstance(person, Mapping) and POINTS in person for person in frames)


def people_of(content: Any, path: Path, request: Request) -> Capture:
    """Make a capture of the first person, or of the requested one.

    Raises:
        MotionError: arrays of another shape, or no person.
    """
    people = _arrays(content, path) if isinstance(content, Mapping) else _tracks(content, path)
    which, notes = request.choose(list(people), path)
    points = people[list(people)[which]]
    joints = np.stack([points[:, list(at)].mean(axis=1) for at in _AT.values()], axis=1)
    fps = rate_of(content) if isinstance(content, Mapping) else None
    capture = captured(LabelledPoints([("", label) for label in _AT], joints, fps), path, replace(request, clip=None))
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
