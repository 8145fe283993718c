"""Columns of a robot-motion file, arrays by their names, orders of quaternions, and the trajectory of a robot that they describe."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from robot_retarget.base.arrays import Floats, Ints
from robot_retarget.base.errors import FileError, TrajectoryError, UsageError, known
from robot_retarget.base.untrusted.arrays import rate_of, shaped
from robot_retarget.formats.robot_motion import SKIPPED, FormatOptions
from robot_retarget.robot.model import Robot
from robot_retarget.scene import Scene
from robot_retarget.trajectory import Trajectory

LAST_FIRST = (1, 2, 3, 0)
"""w x y z → x y z w."""
FIRST_LAST = (3, 0, 1, 2)
"""x y z w → w x y z."""
ORDERS = ("wxyz", "xyzw")
ORDER_DOUBT = 0.5
"""Gain of uprightness in the other order that makes the order doubtful [cosine of the root's lean]."""


def reordered(quaternion: Floats, format: str, given: str) -> Floats:
    """(T, 4) w x y z from quaternions that were read in the format's order and are in the user's order.

    Raises:
        UsageError: the order is unknown, or the format holds no quaternion.
    """
    if given not in ORDERS or format not in ORDERS:
        what = "the format holds no quaternion" if format not in ORDERS else f"no order {given!r} of quaternions"
        raise UsageError(f"--quaternion: {what}; {known(ORDERS)}")
    if given == format:
        return quaternion
    return quaternion[:, LAST_FIRST if format == "xyzw" else FIRST_LAST]


def doubt(quaternion: Floats, format: str, robot: Robot) -> tuple[str, ...]:
    """A sentence where the robot would stand far more upright if the quaternions were in the other order."""
    if format not in ORDERS or not robot.floating:
        return ()
    other = ORDERS[1 - ORDERS.index(format)]
    read, swapped = (_upright(values, robot) for values in (quaternion, reordered(quaternion, format, other)))
    if swapped < read + ORDER_DOUBT:
        return ()
    return (f"Read as {format} the robot leans or lies; as {other} it would stand: if so, say --quaternion {other}.",)


def _upright(quaternion: Floats, robot: Robot) -> float:
    """Median cosine between the vertical and the root's axis that is vertical in the standing pose."""
    start = robot.root_address + 3
    stands = Rotation.from_quat(robot.standing()[start : start + 4], scalar_first=True)
    turns = Rotation.from_quat(quaternion, scalar_first=True)
    return float(np.median((turns * stands.inv()).apply([0.0, 0.0, 1.0])[:, 2]))


COLUMN_NORM = 0.05
"""Largest deviation of a quaternion's norm from one; beyond it the columns are out of order. Straight interpolation between
two rotations 36° apart strays by it."""
NOTED = 1e-3
"""Norms that deviate further are normalised with a note; single precision strays by 1e-7."""
ROUNDED = 1e-6
"""Norms nearer to one are not normalised, so that exact numbers stay exact."""
SUFFIXES = ("_dof", "_joint")
"""Endings of joint names that programs add and drop, in the order of removal."""


@dataclass(frozen=True)
class Columns:
    """The motion that a file holds, in metres, radians and quaternions w x y z."""

    angles: Floats | None = None
    """(T, n) of joints [rad]; None where `qpos` says all."""
    names: tuple[str, ...] | None = None
    """Of the joints; None where the file says none."""
    position: Floats | None = None
    """(T, 3) of the root [m]; None where the file holds joints only."""
    quaternion: Floats | None = None
    """(T, 4) of the root, w x y z."""
    fps: float | None = None
    """[1/s]; None where the file says none."""
    order: Ints | None = None
    """(n,) of a file without names: which hinge of the robot each column is; None is the model's order."""
    qpos: Floats | None = None
    """(T, nq) of files that hold MuJoCo's own coordinates of the whole model."""
    source: str = ""
    notes: tuple[str, ...] = ()
    object: Floats | None = None
    """(T, 7) poses of a body next to the robot, x y z [m], w x y z; None in files without them."""
    scene: Scene | None = None
    """The bodies around the robot, where the file has their shapes."""

    def __post_init__(self) -> None:
        for what in ("angles", "position", "quaternion", "qpos", "object"):
            values = getattr(self, what)
            if values is not None and not np.isfinite(values).all():
                frame, column = np.argwhere(~np.isfinite(values))[0]
                raise TrajectoryError(f"{what} is not finite at frame {frame}, column {column}")


def holds(value: Any, *keys: str) -> bool:
    """Whether a value is a dictionary with these keys."""
    return isinstance(value, Mapping) and all(key in value for key in keys)


def array_in(table: Any, key: str, shape: tuple[int | None, ...]) -> Floats:
    """An array, or lists of numbers, by its key.

    Raises:
        FileError: it is not there or has another shape.
    """
    if not holds(table, key):
        raise FileError(f"no {key!r}; {known(table) if isinstance(table, Mapping) else 'no table of arrays'}")
    try:
        return shaped(np.asarray(table[key]), shape, key)
    except ValueError as error:
        raise FileError(f"{key!r} is no array: {error}") from error


@dataclass(frozen=True)
class ArrayKeys:
    """Names of the arrays of root and joints in a dictionary or an archive."""

    position: str
    quaternion: str
    angles: str
    order: str = "wxyz"
    """Of the quaternions."""
    bodies: bool = False
    """Whether the arrays hold all bodies, the root first."""

    @property
    def required(self) -> tuple[str, str, str]:
        """The names of all three."""
        return self.position, self.quaternion, self.angles


def keyed(table: Any, keys: ArrayKeys, names: tuple[str, ...] | None) -> Columns:
    """Return the columns of arrays by their names.

    Raises:
        FileError: an array is not there, or has another shape.
    """
    angles = array_in(table, keys.angles, (None, None))
    bodies: tuple[None, ...] = (None,) if keys.bodies else ()
    position = array_in(table, keys.position, (len(angles), *bodies, 3))
    quaternion = array_in(table, keys.quaternion, (len(angles), *position.shape[1:-1], 4))
    if keys.bodies:
        position, quaternion = position[:, 0], quaternion[:, 0]
    turned = quaternion if keys.order == "wxyz" else quaternion[:, FIRST_LAST]
    return Columns(angles, names, position, turned, rate_of(table))


def assembled(columns: Columns, robot: Robot, options: FormatOptions, fps: float | None = None) -> Trajectory:
    """Make the trajectory of a robot from a file's columns; coordinates without a column keep the standing pose.

    Args:
        fps: default of the format, if neither the user nor the file gives a rate [1/s].

    Raises:
        TrajectoryError: columns of the wrong width, names that are not the robot's, a quaternion that is not unit, or a
            file without joint names whose width is not the robot's.
        UsageError: `FormatOptions.joints` has another length than the file's columns, or no rate is known.
    """
    rate = next((given for given in (options.source_fps, columns.fps, fps) if given is not None), None)
    if rate is None:
        raise UsageError("the file does not say its frames per second: say them with --source-fps")
    qpos, notes = _placed(columns, robot, options) if columns.qpos is None else _whole(columns.qpos, robot, options)
    if robot.floating:
        turn = slice(robot.root_address + 3, robot.root_address + 7)
        qpos[:, turn], off = _unit(qpos[:, turn])
        notes = (*notes, *off)
    return Trajectory(qpos, rate, robot.joint_names, robot.name, columns.source, (*columns.notes, *notes))


def _whole(qpos: Floats, robot: Robot, options: FormatOptions) -> tuple[Floats, tuple[str, ...]]:
    """Coordinates of the whole model, if they have its width."""
    if options.joints is not None:
        raise UsageError("the file holds the coordinates of the whole model: --joints means nothing to it")
    if qpos.ndim != 2 or qpos.shape[1] != robot.model.nq:
        raise TrajectoryError(f"{qpos.shape[-1]} coordinates, and {robot.name!r} has {robot.model.nq}")
    return np.array(qpos), ()


def _placed(columns: Columns, robot: Robot, options: FormatOptions) -> tuple[Floats, tuple[str, ...]]:
    """Coordinates of the robot's model from root and joints, with notes."""
    assert columns.angles is not None
    qpos = np.tile(robot.standing(), (len(columns.angles), 1))
    taken, places, notes = _places(columns.names, columns.angles.shape[1], columns.order, robot, options)
    qpos[:, places] = columns.angles[:, taken]
    if robot.floating and columns.position is not None and columns.quaternion is not None:
        start = robot.root_address
        qpos[:, start : start + 3] = columns.position
        qpos[:, start + 3 : start + 7] = columns.quaternion
    else:
        notes = (*notes, "The file holds no root that the robot has: it stands where the robot stands.")
    return qpos, notes


def _places(
    given: tuple[str, ...] | None, width: int, order: Ints | None, robot: Robot, options: FormatOptions
) -> tuple[list[int], Ints, tuple[str, ...]]:
    """The columns that are used, their addresses in qpos, and notes."""
    names = options.joints or given
    if names is None:
        if width != len(robot.joint_names):
            raise TrajectoryError(
                f"{width} joint columns without names, and {robot.name!r} has {len(robot.joint_names)} joints: "
                "name the columns with --joints a,b,…"
            )
        return list(range(width)), robot.qpos_index[np.arange(width) if order is None else order], ()
    if len(names) != width:
        error = UsageError if options.joints else TrajectoryError
        raise error(f"{len(names)} joint names for {width} joint columns")
    taken = [k for k, name in enumerate(names) if name != SKIPPED]
    named = [joint_called(names[k], robot) for k in taken]
    if not named:
        raise TrajectoryError(f"no column of a joint; {known(robot.joint_names)}")
    twice = sorted({name for name in named if named.count(name) > 1})
    if twice:
        raise TrajectoryError(f"joint {twice[0]!r} stands twice among the columns")
    held = [name for name in robot.joint_names if name not in named]
    notes = (f"No column for {', '.join(held)}: held as the robot stands.",) if held else ()
    return taken, robot.qpos_index[[robot.joint_names.index(name) for name in named]], notes


def joint_called(name: str, robot: Robot) -> str:
    """The robot's joint of this name, with or without the usual suffixes.

    Raises:
        TrajectoryError: no joint has this name, or several have.
    """
    if name in robot.joint_names:
        return name
    alike = [joint for joint in robot.joint_names if _bare(joint) == _bare(name)]
    if len(alike) != 1:
        what = f"may be {' or '.join(map(repr, alike))}" if alike else "is not one"
        raise TrajectoryError(
            f"joint {name!r} {what} of {robot.name!r}; {known(robot.joint_names)}. "
            "Rename the columns with --joints a,b,…, `_` for one to leave out"
        )
    return alike[0]


def _bare(name: str) -> str:
    for suffix in SUFFIXES:
        name = name.removesuffix(suffix)
    return name


def _unit(quaternion: Floats) -> tuple[Floats, tuple[str, ...]]:
    """(T, 4) normalised, with a note where that changes more than rounding."""
    norms = np.linalg.norm(quaternion, axis=1, keepdims=True)
    off = np.abs(norms[:, 0] - 1.0)
    if off.max(initial=0.0) > COLUMN_NORM:
        frame = int(np.argmax(off > COLUMN_NORM))
        raise TrajectoryError(
            f"frame {frame}: the root's quaternion has the norm {norms[frame, 0]:.4g}; are the columns in another order?"
        )
    frames = int((off > NOTED).sum())
    note = f"The root's quaternion is normalised: its norm is from {norms.min():.4g} to {norms.max():.4g}, off by over {NOTED:g} in {frames} frames."
    return np.where(off.max(initial=0.0) > ROUNDED, quaternion / norms, quaternion), (note,) if frames else ()
