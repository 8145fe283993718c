"""Landmarks of MediaPipe's pose model, from its own files or FreeMoCap's: 33 points on a body, joints between them."""

import csv
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from robot_retarget.base.arrays import Floats
from robot_retarget.base.errors import MotionError
from robot_retarget.base.untrusted import documents
from robot_retarget.base.untrusted.arrays import load_arrays
from robot_retarget.base.untrusted.limits import LIMITS
from robot_retarget.human.capture import Capture, FileHeader, Request
from robot_retarget.human.readers.points import bridged, numbers, of_points

# Landmarks as text: FreeMoCap's tables, wide and long, and MediaPipe's results as JSON.

PLACE = 24
"""Of a point in a frame [bytes]."""
MOST_FRAMES = 10**6
"""Of a table that says its frames' numbers; higher ones are refused: nine hours at 30 frames a second."""
Table = dict[str, Floats]
"""The paths (T, 3) of landmarks by name, NaN where lost."""
_BODY = ("body_", "mediapipe_body_", "pose_")
_WORLD = ("worldLandmarks", "poseWorldLandmarks", "pose_world_landmarks", "world_landmarks", "landmarks", "keypoints")


def read_csv(path: Path, names: Sequence[str]) -> Table:
    """A table with columns `nose_x, nose_y, nose_z, …` (or `body_nose_x`), or a row a landmark with `keypoint, x, y, z`.

    Raises:
        MotionError: none of both, a row of another width, or no number; names the line.
    """
    with path.open(encoding="utf-8-sig", newline="", errors="replace") as file:
        rows = csv.reader(file)
        try:
            header = [word.strip().lower() for word in next(rows, [])]
            long = {"frame", "keypoint", "x", "y", "z"} <= set(header)
            return (_long if long else _wide)(header, rows, path, names)
        except csv.Error as error:
            raise MotionError(f"not a table: {error}", path, rows.line_num) from error


def _wide(header: list[str], rows: Iterable[list[str]], path: Path, names: Sequence[str]) -> Table:
    columns: dict[str, list[int]] = {}
    for name in names:
        for prefix in ("", *_BODY):
            wanted = [f"{prefix}{name}_{axis}" for axis in "xyz"]
            if all(word in header for word in wanted):
                columns[name] = [header.index(word) for word in wanted]
    if not columns:
        raise MotionError("expected columns such as left_hip_x, left_hip_y, left_hip_z", path, 1)
    places = [column for three in columns.values() for column in three]
    values = [numbers([row[at] for at in places], len(places), path, line) for line, row in _lines(rows, header, path)]
    if not values:
        raise MotionError("no frames after the header", path, 2)
    table = np.array(values).reshape(len(values), len(columns), 3)
    return {name: table[:, k] for k, name in enumerate(columns)}


def _long(header: list[str], rows: Iterable[list[str]], path: Path, names: Sequence[str]) -> Table:
    at = {word: header.index(word) for word in ("frame", "keypoint", "x", "y", "z")}
    places: dict[str, dict[int, list[float]]] = {}
    last = -1
    for line, row in _lines(rows, header, path):
        name = row[at["keypoint"]].strip().lower()
        name = next((name.removeprefix(prefix) for prefix in _BODY if name.startswith(prefix)), name)
        frame = _frame_number(row[at["frame"]], path, line)
        last = max(last, frame)
        if name in names:
            places.setdefault(name, {})[frame] = numbers([row[at[axis]] for axis in "xyz"], 3, path, line)
    if (last + 1) * len(places) * PLACE > LIMITS.unpacked(path):
        raise MotionError(f"frame {last} is more than a file of its size may have", path)
    table = {name: np.full((last + 1, 3), np.nan) for name in places}
    for name, path_of in places.items():
        table[name][list(path_of)] = list(path_of.values())
    return table


def _frame_number(word: str, path: Path, line: int) -> int:
    if not word.strip().isdecimal() or int(word) >= MOST_FRAMES:
        raise MotionError(f"frame: expected a whole number from 0 to {MOST_FRAMES}, found {word[:40]!r}", path, line)
    return int(word)


def _lines(rows: Iterable[list[str]], header: list[str], path: Path) -> Iterator[tuple[int, list[str]]]:
    """The rows that hold something, with their lines."""
    for line, row in enumerate(rows, 2):
        if not any(word.strip() for word in row):
            continue
        if len(row) != len(header):
            raise MotionError(f"expected {len(header)} columns as in the header, found {len(row)}", path, line)
        yield line, row


def read_json(path: Path, names: Sequence[str]) -> tuple[Table, float | None]:
    """Frames of landmarks `{x, y, z}` in the order of the model, a list or under `frames`; `fps` is read where it stands.

    Raises:
        MotionError: no JSON, no frames, or a frame with another number of landmarks; names the frame.
    """
    content = documents.read_json(path, MotionError)
    fps = content.get("fps") if isinstance(content, dict) else None
    lists = [content, *(content.values() if isinstance(content, dict) else ())]
    frames = next((value for value in lists if isinstance(value, list)), [])
    if not frames:
        raise MotionError("expected a list of frames of landmarks", path)
    places = np.array([_frame(frame, k, len(names), path) for k, frame in enumerate(frames)])
    if fps is not None and (not isinstance(fps, int | float) or fps <= 0):
        raise MotionError(f"fps: expected a positive number, found {fps!r}", path)
    return {name: places[:, k] for k, name in enumerate(names)}, fps


def _frame(frame: Any, index: int, count: int, path: Path) -> list[list[float]]:
    """The landmarks of the first person in one frame; empty without a person."""
    marks = next((frame[key] for key in _WORLD if key in frame), None) if isinstance(frame, Mapping) else frame
    if isinstance(marks, list) and len(marks) < count and marks and isinstance(marks[0], list):
        marks = marks[0]
    if marks is None or marks == []:
        return [[np.nan] * 3] * count
    if not isinstance(marks, list) or len(marks) != count:
        found = len(marks) if isinstance(marks, list) else "none"
        raise MotionError(f"frame {index}: expected {count} landmarks, found {found}", path)
    try:
        return [_place(mark) for mark in marks]
    except (LookupError, TypeError, ValueError) as error:
        raise MotionError(f"frame {index}: expected x, y and z of every landmark ({error})", path) from error


def _place(mark: Any) -> list[float]:
    """x, y and z of a landmark, by name or in that order."""
    return [float(mark[key]) for key in (("x", "y", "z") if isinstance(mark, Mapping) else (0, 1, 2))]


LANDMARKS = (
    "nose", "left_eye_inner", "left_eye", "left_eye_outer", "right_eye_inner", "right_eye", "right_eye_outer",
    "left_ear", "right_ear", "mouth_left", "mouth_right", "left_shoulder", "right_shoulder", "left_elbow", "right_elbow",
    "left_wrist", "right_wrist", "left_pinky", "right_pinky", "left_index", "right_index", "left_thumb", "right_thumb",
    "left_hip", "right_hip", "left_knee", "right_knee", "left_ankle", "right_ankle", "left_heel", "right_heel",
    "left_foot_index", "right_foot_index",
)  # fmt: skip
"""In the order of the model."""
COUNTS = (33, 75, 543, 553)
"""Of the points in an array, by the formats of MediaPipe: the body, with both hands, with the face of 468 or 478 points; the body comes first."""
# Each joint, its parent, and the landmarks whose middle it is.
_JOINTS: tuple[tuple[str, str, tuple[str, ...]], ...] = (
    ("pelvis", "", ("left_hip", "right_hip")),
    ("neck", "pelvis", ("left_shoulder", "right_shoulder")),
    ("head", "neck", ("left_ear", "right_ear")),
    *(
        (f"{side}_{part}", f"{side}_{above}" if "_" not in above else above[1:], (f"{side}_{mark}",))
        for side in ("left", "right")
        for part, above, mark in (
            ("hip", "_pelvis", "hip"),
            ("knee", "hip", "knee"),
            ("ankle", "knee", "ankle"),
            ("toe", "ankle", "foot_index"),
            ("shoulder", "_neck", "shoulder"),
            ("elbow", "shoulder", "elbow"),
            ("wrist", "elbow", "wrist"),
        )
    ),
)
USED = tuple(sorted({mark for *_, marks in _JOINTS for mark in marks}, key=LANDMARKS.index))
_STILL_MARK = 1e-3
"""Travel of the middle of the hips, over the body's size, in landmarks relative to it, which have it at the origin but
for the rounding of their decimals."""
_IMAGE = 1.5
"""Largest value of landmarks in units of the image size; some lie a little outside the image."""


def matches_format(header: FileHeader) -> bool:
    """Whether a file is an array of that many points, or text that names landmarks."""
    if len(header.shape) == 3 and header.shape[1] in COUNTS and header.shape[2] in (3, 4):
        return True
    head = header.text.lower()
    return header.path.suffix.lower() in (".csv", ".json") and ("landmark" in head or "left_hip" in head)


def read(path: Path, request: Request) -> Capture:
    """Read landmarks in space and put joints between them.

    Raises:
        MotionError: no landmarks, not all that joints need, landmarks of an image, or lost for too long; says which.
    """
    points, stored = _points(path)
    seen = points[np.isfinite(points)]
    if seen.size and seen.min() >= 0 and seen.max() <= _IMAGE:
        raise MotionError("landmarks of an image (0 … 1 of its size): give the world landmarks, in metres", path)
    fps, rate_notes = request.rate(stored)
    paths, _, notes = bridged(points, USED, fps, str(path))
    at = {mark: paths[:, k] for k, mark in enumerate(USED)}
    body = {name: (parent, np.mean([at[mark] for mark in marks], axis=0)) for name, parent, marks in _JOINTS}
    capture = of_points(body, fps, str(path), (*_travel(body["pelvis"][1], paths), *notes, *rate_notes))
    return replace(capture, camera=True)


def _points(path: Path) -> tuple[Floats, float | None]:
    """The landmarks in use (T, U, 3), NaN where lost, and frames per second where the file says them."""
    suffix = path.suffix.lower()
    if suffix == ".csv":
        table, fps = read_csv(path, LANDMARKS), None
    elif suffix == ".json":
        table, fps = read_json(path, LANDMARKS)
    else:
        values = load_arrays(path)["positions"]
        if values.ndim != 3 or values.shape[2] < 3 or values.dtype.kind not in "fiu" or not len(values):
            raise MotionError(f"expected landmarks (T, 33, 3), got {values.dtype} {values.shape}", path)
        table, fps = {name: values[:, k, :3].astype(float) for k, name in enumerate(LANDMARKS)}, None
    missing = [mark for mark in USED if mark not in table]
    if missing:
        raise MotionError(f"lacks the landmarks {', '.join(missing)}", path)
    return np.stack([table[mark] for mark in USED], axis=1), fps


def _travel(pelvis: Floats, paths: Floats) -> tuple[str, ...]:
    size = float(np.linalg.norm(np.ptp(paths[0], axis=0)))
    if float(np.ptp(pelvis, axis=0).max()) > _STILL_MARK * size:
        return ()
    return ("The landmarks are relative to the middle of the hips: the body does not travel.",)
