"""Goals of servos: `servo-ticks`, a table."""

import csv
from pathlib import Path

import numpy as np

from robot_retarget.actuators.map import ServoMap, load_map, shipped_maps
from robot_retarget.base.errors import TrajectoryError, UsageError, known
from robot_retarget.base.files import plain_cell
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
    """Return the servo map of the options, that of the robot, or the one that ships with it.

    Raises:
        UsageError: none is known.
    """
    if options.servos is None and robot.servo_map is not None:
        return robot.servo_map
    if options.servos is None and robot.name not in shipped_maps():
        raise UsageError(f"no servo map for {robot.name!r}: give one with --servos; {known(shipped_maps())}")
    return load_map(options.servos or robot.name)


SERVO_TICKS = declared(
    "servo-ticks",
    write_servo_ticks,
    read_servo_ticks,
    lambda source: source.head.startswith(TIME) and TICK in source.head,
)
