"""Results of video frame by frame, people with parameters of the SMPL family in the frame of the camera.

4D-Humans (tracks of PHALP): a dict of frames, each with lists over people, `smpl` (`global_orient` (1, 3, 3), `body_pose`
(23, 3, 3), `betas` (10,)), `camera` (3,) [m], `tid`, `size` (height, width) and `tracked_time`, 0 where the person is seen.
Multi-HMR: a list of frames, each a list of people with `rotvec` (53, 3), `transl_pelvis` (3,) [m] and `shape`.
"""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from math import hypot
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from robot_retarget.human.capture import Capture
from robot_retarget.human.readers.points import bridged
from robot_retarget.human.readers.request import Request
from robot_retarget.human.readers.smpl.parameters import captured

FOCAL = 5000 / 256
"""The focal length that 4D-Humans assumes, by the longer side of the picture [-]. Places away from the camera are too far by its
ratio to the true one, for which the picture's diagonal is taken."""


def holds_people(content: Any) -> bool:
    """Whether a pickle is a dict of PHALP's frames or a list of Multi-HMR's."""
    frames = content.values() if isinstance(content, Mapping) else content if isinstance(content, list | tuple) else ()
    return any(True for frame in frames for _ in _people(frame))


def people_of(content: Any, path: Path, request: Request) -> Capture:
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
