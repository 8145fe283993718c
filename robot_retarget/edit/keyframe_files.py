"""Files of keyframes: JSON as in the animations of the Bit-Bots, and action pages of ROBOTIS. Each keeps its layout.

    {"keyframes": [{"duration": 0.8, "pause": 0.5, "goals": {"l_el": -45.0}}]}

has times [s] and angles [°]. A joint without an angle keeps the one before, at first that of the standing pose. `motion_4095.bin#38`
selects page 38 of a file and the pages that follow it; the default is page 1. The other content of a file stays unchanged.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from robot_retarget.actuators.map import ServoMap
from robot_retarget.base.errors import TrajectoryError, UsageError, known
from robot_retarget.base.files import replacing
from robot_retarget.base.untrusted.documents import parse_json
from robot_retarget.base.untrusted.limits import file_bytes
from robot_retarget.edit.keyframes import Keyframe
from robot_retarget.formats.action_pages import (
    CYCLE,
    INVALID,
    PAGES,
    STEPS,
    bytes_of,
    cycles_at,
    cycles_of,
    empty_page,
    pages_in,
    servo_ids,
    steps_of,
)  # fmt: skip
from robot_retarget.formats.columns import joint_called
from robot_retarget.formats.robot_motion import FormatOptions
from robot_retarget.formats.servo_files import servo_map_of
from robot_retarget.robot import Robot


@dataclass(frozen=True)
class Pose:
    """A keyframe of a file."""

    angles: Mapping[str, float]
    """[rad]; the other joints stay."""
    seconds: float
    pause: float
    step: int | None = None
    """Index of the pose in the file; None for a new one."""


@dataclass(frozen=True, eq=False)
class KeyframeFile:
    """A file of keyframes of one robot, and its content, which is empty for a missing file."""

    path: Path
    robot: Robot
    page: int = 1
    """First page of the keyframes, for action pages."""
    content: bytes = field(default=b"", repr=False)

    @property
    def keyframes(self) -> tuple[Keyframe, ...]:
        """The keyframes; for an empty file, the standing pose.

        Raises:
            TrajectoryError: the content does not fit the layout.
        """
        held, found = self._standing, list[Keyframe]()
        for k, pose in enumerate(self.poses):
            held |= pose.angles
            found.append(Keyframe(np.array([*held.values()]), pose.seconds, pose.pause, k))
        return tuple(found) or (Keyframe(np.array([*held.values()])),)

    @property
    def poses(self) -> list[Pose]:
        """The keyframes with the angles of the file only."""
        try:
            return LAYOUTS[self.path.suffix][0](self) if self.content else []
        except TrajectoryError as error:
            raise TrajectoryError(f"{self.path}: {error}") from error

    @property
    def _standing(self) -> dict[str, float]:
        angles = self.robot.standing()[self.robot.qpos_index].tolist()
        return dict(zip(self.robot.joint_names, angles, strict=True))

    def holding(self, keyframes: Sequence[Keyframe]) -> "KeyframeFile":
        """Return the file with other keyframes, rounded to the resolution of its layout; its other content stays.

        Raises:
            UsageError: the layout cannot hold them.
        """
        before, held, poses = self.poses, self._standing, list[Pose]()
        for key in keyframes:
            step = key.step if key.step is not None and 0 <= key.step < len(before) else None
            angles = dict(zip(held, key.angles.tolist(), strict=True))
            named = angles if step is None else before[step].angles
            moved = {joint: angle for joint, angle in angles.items() if joint in named or angle != held[joint]}
            poses.append(Pose(moved, key.seconds, key.pause, step))
            held = angles
        return replace(self, content=LAYOUTS[self.path.suffix][1](self, poses))

    @cached_property
    def servo_map(self) -> tuple[ServoMap, dict[str, int]]:
        """The servo map of action pages, and the servo of each joint."""
        servos = servo_map_of(self.robot, FormatOptions())
        return servos, servo_ids(self.robot, servos)

    def save(self) -> Path:
        """Write the file, whole or not at all.

        Raises:
            OutputError: it cannot be written.
        """
        with replacing(self.path) as scratch:
            scratch.write_bytes(self.content)
        return self.path


def keyframe_file(name: str | Path, robot: Robot) -> KeyframeFile:
    """Return a file of keyframes, without content if it does not exist.

    Args:
        name: name of the file; `FILE#PAGE` selects a page of action pages.
        robot: the robot with the joints of the file; action pages need its servo map.

    Raises:
        UsageError: the suffix is unknown, or the page is out of range.
        FileError: the file cannot be read.
    """
    text, _, page = str(name).partition("#")
    path = Path(text)
    if path.suffix not in LAYOUTS:
        raise UsageError(f"{path}: not a file of keyframes by its suffix; {known(LAYOUTS)}")
    if page and not (page.isascii() and page.isdigit() and 0 < int(page) < PAGES):
        raise UsageError(f"{name}: pages are 1 to {PAGES - 1}, got {page!r}")
    return KeyframeFile(path, robot, int(page or 1), file_bytes(path) if path.exists() else b"")


# JSON, as in the animations of the Bit-Bots.

DEGREE = float(np.pi / 180)
ANGLE_DECIMALS = 4
"""Decimals of a written angle [°], by definition: 1e-4° is about a thousandth of a step of the encoders, 360°/4096."""


def _from_json(file: KeyframeFile) -> list[Pose]:
    try:
        rows = parse_json(file.content.decode(), file.path, TrajectoryError)["keyframes"]
        times = [(float(row.get("duration", 1.0)), float(row.get("pause", 0.0))) for row in rows]
        goals = [
            {joint: float(angle) * DEGREE for joint, (_, angle) in _goals(row, file.robot).items()} for row in rows
        ]
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise TrajectoryError(
            f"no list `keyframes` of tables with duration, pause and goals by joint: {error}"
        ) from error
    return [Pose(angles, *time) for angles, time in zip(goals, times, strict=True)]


def _goals(row: Mapping[str, Any], robot: Robot) -> dict[str, tuple[str, Any]]:
    """Return name and angle of each goal of a row, by joint."""
    return {joint_called(name, robot): (name, angle) for name, angle in row.get("goals", {}).items()}


def _to_json(file: KeyframeFile, poses: Sequence[Pose]) -> bytes:
    content = json.loads(file.content) if file.content else {"name": file.path.stem, "keyframes": []}
    rows = []
    for pose in poses:
        row = {} if pose.step is None else content["keyframes"][pose.step]
        goals, theirs = {}, _goals(row, file.robot)
        for joint, angle in pose.angles.items():
            name, value = theirs.get(joint, (joint, "nan"))
            goals[name] = value if float(value) * DEGREE == angle else round(angle / DEGREE, ANGLE_DECIMALS)
        rows.append(row | {"duration": pose.seconds, "pause": pose.pause, "goals": goals})
    return (json.dumps(content | {"keyframes": rows}, indent=4) + "\n").encode()


# Action pages of ROBOTIS.


def _from_pages(file: KeyframeFile) -> list[Pose]:
    pages, (servos, ids), found = pages_in(file.content), file.servo_map, list[Pose]()
    for page, step in steps_of(pages, file.page) if pages[file.page]["stepnum"] else ():
        ticks, (motion, pause) = pages[page]["step"][step]["position"], cycles_of(pages[page], step)
        moved = {joint: servos[joint].radians(int(ticks[k])) for joint, k in ids.items() if not ticks[k] & INVALID}
        found.append(Pose(moved, motion * CYCLE, pause * CYCLE))
    return found


def _to_pages(file: KeyframeFile, poses: Sequence[Pose]) -> bytes:
    """Return the pages with other poses.

    Poses of an unchanged number keep their steps. Else a page holds seven steps, and free pages hold the poses that do not fit.
    """
    pages = pages_in(file.content) if file.content else np.tile(empty_page(), PAGES)
    old = steps_of(pages, file.page) if pages[file.page]["stepnum"] else []
    if not old:
        pages[file.page]["name"] = file.path.stem[:13].encode("ascii", "replace")
    new, chain = pages.copy(), list(dict.fromkeys(page for page, _ in old)) or [file.page]
    spots = old
    if len(old) != len(poses):
        places = [*chain, *(page for page in range(1, PAGES) if not pages[page]["stepnum"] and page not in chain)]
        if len(poses) > STEPS * len(places):
            raise UsageError(f"{file.path}: {len(poses)} keyframes, and its free pages hold {STEPS * len(places)}")
        spots = [(places[k // STEPS], k % STEPS) for k in range(len(poses))]
        used, new[chain] = list(dict.fromkeys(page for page, _ in spots)), empty_page()
        for page, following in zip(used, [*used[1:], pages[chain[-1]]["next"]], strict=True):
            new[page] = pages[page if page in chain else chain[0]]
            new[page]["next"], new[page]["stepnum"] = following, sum(place == page for place, _ in spots)
    for pose, (page, step) in zip(poses, spots, strict=True):
        row, column = (None, 0) if pose.step is None else old[pose.step]
        new[page]["step"][step] = _step(
            file, empty_page()[0] if row is None else pages[row], column, pose, new[page]["speed"]
        )
    return bytes_of(new, sorted({*chain, *(page for page, _ in spots)}))


def _step(file: KeyframeFile, page: Any, row: int, pose: Pose, speed: int) -> Any:
    """Return the step of a pose; registers without a joint keep the values of the step before.

    Raises:
        UsageError: a time is out of range at the speed of the page.
    """
    step, (servos, ids) = page["step"][row].copy(), file.servo_map
    for joint, servo in ids.items():
        if joint in pose.angles:
            step["position"][servo] = servos[joint].ticks(pose.angles[joint])
    for what, seconds, cycles in zip(("time", "pause"), (pose.seconds, pose.pause), cycles_at(speed), strict=True):
        off = np.abs(CYCLE * cycles - seconds)
        step[what] = step[what] if off[step[what]] == 0 else off.argmin()
        if off.min() > CYCLE * np.diff(cycles).max():
            least, most = CYCLE * cycles[[0, -1]]
            raise UsageError(f"a {what} of {seconds:g} s: a step of page {file.page} takes {least:.3g} to {most:.3g} s")
    return step


LAYOUTS = {".json": (_from_json, _to_json), ".bin": (_from_pages, _to_pages)}
"""Functions that read and write the content, by the suffix of the file."""
