"""Action pages of ROBOTIS robots (motion_4095.bin): their layout, and the format `op3-action`.

256 pages of 512 bytes: a header of 64 bytes and seven steps of 31 goal positions [tick] by servo id, a pause and a time. The
player moves straight from step to step when `accel` is 0; a step of time n takes n + 3 of its cycles of 8 ms, because it
spends three cycles between sections. `next` links the pages. The bytes of a page add up to 255. No root; servos whose
position has the bit 0x4000 stay. `speed` / 32 is a factor of all times of a page.
"""

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from robot_retarget.actuators.map import ServoMap
from robot_retarget.base.arrays import Floats, Ints
from robot_retarget.base.errors import TrajectoryError, UsageError
from robot_retarget.base.untrusted.limits import file_bytes
from robot_retarget.formats.columns import Columns
from robot_retarget.formats.robot_motion import RobotMotion
from robot_retarget.formats.servo_files import servo_map_of
from robot_retarget.formats.source import TrajectorySource, declared
from robot_retarget.robot.model import Robot

PAGES, STEPS, IDS = 256, 7, 31
SIZE = 512
PAGE = np.dtype(
    [
        ("name", "S14"), ("reserved1", "u1"), ("repeat", "u1"), ("schedule", "u1"), ("reserved2", "u1", 3),
        ("stepnum", "u1"), ("reserved3", "u1"), ("speed", "u1"), ("reserved4", "u1"), ("accel", "u1"), ("next", "u1"),
        ("exit", "u1"), ("reserved5", "u1", 4), ("checksum", "u1"), ("pgain", "u1", IDS), ("reserved6", "u1"),
        ("step", [("position", "<u2", IDS), ("pause", "u1"), ("time", "u1")], STEPS),
    ]
)  # fmt: skip
TIME_BASE, SPEED, GAIN, INVALID = 0x0A, 32, 0x55, 0x4000
"""The schedule by time, the speed at which a time is a number of cycles, the gain of new pages, and a position of none."""
CYCLE = 0.008
"""Of the player [s]."""
LONGEST_UNEVEN = 3600.0
"""Of a motion whose steps are not even, which is read at every cycle [s]."""
BETWEEN = 3
"""Cycles that the player spends between the sections of a step."""
Pages = NDArray[Any]
"""(256,) of `PAGE`."""


def pages_in(data: bytes) -> Pages:
    """Return the pages of a file's bytes.

    Raises:
        TrajectoryError: the file has another size.
    """
    if len(data) != PAGES * SIZE:
        raise TrajectoryError(f"{len(data)} bytes; {PAGES} pages have {PAGES * SIZE}")
    return np.frombuffer(data, PAGE).copy()


def bytes_of(pages: Pages, changed: Sequence[int] = range(PAGES)) -> bytes:
    """Return the bytes of pages, those that have changed with new checksums."""
    summed = pages.copy()
    summed["checksum"][changed] = 0
    summed["checksum"][changed] = (255 - _sums(summed)[changed]) % 256
    return summed.tobytes()


def _sums(pages: Pages) -> NDArray[np.int64]:
    return pages.view(np.uint8).reshape(PAGES, SIZE).sum(axis=1, dtype=np.int64) % 256


def empty_page() -> Pages:
    """(1,) a page without steps, as the editor makes new ones."""
    page = np.zeros(1, PAGE)
    page["schedule"], page["repeat"], page["speed"], page["accel"], page["pgain"] = TIME_BASE, 1, SPEED, SPEED, GAIN
    page["step"]["position"] = INVALID
    return page


def steps_of(pages: Pages, first: int = 1) -> list[tuple[int, int]]:
    """Return (page, step) of a page and of the pages that it leads to, each page once.

    Raises:
        TrajectoryError: a page is empty or damaged, or is timed by speed.
    """
    found, page, seen, sound = list[tuple[int, int]](), first, set[int](), _sums(pages) == 255
    while page and page not in seen and sound[page] and pages[page]["stepnum"]:
        seen.add(page)
        if pages[page]["schedule"] != TIME_BASE:
            raise TrajectoryError(f"page {page} is timed by speed, which depends on the pose before it")
        found += [(page, step) for step in range(min(int(pages[page]["stepnum"]), STEPS))]
        page = int(pages[page]["next"])
    if not found:
        used = [f"{k} {pages[k]['name'].decode('ascii', 'replace').strip()}" for k in np.flatnonzero(pages["stepnum"])]
        others = f"; pages with steps: {', '.join(used)}" if used else ""
        raise TrajectoryError(f"page {first} has no steps, or its bytes do not add up to 255{others}")
    return found


def cycles_at(speed: int) -> tuple[Ints, Ints]:
    """Return (256,) the cycles of each time of a motion, and of each time of a pause, on a page of a speed."""
    times, factor = np.arange(256), max(int(speed), 1)
    return times * factor // SPEED + BETWEEN, times * SPEED // factor


def cycles_of(page: Any, step: int) -> tuple[int, int]:
    """Return the cycles of a step's motion and of its pause."""
    motion, pause = cycles_at(page["speed"])
    return int(motion[page["step"][step]["time"]]), int(pause[page["step"][step]["pause"]])


def servo_ids(robot: Robot, servos: ServoMap) -> dict[str, int]:
    """Return the servo of each joint of a robot that pages hold.

    Raises:
        UsageError: an id is above 30.
    """
    ids = {joint: servos[joint].id for joint in servos.joints if joint in robot.joint_names}
    if high := [joint for joint, servo in ids.items() if servo >= IDS]:
        raise UsageError(f"action pages: the servo of {high[0]!r} has id {ids[high[0]]}; pages hold ids 0 to {IDS - 1}")
    return ids


# Format `op3-action`: page 1 of a file holds the first seven steps, and its `next` the others.


def write_op3_action(motion: RobotMotion, path: Path) -> None:
    """Write the pages of the motion, and empty ones after them.

    Raises:
        UsageError: no servo map is known for the robot, a servo id is above 30, or the motion is too long or too fast for pages.
    """
    servos = servo_map_of(motion.robot, motion.options)
    cycles = round(1 / motion.fps / CYCLE) - BETWEEN
    if not 1 <= cycles <= 255 or abs((cycles + BETWEEN) * CYCLE * motion.fps - 1) > 1e-6:
        raise UsageError(
            f"op3-action: a keyframe takes 4 to 258 cycles of 8 ms; --fps {motion.fps:g} is no such number"
        )
    count = -(-len(motion) // STEPS)
    if count >= PAGES:
        raise UsageError(f"op3-action: {len(motion)} keyframes need {count} pages of {PAGES - 1}: give a lower --fps")
    pages, ids = np.tile(empty_page(), PAGES), servo_ids(motion.robot, servos)
    for t, q in enumerate(motion.qpos):
        page, step = pages[1 + t // STEPS], t % STEPS
        page["stepnum"], page["step"]["time"][step] = step + 1, cycles
        for joint, servo in ids.items():
            angle = q[motion.robot.qpos_index[motion.robot.joint_names.index(joint)]]
            page["step"]["position"][step, servo] = servos[joint].ticks(float(angle))
    for k in range(1, count + 1):
        pages[k]["name"] = f"{Path(motion.trajectory.source).stem[:9]}{k:>4}".encode("ascii", "replace")
        pages[k]["accel"], pages[k]["next"] = 0, k + 1 if k < count else 0
    path.write_bytes(bytes_of(pages))


def read_op3_action(source: TrajectorySource) -> Columns:
    """Read the steps of page 1 and of the pages that it leads to, once each.

    Raises:
        TrajectoryError: the file has another size, page 1 is empty or damaged, or a page is timed by speed.
    """
    servos, pages = servo_map_of(source.robot, source.options), pages_in(file_bytes(source.path))
    steps = steps_of(pages)
    ticks = np.array([pages[page]["step"][step]["position"] for page, step in steps], float)
    durations = np.array([CYCLE * sum(cycles_of(pages[page], step)) for page, step in steps])
    joints, goals = [j for j in servos.joints if servos[j].id < IDS], _held(ticks)
    used = [j for j in joints if np.isfinite(goals[:, servos[j].id]).all()]
    angles = np.array([[servos[j].radians(t) for t in goals[:, servos[j].id]] for j in used]).T
    angles, fps = _even(angles, durations)
    return Columns(angles, tuple(used), fps=fps)


def _held(ticks: Floats) -> Floats:
    """(S, 31) where a servo without a position keeps its last one; NaN before its first."""
    goals = np.where(ticks.astype(int) & INVALID, np.nan, ticks)
    for before, now in pairwise(goals):
        now[np.isnan(now)] = before[np.isnan(now)]
    return goals


def _even(angles: Floats, durations: Floats) -> tuple[Floats, float]:
    """Keyframes at one rate: unchanged if their times are equal, else straight between them at the player's cycles."""
    if np.allclose(durations[1:], durations[:1]):
        return angles, float(1 / durations[0])
    times = np.cumsum(durations) - durations[0]
    if times[-1] > LONGEST_UNEVEN:
        raise TrajectoryError(f"its steps and pauses last {times[-1]:.0f} s, more than {LONGEST_UNEVEN:g} s")
    grid = np.arange(0.0, times[-1] + CYCLE / 2, CYCLE)
    return np.stack([np.interp(grid, times, column) for column in angles.T], axis=1), 1 / CYCLE


OP3_ACTION = declared(
    "op3-action",
    write_op3_action,
    read_op3_action,
    lambda source: source.path.is_file() and source.path.stat().st_size == PAGES * SIZE,
)
