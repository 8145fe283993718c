"""Format `soma`: SOMA's csv, in which BONES-SEED comes too.

`Frame`, `root_translateX` … **[cm]**, `root_rotateX` … **[degrees]**, R = R_z R_y R_x about fixed axes, then `NAME_dof`
(version 0.1, BONES-SEED) or `NAME` (version 0.2) **[degrees]**. No rate in the file: 120 frames per second are taken.
"""

import csv
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from robot_retarget.base.arrays import Floats
from robot_retarget.base.errors import TrajectoryError
from robot_retarget.formats.columns import Columns
from robot_retarget.formats.format import TrajectoryFormat
from robot_retarget.formats.robot_motion import RobotMotion
from robot_retarget.formats.source import TrajectorySource
from robot_retarget.formats.text.named_csv import named_table
from robot_retarget.formats.text.rows import NUMBER

ROOT = [f"root_{what}{axis}" for what in ("translate", "rotate") for axis in "XYZ"]
FRAME = "Frame"
JOINT = "_dof"
"""Behind the joints' names where this package writes them."""
CENTIMETRES = 100.0


def write(motion: RobotMotion, path: Path) -> None:
    """Write the table."""
    turns = Rotation.from_quat(motion.quaternion, scalar_first=True).as_euler("xyz", degrees=True)
    rows = np.column_stack([motion.position * CENTIMETRES, turns, np.degrees(motion.angles)])
    with path.open("w", newline="", encoding="utf-8") as stream:
        csv.writer(stream, lineterminator="\n").writerow([FRAME, *ROOT, *(name + JOINT for name in motion.joints)])
        np.savetxt(
            stream, np.column_stack([np.arange(len(rows)), rows]), fmt=["%d"] + [NUMBER] * rows.shape[1], delimiter=","
        )


def read(source: TrajectorySource) -> Columns:
    """Read the table; columns may have any order.

    Raises:
        TrajectoryError: a column of the root is missing, or frames are.
    """
    names, rows = named_table(source)
    found = dict(zip(names, rows.T, strict=True))
    missing = [name for name in ROOT if name not in found]
    if missing:
        raise TrajectoryError(f"no column {missing[0]!r}")
    _require_every_frame(found.get(FRAME))
    joints = [name for name in names if name not in (FRAME, *ROOT)]
    root = np.column_stack([found[name] for name in ROOT])
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


FORMAT = TrajectoryFormat(
    name="soma",
    suffix=".csv",
    description="SOMA's csv: cm, degrees, Euler angles, named joints",
    write=write,
    read=read,
    claims=lambda source: set(ROOT) <= set(source.head.split(",")),
    readers="SOMA retargeter, BONES-SEED's tools",
    fps=120.0,
    complete=False,
    ordered=True,
    quaternion="euler",
    plain=True,
)
