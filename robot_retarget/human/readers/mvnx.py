"""MVNX of Xsens MVN: positions and orientations of 23 segments in the world, z up, and contacts of heels and toes.

A segment begins at the joint to its parent: its position is that joint's, and the point of the parent's `connector1` is
the joint's place at rest. Frames that are not `normal` (identity, tpose) are no part of the motion.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree.ElementTree import Element, ParseError, iterparse

import numpy as np
from scipy.spatial.transform import Rotation

from robot_retarget.base.arrays import Bools, Floats
from robot_retarget.base.errors import MotionError
from robot_retarget.base.untrusted.rotations import checked_quaternions
from robot_retarget.human.capture import Capture, FileHeader, Request
from robot_retarget.human.readers.points import bridged_turns
from robot_retarget.human.skeleton import Skeleton, sorted_tree

CONTACTS = ("LeftFoot_Heel", "LeftFoot_Toe", "RightFoot_Heel", "RightFoot_Toe")
"""In the order of `Capture.contacts`."""
_END = "_end"


@dataclass
class _Subject:
    """One person of a recording while the file is read."""

    name: str
    fps: float | None
    segments: list[str] = field(default_factory=list)
    points: dict[tuple[str, str], Floats] = field(default_factory=dict)
    """(3,) by segment and label, in the segment's frame [m]."""
    joints: list[tuple[str, str, str]] = field(default_factory=list)
    """Parent, its point, and child."""
    contacts: dict[str, int] = field(default_factory=dict)
    frames: list[Mapping[str, Floats]] = field(default_factory=list)


def matches_format(header: FileHeader) -> bool:
    """Whether a text has the root element of MVNX."""
    return "<mvnx" in header.text.lower()


def read(path: Path, request: Request) -> Capture:
    """Read the segments of the first subject, or of the requested one.

    Raises:
        MotionError: broken XML, no frames, a segment without a place in its parent, or a frame of another length.
    """
    try:
        subjects = list(_subjects(path))
    except ParseError as error:
        raise MotionError(f"not XML that can be read: {error}", path, error.position[0]) from error
    if not subjects:
        raise MotionError("no <subject>", path)
    which, others = request.choose([subject.name for subject in subjects], path)
    subject = subjects[which]
    if not subject.frames:
        raise MotionError(f"no frame of type normal with <position> and <orientation> of {subject.name!r}", path)
    skeleton, order = _skeleton(subject, path)
    fps, notes = request.rate(subject.fps)
    positions, rotations, gaps = _placed(subject, skeleton, order, path, fps)
    return Capture(skeleton, positions, rotations, fps, str(path), (*others, *gaps, *notes), _contacts(subject), "+z")


def _subjects(path: Path) -> Iterator[_Subject]:
    """Yield every subject with its frames; release each element after its read."""
    now: _Subject | None = None
    for event, element in iterparse(path, ("start", "end")):
        tag = element.tag.rpartition("}")[2]
        if event == "start" and tag == "subject":
            rate = element.get("frameRate")
            now = _Subject(element.get("label", "subject"), float(rate) if rate else None)
        elif event == "end" and now is not None:
            if tag == "subject":
                yield now
                now = None
            elif tag in _READ:
                _READ[tag](now, element)
                element.clear()


def _segment(subject: _Subject, element: Element) -> None:
    name = element.get("label", "")
    subject.segments.append(name)
    for point in element.iter():
        place = next((child for child in point if child.tag.endswith("pos_b")), None)
        if place is not None:
            subject.points[name, point.get("label", "")] = _numbers(place)


def _joint(subject: _Subject, element: Element) -> None:
    ends = [(child.text or "").strip().partition("/") for child in element]
    if len(ends) == 2:
        subject.joints.append((ends[0][0], ends[0][2], ends[1][0]))


def _contact(subject: _Subject, element: Element) -> None:
    subject.contacts[element.get("label", "")] = len(subject.contacts)


def _frame(subject: _Subject, element: Element) -> None:
    if element.get("type", "normal") == "normal":
        fields = {child.tag.rpartition("}")[2]: child for child in element}
        if {"position", "orientation"} <= fields.keys():
            subject.frames.append({k: _numbers(fields[k]) for k in _FIELDS if k in fields})


_FIELDS = ("position", "orientation", "footContacts")
_READ = {"segment": _segment, "joint": _joint, "contactDefinition": _contact, "frame": _frame}


def _numbers(element: Element) -> Floats:
    return np.array((element.text or "").split(), dtype=float)


def _skeleton(subject: _Subject, path: Path) -> tuple[Skeleton, list[int]]:
    """The segments as joints, an end at the farthest point of each last one, and the file's index of each segment."""
    above = {child: (parent, label) for parent, label, child in subject.joints}
    parents = np.array([subject.segments.index(above[s][0]) if s in above else -1 for s in subject.segments])
    order = np.asarray(sorted_tree(parents)[1]).tolist()
    names, tree, offsets = [subject.segments[k] for k in order], [], []
    for name in names:
        place = subject.points.get(above[name]) if name in above else np.zeros(3)
        if place is None or place.shape != (3,):
            raise MotionError(f"segment {name!r} has no place in {above[name][0]!r}", path)
        offsets.append(place)
        tree.append(names.index(above[name][0]) if name in above else -1)
    for name in sorted(set(names) - {parent for parent, _ in above.values()}, key=names.index):
        points = [place for (segment, _), place in subject.points.items() if segment == name]
        if points:
            names.append(name + _END)
            tree.append(names.index(name))
            offsets.append(max(points, key=np.linalg.norm))
    return Skeleton(tuple(names), np.array(tree), np.array(offsets)), order


def _placed(
    subject: _Subject, skeleton: Skeleton, order: list[int], path: Path, fps: float
) -> tuple[Floats, Floats, tuple[str, ...]]:
    """(T, J, 3) [m] and (T, J, 4) in the world, ends carried by their segments, and notes about bridged gaps."""
    count, frames = len(order), len(subject.frames)
    for key, size in (("position", 3), ("orientation", 4)):
        wrong = next((t for t, frame in enumerate(subject.frames) if frame[key].size != size * count), None)
        if wrong is not None:
            found = subject.frames[wrong][key].size
            raise MotionError(f"frame {wrong}: <{key}> needs {size * count} numbers, got {found}", path)
    place, turn = (
        np.array([frame[key] for frame in subject.frames]).reshape(frames, count, -1)[:, order]
        for key in ("position", "orientation")
    )
    turn = checked_quaternions(turn, "<orientation>", gaps=True)
    turn, gaps = bridged_turns(turn, skeleton.names, fps, str(path))
    ends = skeleton.parents[count:].tolist()
    carried = [
        place[:, k] + Rotation.from_quat(turn[:, k], scalar_first=True).apply(offset)
        for k, offset in zip(ends, np.array(skeleton.offsets[count:]), strict=True)
    ]
    return np.concatenate([place, np.stack(carried, 1)], 1), np.concatenate([turn, turn[:, ends]], axis=1), gaps


def _contacts(subject: _Subject) -> Bools | None:
    """(T, 4) as `Capture.contacts`, where every frame has them."""
    if not set(CONTACTS) <= subject.contacts.keys():
        return None
    rows = [frame.get("footContacts", np.zeros(0)) for frame in subject.frames]
    if any(len(row) != len(subject.contacts) for row in rows):
        return None
    return np.array(rows)[:, [subject.contacts[name] for name in CONTACTS]] > 0
