"""Landmarks of MediaPipe's pose model, from its own files or FreeMoCap's: 33 points on a body, joints between them."""

from pathlib import Path

import numpy as np

from robot_retarget.base.arrays import Floats
from robot_retarget.base.errors import MotionError
from robot_retarget.base.untrusted.arrays import load_arrays
from robot_retarget.human.capture import Capture
from robot_retarget.human.readers.file_header import FileHeader
from robot_retarget.human.readers.landmarks.tables import read_csv, read_json
from robot_retarget.human.readers.points import bridged, of_points
from robot_retarget.human.readers.request import Request

LANDMARKS = (
    "nose", "left_eye_inner", "left_eye", "left_eye_outer", "right_eye_inner", "right_eye", "right_eye_outer",
    "left_ear", "right_ear", "mouth_left", "mouth_right", "left_shoulder", "right_shoulder", "left_elbow", "right_elbow",
    "left_wrist", "right_wrist", "left_pinky", "right_pinky", "left_index", "right_index", "left_thumb", "right_thumb",
    "left_hip", "right_hip", "left_knee", "right_knee", "left_ankle", "right_ankle", "left_heel", "right_heel",
    "left_foot_index", "right_foot_index",
)  # fmt: skip
"""In the order of the model."""
COUNTS = (33, 75, 543, 553)
"""Of the points in an array: the body, with both hands, with the face of 468 or 478 points; the body comes first."""
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
_STILL = 1e-3
"""Travel of the middle of the hips, over the body's size, in landmarks relative to it."""
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
    return of_points(body, fps, str(path), (*_travel(body["pelvis"][1], paths), *notes, *rate_notes))


def _points(path: Path) -> tuple[Floats, float | None]:
    """The landmarks in use (T, U, 3), NaN where lost, and frames per second where the file says them."""
    suffix = path.suffix.lower()
    if suffix == ".csv":
        table, fps = read_csv(path, LANDMARKS)
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
    if float(np.ptp(pelvis, axis=0).max()) > _STILL * size:
        return ()
    return ("The landmarks are relative to the middle of the hips: the body does not travel.",)
