"""Bodies of points: joints with positions and without rotations, with gaps where a camera lost them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from robot_retarget.base.arrays import Bools, Floats, Ints
from robot_retarget.base.errors import MotionError
from robot_retarget.human.capture import Capture, Request
from robot_retarget.human.readers.regressions import SETS, Markers, joint_centres
from robot_retarget.human.skeleton import Skeleton
from robot_retarget.scene.poses import LONGEST_GAP


def bridged(points: Floats, names: Sequence[str], fps: float, source: str) -> tuple[Floats, slice, tuple[str, ...]]:
    """Points (T, M, 3) without gaps: cut at both ends to the first and last complete frame, and bridged between.

    Returns:
        the points, their frames in the file, and notes about the repairs.

    Raises:
        MotionError: a point is never there, or away for longer than `LONGEST_GAP`; names it and the frames.
    """
    there: Bools = np.asarray(np.isfinite(points).all(axis=2))
    never = [name for name, seen in zip(names, there.T, strict=True) if not seen.any()]
    whole = np.flatnonzero(there.all(axis=1))
    if never or not whole.size:
        what = f"{never[0]!r} is in no frame" if never else "no frame has all of " + ", ".join(names)
        raise MotionError(what, source)
    span = slice(int(whole[0]), int(whole[-1]) + 1)
    kept, seen = np.array(points[span], dtype=float), there[span]
    for column, name in enumerate(names):
        _fill(kept[:, column], seen[:, column], name, fps, span.start, source)
    notes = ()
    if not seen.all():
        notes = (f"{int((~seen).sum())} places of points that were lost were bridged by straight lines.",)
    if len(kept) < len(points):
        notes = (*notes, f"Frames {span.start} to {span.stop - 1} of {len(points)}: the others lack points.")
    return kept, span, notes


def _fill(path: Floats, seen: Bools, name: str, fps: float, first: int, source: str) -> None:
    """Bridge the gaps of one point (T, 3) in place."""
    known = np.flatnonzero(seen)
    _require_short(known, name, fps, first, source)
    for axis in range(3):
        path[:, axis] = np.interp(np.arange(len(path)), known, path[known, axis])


def _require_short(known: Ints, name: str, fps: float, first: int, source: str) -> None:
    """Raise MotionError where a point is away for longer than `LONGEST_GAP` between frames in which it is known (N,)."""
    widest = int(np.diff(known).argmax()) if known.size > 1 else 0
    if known.size > 1 and (known[widest + 1] - known[widest] - 1) / fps > LONGEST_GAP:
        gap = f"{first + known[widest] + 1} to {first + known[widest + 1] - 1}"
        raise MotionError(f"{name!r} is lost in frames {gap}, longer than {LONGEST_GAP} s", source)


def bridged_turns(
    turns: Floats, names: Sequence[str], fps: float, source: str, first: int = 0
) -> tuple[Floats, tuple[str, ...]]:
    """Rotations (T, J, 4) w x y z without gaps, which are NaN: turned along the shortest way between, held at the ends.

    Args:
        first: number of the first frame in the file.

    Raises:
        MotionError: a rotation is never there, or away for longer than `LONGEST_GAP`; names it and the frames.
    """
    seen = np.asarray(np.isfinite(turns).all(axis=2))
    if seen.all():
        return turns, ()
    whole, frames = np.array(turns), np.arange(len(turns))
    for joint in np.flatnonzero(~seen.all(axis=0)).tolist():
        there = np.flatnonzero(seen[:, joint])
        if not there.size:
            raise MotionError(f"{names[joint]!r} has no rotation in any frame", source)
        _require_short(there, names[joint], fps, first, source)
        way, ends = Rotation.from_quat(turns[there, joint], scalar_first=True), (int(there[0]), int(there[-1]))
        between = way if there.size == 1 else Slerp(there, way)(np.clip(frames, *ends))
        whole[:, joint] = between.as_quat(scalar_first=True)
    return whole, (f"{int((~seen).sum())} rotations that were lost were bridged.",)


def of_points(
    body: Mapping[str, tuple[str, Floats]], fps: float, source: str, notes: tuple[str, ...], up: str | None = None
) -> Capture:
    """A capture of joints by name: each one's parent, empty at the root, and its path (T, 3). Parents stand first."""
    names = tuple(body)
    parents = np.array([names.index(parent) if parent else -1 for parent, _ in body.values()])
    positions = np.stack([path for _, path in body.values()], axis=1)
    offsets = np.where(parents[:, None] < 0, 0.0, positions[0] - positions[0][np.maximum(parents, 0)])
    return Capture(Skeleton(names, parents, offsets), positions, None, fps, source, notes, up=up)


# A capture of labelled points: joint centres by published regressions from markers, or joint centres that are named.

UNITS = {"mm": 0.001, "cm": 0.01, "m": 1.0, "in": 0.0254}
"""Metres in each unit."""


def metres_in(unit: str, what: str, path: Path, line: int | None = None) -> float:
    """Return the metres of a unit that a file states.

    Raises:
        MotionError: the unit is not known.
    """
    if unit.lower() not in UNITS:
        raise MotionError(f"{what}: expected one of {', '.join(UNITS)}, found {unit.lower()!r}", path, line)
    return UNITS[unit.lower()]


# Joint centres of trackers without markers (Pose2Sim, OpenCap, Theia): joint, parent, and the labels it may have.
_SIDED = {
    "hip": ("pelvis", ("{}HIP", "{}HJC")),
    "knee": ("{}_hip", ("{}KNEE", "{}KJC")),
    "ankle": ("{}_knee", ("{}ANKLE", "{}AJC")),
    "toe": ("{}_ankle", ("{}BIGTOE", "{}TOE")),
    "shoulder": ("neck", ("{}SHOULDER", "{}SJC")),
    "elbow": ("{}_shoulder", ("{}ELBOW", "{}EJC")),
    "wrist": ("{}_elbow", ("{}WRIST", "{}WJC")),
}
_HEAD = ("HEAD", "NOSE")
_NEEDED = ("hip", "knee", "ankle", "shoulder", "elbow", "wrist")
CENTRES = "joint centres (LHip, LKnee, LAnkle, LShoulder, LElbow, LWrist, …)"


@dataclass(frozen=True)
class LabelledPoints:
    """Points of a file, in metres."""

    titles: list[tuple[str, str]]
    """(M,) subject and label in capitals of each; empty where a point has none."""
    points: Floats
    """(T, M, 3), NaN where lost [m]."""
    fps: float | None
    """Frames per second that the file states."""


def title_of(label: str) -> tuple[str, str]:
    """`Anna:LKNE` as subject and label in capitals, without the points of `R.ASIS`."""
    subject, _, bare = label.rpartition(":")
    return subject.strip(), bare.strip().upper().replace(".", "")


def numbers(cells: list[str], count: int, path: Path, line: int) -> list[float]:
    """The first numbers of a row, NaN where a cell is empty or absent.

    Args:
        cells: cells of a row.
        count: how many numbers.
        path: the file, for the error.
        line: line of the row.

    Raises:
        MotionError: a cell is no number.
    """
    cells = [*cells, *[""] * (count - len(cells))][:count]
    try:
        return [float(cell) if cell.strip() else np.nan for cell in cells]
    except ValueError as error:
        raise MotionError(f"not a number: {error}", path, line) from error


def labelled_capture(file: LabelledPoints, path: Path, request: Request) -> Capture:
    """Compute the joints of the first subject, or of the requested one.

    Raises:
        MotionError: neither a marker set with joint regressions nor joint centres; says which labels are missing.
    """
    subjects = sorted({subject for subject, _ in file.titles if subject}) or [""]
    which, others = request.choose(subjects, path)
    labels = [label if subject in ("", subjects[which]) else "" for subject, label in file.titles]
    paths = {label: file.points[:, k] for k, label in enumerate(labels) if label}
    fps, rate_notes = request.rate(file.fps)
    if centres := _named(paths):
        kept, _, notes = _bridged_paths(paths, sorted(set(sum(centres.values(), ()))), fps, path)
        return of_points(_tree(kept, centres), fps, str(path), (*others, *notes, *rate_notes))
    markers = Markers(paths)
    if missing := markers.missing():
        raise MotionError(_refusal(labels, missing), path)
    used = markers.used()
    kept, _, notes = _bridged_paths(paths, used, fps, path)
    markers = Markers(kept)
    body = joint_centres(markers)
    title = f"Joints were computed from {len(used)} of {len(labels)} markers."
    return of_points(body, fps, str(path), (*others, title, *markers.notes, *notes, *rate_notes))


def _bridged_paths(
    paths: dict[str, Floats], used: list[str], fps: float, path: Path
) -> tuple[dict[str, Floats], slice, tuple[str, ...]]:
    points, span, notes = bridged(np.stack([paths[label] for label in used], axis=1), used, fps, str(path))
    return {label: points[:, k] for k, label in enumerate(used)}, span, notes


def _named(paths: dict[str, Floats]) -> dict[str, tuple[str, ...]]:
    """Per joint the labels whose middle it is; empty if a needed joint has no label."""
    found: dict[str, tuple[str, ...]] = {}
    for side, word in (("L", "left"), ("R", "right")):
        for joint, (_, labels) in _SIDED.items():
            label = next((name.format(side) for name in labels if name.format(side) in paths), None)
            if label is not None:
                found[f"{word}_{joint}"] = (label,)
    if not {f"{word}_{joint}" for word in ("left", "right") for joint in _NEEDED} <= found.keys():
        return {}
    head = next((label for label in _HEAD if label in paths), None)
    middle = {
        "pelvis": found["left_hip"] + found["right_hip"],
        "neck": ("NECK",) if "NECK" in paths else found["left_shoulder"] + found["right_shoulder"],
    }
    return middle | ({"head": (head,)} if head else {}) | found


def _tree(paths: dict[str, Floats], centres: dict[str, tuple[str, ...]]) -> dict[str, tuple[str, Floats]]:
    """Joints with parents and paths, as `of_points` takes them."""
    above = {"pelvis": "", "neck": "pelvis", "head": "neck"}
    for word in ("left", "right"):
        above |= {f"{word}_{joint}": parent.format(word) for joint, (parent, _) in _SIDED.items()}
    return {joint: (above[joint], np.mean([paths[k] for k in labels], axis=0)) for joint, labels in centres.items()}


def _refusal(labels: list[str], missing: list[str]) -> str:
    named = [label for label in labels if label]
    return (
        f"joints cannot be computed from its markers: they must be labelled as {SETS}, or be {CENTRES}. "
        f"Missing: {_some(missing, 6)}. Its labels: {_some(named, 30) or 'none'}. Label them in the capture software, or "
        "give joint positions as .npz"
    )


def _some(words: list[str], most: int) -> str:
    more = f" and {len(words) - most} more" if len(words) > most else ""
    return ", ".join(words[:most]) + more
