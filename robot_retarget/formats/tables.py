"""Tables of text: rows of numbers without a header, `csv` with a header that names units, and `soma`."""

import csv
import io
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from robot_retarget.base.arrays import Floats
from robot_retarget.base.errors import TrajectoryError, known
from robot_retarget.base.files import plain_cell
from robot_retarget.formats.columns import FIRST_LAST, LAST_FIRST, Columns, joint_called
from robot_retarget.formats.robot_motion import RobotMotion
from robot_retarget.formats.source import ROWS, TrajectoryFormat, TrajectorySource, declared
from robot_retarget.robot.model import FREE, HINGE, Robot

# Tables without a header: root x y z [m], a quaternion, joints [rad]. Several formats are that and differ in the quaternion.

NUMBER = "%.12g"
ROOT = 7


def rows_format(name: str) -> TrajectoryFormat:
    """Return a format of rows at 30 frames a second; the quaternion is `wxyz` or `xyzw`."""
    from_file, to_file = (
        (slice(None),) * 2 if ROWS[name].get("quaternion", "wxyz") == "wxyz" else (FIRST_LAST, LAST_FIRST)
    )

    def write(motion: RobotMotion, path: Path) -> None:
        rows = np.column_stack([motion.position, motion.quaternion[:, to_file], motion.angles])
        np.savetxt(path, rows, fmt=NUMBER, delimiter=",")

    def read(source: TrajectorySource) -> Columns:
        rows = number_rows(source)
        return Columns(rows[:, ROOT:], source.names(), rows[:, :3], rows[:, 3:ROOT][:, from_file], source.sidecar_fps)

    return declared(name, write, read, looks_like_rows)


def number_rows(source: TrajectorySource) -> Floats:
    """(T, C) the numbers of a table.

    Raises:
        TrajectoryError: a line that is not numbers or has another width, or fewer columns than a root has.
    """
    try:
        rows = np.loadtxt(source.text.split("\n"), delimiter=",", ndmin=2)
    except ValueError as error:
        raise TrajectoryError(f"not a table of numbers: {error}") from error
    if not rows.size:
        raise TrajectoryError("no rows")
    if rows.shape[1] <= ROOT:
        raise TrajectoryError(f"{rows.shape[1]} columns; a root takes {ROOT} and every joint one")
    return rows


def looks_like_rows(source: TrajectorySource) -> bool:
    """Whether a file is a table of numbers whose columns 3 to 6 are a unit quaternion, in either order."""
    fields = source.head.split(",")
    try:
        first = np.array([float(field) for field in fields])
    except ValueError:
        return False
    return len(first) > ROOT and abs(float(np.linalg.norm(first[3:ROOT])) - 1) < 0.01


UNITREE, KIMODO, PROTOMOTIONS_CSV = map(rows_format, ("unitree", "kimodo", "protomotions-csv"))


# Tables with a header: `csv`, every robot with units, and `soma`.

# Format `csv`: one row a frame, a header that names every column and its unit.
#
# `time [s]`, then qpos in the model's order: a free root as `root_x [m]` … `root_qw [-]`, `root_qx [-]` … (quaternion
# w x y z), sliding joints in metres, hinges in radians; `left_foot_contact [-]`, `right_foot_contact [-]`: 1 where a part of the sole stands.

TIME = "time [s]"
FREE_COLUMNS = ("x [m]", "y [m]", "z [m]", "qw [-]", "qx [-]", "qy [-]", "qz [-]")
HINGE_UNIT = " [rad]"
CONTACT = "_contact [-]"
"""Ends the name of a column that says whether a foot stands."""
STRAY_TIME = 0.01
"""Times may stray from even ones by this part of a frame: a table is played at one rate."""


def write_csv(motion: RobotMotion, path: Path) -> None:
    """Write the table."""
    times = np.arange(len(motion)) / motion.fps
    feet = motion.foot_contacts
    header = ",".join(quoted(name) for name in (*columns(motion.robot), *(f"{foot}{CONTACT}" for foot in feet)))
    rows = np.column_stack([times, motion.qpos, *feet.values()])
    np.savetxt(path, rows, fmt=NUMBER, delimiter=",", header=header, comments="", encoding="utf-8")


def read_csv(source: TrajectorySource) -> Columns:
    """Read the table; columns may have any order, and coordinates without one keep the standing pose."""
    header, rows = named_table(source)
    kept = [k for k, name in enumerate(header) if not name.endswith(CONTACT)]
    header, rows = [header[k] for k in kept], rows[:, kept]
    wanted = columns(source.robot)
    if TIME not in header:
        raise TrajectoryError(f"no column {TIME!r}; {known(header)}")
    names = [name if name in wanted else _column_called(name, source.robot, wanted) for name in header]
    if not any(name.endswith(HINGE_UNIT) for name in names):
        raise TrajectoryError(f"no column of a joint; {known(wanted)}")
    qpos = np.tile(source.robot.standing(), (len(rows), 1))
    for name, values in zip(names, rows.T, strict=True):
        if name != TIME:
            qpos[:, wanted.index(name) - 1] = values
    held = [name for name in wanted if name not in names]
    notes = (f"No column for {', '.join(held)}: held as the robot stands.",) if held else ()
    return Columns(qpos=qpos, fps=rate(rows[:, names.index(TIME)]), notes=notes)


def _column_called(name: str, robot: Robot, wanted: list[str]) -> str:
    """The column of the joint that a header names with another suffix.

    Raises:
        TrajectoryError: no joint of the robot has that name.
    """
    if not name.endswith(HINGE_UNIT):
        raise TrajectoryError(f"column {name!r} is not one of {robot.name!r}; {known(wanted, typed=name)}")
    return joint_called(name.removesuffix(HINGE_UNIT), robot) + HINGE_UNIT


def named_table(source: TrajectorySource) -> tuple[list[str], Floats]:
    """The header and the numbers of a table.

    Raises:
        TrajectoryError: a line that is not numbers or has another width than the header, or a name twice.
    """
    header = next(csv.reader(io.StringIO(source.head)), [])
    header = [name[1:] if name == plain_cell(name[1:]) else name for name in header]
    try:
        rows = np.loadtxt(source.text.split("\n")[1:], delimiter=",", ndmin=2)
    except ValueError as error:
        raise TrajectoryError(f"not a table of numbers under its header: {error}") from error
    if not np.isfinite(rows).all():
        row, column = np.argwhere(~np.isfinite(rows))[0]
        raise TrajectoryError(f"column {header[column]!r} is not finite in row {row}")
    if rows.shape[1] != len(header) or not len(rows):
        raise TrajectoryError(f"{len(header)} names over {len(rows)} rows of {rows.shape[1]} columns")
    twice = sorted({name for name in header if header.count(name) > 1})
    if twice:
        raise TrajectoryError(f"column {twice[0]!r} stands twice in the header")
    return header, rows


def rate(times: Floats) -> float | None:
    """Frames per second of even times [s]; None of a single frame.

    Raises:
        TrajectoryError: they are not even.
    """
    if len(times) < 2:
        return None
    fps = (len(times) - 1) / (times[-1] - times[0]) if times[-1] > times[0] else 0.0
    strayed = np.abs((times - times[0]) * fps - np.arange(len(times))) > STRAY_TIME
    if fps <= 0 or strayed.any():
        row = int(np.argmax(strayed)) if fps > 0 else len(times) - 1
        raise TrajectoryError(f"times are not even: frame {row} is at {times[row]:g} s")
    return float(np.round(fps, 6))


def columns(robot: Robot) -> list[str]:
    """The header: 1 + nq names with units."""
    hinges = dict(zip(robot.joint_ids.tolist(), robot.joint_names, strict=True))
    names = [TIME]
    for joint in range(robot.model.njnt):
        name = hinges.get(joint) or robot.model.joint(joint).name or f"joint_{joint}"
        kind = robot.model.jnt_type[joint]
        if kind == FREE:
            prefix = "root" if joint in robot.root_joints else name
            names += [f"{prefix}_{column}" for column in FREE_COLUMNS]
        else:
            names.append(f"{name}{HINGE_UNIT}" if kind == HINGE else f"{name} [m]")
    return names


def quoted(name: str) -> str:
    """A field as RFC 4180 writes it, with an apostrophe before text that a spreadsheet would evaluate as a formula."""
    name = plain_cell(name)
    return '"' + name.replace('"', '""') + '"' if set(name) & set(',"\n\r') else name


CSV = declared(
    "csv",
    write_csv,
    read_csv,
    lambda source: source.head.startswith(TIME) and ("[rad]" in source.head or "[m]" in source.head),
)


# Format `soma`: SOMA's csv, in which BONES-SEED comes too.
#
# `Frame`, `root_translateX` … **[cm]**, `root_rotateX` … **[degrees]**, R = R_z R_y R_x about fixed axes, then `NAME_dof`
# (version 0.1, BONES-SEED) or `NAME` (version 0.2) **[degrees]**. No rate in the file: 120 frames per second are taken.

SOMA_ROOT = [f"root_{what}{axis}" for what in ("translate", "rotate") for axis in "XYZ"]
FRAME = "Frame"
JOINT = "_dof"
"""Behind the joints' names where this package writes them."""
CENTIMETRES = 100.0


def write_soma(motion: RobotMotion, path: Path) -> None:
    """Write the table."""
    turns = Rotation.from_quat(motion.quaternion, scalar_first=True).as_euler("xyz", degrees=True)
    rows = np.column_stack([motion.position * CENTIMETRES, turns, np.degrees(motion.angles)])
    with path.open("w", newline="", encoding="utf-8") as stream:
        csv.writer(stream, lineterminator="\n").writerow(
            [FRAME, *SOMA_ROOT, *(plain_cell(name + JOINT) for name in motion.joints)]
        )
        np.savetxt(
            stream, np.column_stack([np.arange(len(rows)), rows]), fmt=["%d"] + [NUMBER] * rows.shape[1], delimiter=","
        )


def read_soma(source: TrajectorySource) -> Columns:
    """Read the table; columns may have any order.

    Raises:
        TrajectoryError: a column of the root is missing, or frames are.
    """
    names, rows = named_table(source)
    found = dict(zip(names, rows.T, strict=True))
    missing = [name for name in SOMA_ROOT if name not in found]
    if missing:
        raise TrajectoryError(f"no column {missing[0]!r}")
    _require_every_frame(found.get(FRAME))
    joints = [name for name in names if name not in (FRAME, *SOMA_ROOT)]
    root = np.column_stack([found[name] for name in SOMA_ROOT])
    return Columns(
        np.radians(rows[:, [names.index(name) for name in joints]]),
        tuple(joints),
        root[:, :3] / CENTIMETRES,
        Rotation.from_euler("xyz", root[:, 3:], degrees=True).as_quat(scalar_first=True),
        source.sidecar_fps,
    )


def _require_every_frame(numbers: Floats | None) -> None:
    """Raise TrajectoryError unless frames are numbered one by one."""
    if numbers is None:
        return
    steps = np.flatnonzero(np.diff(numbers) != 1)
    if steps.size:
        first = int(steps[0])
        raise TrajectoryError(f"frame {numbers[first + 1]:g} follows frame {numbers[first]:g}: rows are missing")


SOMA = declared("soma", write_soma, read_soma, lambda source: set(SOMA_ROOT) <= set(source.head.split(",")))
