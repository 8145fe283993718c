"""Goals of servos: `servo-ticks`, a table, and `op3-action`, pages of the ROBOTIS OP3."""

import csv
from itertools import pairwise
from pathlib import Path

import numpy as np

from robot_retarget.actuators.map import ServoMap, load_map, shipped_maps
from robot_retarget.base.arrays import Floats
from robot_retarget.base.errors import TrajectoryError, UsageError, known
from robot_retarget.base.files import plain_cell
from robot_retarget.base.untrusted.limits import file_bytes
from robot_retarget.formats.columns import Columns, joint_called
from robot_retarget.formats.robot_motion import FormatOptions, RobotMotion
from robot_retarget.formats.source import TrajectorySource, declared
from robot_retarget.formats.tables import NUMBER, TIME, named_table, rate
from robot_retarget.robot.model import Robot

# Format `servo-ticks`: goal positions of Dynamixel servos, `time [s]` and `NAME [tick]` a joint, by the robot's servo map.
#
# ticks = zero + sign · gear · q · 4096 / 2π, rounded: a written file reads back to within a tick. Joints without a servo are not
# in the file, and no root is.

TICK = " [tick]"


def write_servo_ticks(motion: RobotMotion, path: Path) -> None:
    """Write the table.

    Raises:
        UsageError: no servo map is known for the robot.
    """
    servos, place = servo_map_of(motion.robot, motion.options), motion.robot.joint_names
    joints = [joint for joint in servos.joints if joint in place]
    ticks = [[servos[j].ticks(q[motion.robot.qpos_index[place.index(j)]]) for j in joints] for q in motion.qpos]
    with path.open("w", newline="", encoding="utf-8") as stream:
        csv.writer(stream, lineterminator="\n").writerow([TIME, *(plain_cell(joint + TICK) for joint in joints)])
        table = np.column_stack([np.arange(len(motion)) / motion.fps, np.array(ticks)])
        np.savetxt(stream, table, fmt=[NUMBER, *["%d"] * len(joints)], delimiter=",")


def read_servo_ticks(source: TrajectorySource) -> Columns:
    """Read the table."""
    names, rows = named_table(source)
    joints = [name.removesuffix(TICK) for name in names if name.endswith(TICK)]
    if TIME not in names or not joints:
        raise TrajectoryError(f"no {TIME!r} and NAME{TICK} among {', '.join(names[:8])}")
    servos = servo_map_of(source.robot, source.options)
    called = [joint_called(joint, source.robot) for joint in joints]
    missing = [joint for joint in called if joint not in servos.joints]
    if missing:
        raise TrajectoryError(f"no servo turns {missing[0]!r}; {known(servos.joints)}")
    ticks = [rows[:, names.index(joint + TICK)] for joint in joints]
    columns = [[servos[joint].radians(t) for t in column] for joint, column in zip(called, ticks, strict=True)]
    return Columns(np.array(columns).T, tuple(called), fps=rate(rows[:, names.index(TIME)]))


def servo_map_of(robot: Robot, options: FormatOptions) -> ServoMap:
    """Return the servo map of the options, or the one that ships with the robot.

    Raises:
        UsageError: neither is known.
    """
    if options.servos is None and robot.name not in shipped_maps():
        raise UsageError(f"no servo map for {robot.name!r}: give one with --servos; {known(shipped_maps())}")
    return load_map(options.servos or robot.name)


SERVO_TICKS = declared(
    "servo-ticks",
    write_servo_ticks,
    read_servo_ticks,
    lambda source: source.head.startswith(TIME) and TICK in source.head,
)


# Format `op3-action`: action pages of the ROBOTIS OP3, `motion_4095.bin`, as its action editor opens them.
#
# 256 pages of 512 bytes: a header of 64 bytes and seven steps of 31 goal positions [tick] by servo id, a pause and a time. The
# player moves straight from step to step when `accel` is 0; a step of time n takes n + 3 of its cycles of 8 ms, because it
# spends three cycles between sections. Page 1 holds the first seven steps, and `next` links the pages. The bytes of a page
# add up to 255. No root; servos whose position has the bit 0x4000 stay.

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
LONGEST = 3600.0
"""Of a motion whose steps are not even, which is read at every cycle [s]."""
BETWEEN = 3
"""Cycles that the player spends between the sections of a step."""
FPS = 1 / (10 * CYCLE)
"""Keyframes per second: ten cycles each [1/s]."""


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
    pages = np.tile(_empty(), PAGES)
    places = [joint for joint in servos.joints if joint in motion.robot.joint_names]
    if high := [joint for joint in places if servos[joint].id >= IDS]:
        raise UsageError(
            f"op3-action: the servo of {high[0]!r} has id {servos[high[0]].id}; pages hold ids 0 to {IDS - 1}"
        )
    for t, q in enumerate(motion.qpos):
        page, step = pages[1 + t // STEPS], t % STEPS
        page["stepnum"], page["step"]["time"][step] = step + 1, cycles
        for joint in places:
            angle = q[motion.robot.qpos_index[motion.robot.joint_names.index(joint)]]
            page["step"]["position"][step, servos[joint].id] = servos[joint].ticks(float(angle))
    for k in range(1, count + 1):
        pages[k]["name"] = f"{Path(motion.trajectory.source).stem[:9]}{k:>4}".encode("ascii", "replace")
        pages[k]["accel"], pages[k]["next"] = 0, k + 1 if k < count else 0
    pages["checksum"] = (255 - pages.view(np.uint8).reshape(PAGES, SIZE).sum(axis=1, dtype=np.int64)) % 256
    path.write_bytes(pages.tobytes())


def _empty() -> np.ndarray:
    """(1,) a page without steps, as the editor makes new ones."""
    page = np.zeros(1, PAGE)
    page["schedule"], page["repeat"], page["speed"], page["accel"], page["pgain"] = TIME_BASE, 1, SPEED, SPEED, GAIN
    page["step"]["position"] = INVALID
    return page


def read_op3_action(source: TrajectorySource) -> Columns:
    """Read the steps of page 1 and of the pages that it leads to, once each.

    Raises:
        TrajectoryError: the file has another size, page 1 is empty or damaged, or a page is timed by speed.
    """
    servos = servo_map_of(source.robot, source.options)
    data = file_bytes(source.path)
    if len(data) != PAGES * SIZE:
        raise TrajectoryError(f"{len(data)} bytes; {PAGES} pages have {PAGES * SIZE}")
    pages = np.frombuffer(data, PAGE)
    sound = np.frombuffer(data, np.uint8).reshape(PAGES, SIZE).sum(axis=1, dtype=np.int64) % 256 == 255
    ticks, durations, page, seen = [], [], 1, set[int]()
    while page and page not in seen and sound[page] and pages[page]["stepnum"]:
        seen.add(page)
        if pages[page]["schedule"] != TIME_BASE:
            raise TrajectoryError(f"page {page} is timed by speed, which depends on the pose before it")
        for step in pages[page]["step"][: min(int(pages[page]["stepnum"]), STEPS)]:
            ticks.append(step["position"].astype(float))
            speed = max(int(pages[page]["speed"]), 1)
            cycles = int(step["time"]) * speed // SPEED + BETWEEN + int(step["pause"]) * SPEED // speed
            durations.append(cycles * CYCLE)
        page = int(pages[page]["next"])
    if not ticks:
        raise TrajectoryError("page 1 has no steps, or its bytes do not add up to 255")
    joints, goals = [j for j in servos.joints if servos[j].id < IDS], _held(np.array(ticks))
    used = [j for j in joints if np.isfinite(goals[:, servos[j].id]).all()]
    angles = np.array([[servos[j].radians(t) for t in goals[:, servos[j].id]] for j in used]).T
    angles, fps = _even(angles, np.array(durations))
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
    if times[-1] > LONGEST:
        raise TrajectoryError(f"its steps and pauses last {times[-1]:.0f} s, more than {LONGEST:g} s")
    grid = np.arange(0.0, times[-1] + CYCLE / 2, CYCLE)
    return np.stack([np.interp(grid, times, column) for column in angles.T], axis=1), 1 / CYCLE


OP3_ACTION = declared(
    "op3-action",
    write_op3_action,
    read_op3_action,
    lambda source: source.path.is_file() and source.path.stat().st_size == PAGES * SIZE,
)
