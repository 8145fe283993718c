"""Bodies of points: joints with positions and without rotations, with gaps where a camera lost them."""

from collections.abc import Mapping, Sequence

import numpy as np

from robot_retarget.base.arrays import Bools, Floats
from robot_retarget.base.errors import MotionError
from robot_retarget.human.capture import Capture
from robot_retarget.human.skeleton import Skeleton

GAP = 0.5
"""The longest time without a point that is bridged by a straight line [s]."""


def bridged(points: Floats, names: Sequence[str], fps: float, source: str) -> tuple[Floats, slice, tuple[str, ...]]:
    """Points (T, M, 3) without gaps: cut at both ends to the first and last complete frame, and bridged between.

    Returns:
        the points, their frames in the file, and notes about the repairs.

    Raises:
        MotionError: a point is never there, or away for longer than `GAP`; names it and the frames.
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
    widest = int(np.diff(known).argmax()) if known.size > 1 else 0
    if known.size > 1 and (known[widest + 1] - known[widest] - 1) / fps > GAP:
        gap = f"{first + known[widest] + 1} to {first + known[widest + 1] - 1}"
        raise MotionError(f"{name!r} is lost in frames {gap}, longer than {GAP} s", source)
    for axis in range(3):
        path[:, axis] = np.interp(np.arange(len(path)), known, path[known, axis])


def of_points(
    body: Mapping[str, tuple[str, Floats]], fps: float, source: str, notes: tuple[str, ...], up: str | None = None
) -> Capture:
    """A capture of joints by name: each one's parent, empty at the root, and its path (T, 3). Parents stand first."""
    names = tuple(body)
    parents = np.array([names.index(parent) if parent else -1 for parent, _ in body.values()])
    positions = np.stack([path for _, path in body.values()], axis=1)
    offsets = np.where(parents[:, None] < 0, 0.0, positions[0] - positions[0][np.maximum(parents, 0)])
    return Capture(Skeleton(names, parents, offsets), positions, None, fps, source, notes, up=up)
