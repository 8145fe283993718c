"""Format `csv`: one row a frame, a header that names every column and its unit.

`time [s]`, then qpos in the model's order: a free root as `root_x [m]` … `root_qw [-]`, `root_qx [-]` … (quaternion
w x y z), sliding joints in metres, hinges in radians.
"""

from pathlib import Path

import numpy as np

from robot_retarget.robot.model import FREE, HINGE, Robot
from robot_retarget.trajectory import Trajectory

FREE_COLUMNS = ("x [m]", "y [m]", "z [m]", "qw [-]", "qx [-]", "qy [-]", "qz [-]")
NUMBER = "%.10g"


def write(trajectory: Trajectory, robot: Robot, path: Path) -> None:
    """Write the table at the trajectory's own frame rate."""
    times = np.arange(len(trajectory)) / trajectory.fps
    header = ",".join(_quoted(name) for name in columns(robot))
    rows = np.column_stack([times, trajectory.qpos])
    np.savetxt(path, rows, fmt=NUMBER, delimiter=",", header=header, comments="", encoding="utf-8")


def columns(robot: Robot) -> list[str]:
    """The header: 1 + nq names with units."""
    hinges = dict(zip(robot.joint_ids.tolist(), robot.joint_names, strict=True))
    names = ["time [s]"]
    for joint in range(robot.model.njnt):
        name = hinges.get(joint) or robot.model.joint(joint).name or f"joint_{joint}"
        kind = robot.model.jnt_type[joint]
        if kind == FREE:
            prefix = "root" if joint in robot.root_joints else name
            names += [f"{prefix}_{column}" for column in FREE_COLUMNS]
        else:
            names.append(f"{name} [rad]" if kind == HINGE else f"{name} [m]")
    return names


def _quoted(name: str) -> str:
    """A field as RFC 4180 writes it."""
    return '"' + name.replace('"', '""') + '"' if set(name) & set(',"\n\r') else name
