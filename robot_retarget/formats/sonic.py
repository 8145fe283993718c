"""Format `sonic`: a reference folder of SONIC's deployment (GR00T-WholeBodyControl), tables of text with a header row.

`joint_pos.csv`, `joint_vel.csv` (n) [rad, rad/s], joints breadth first as Isaac Lab has them; `body_pos.csv` [m],
`body_quat.csv` w x y z, `body_lin_vel.csv` [m/s], `body_ang_vel.csv` [rad/s] of all bodies in the world, breadth first, the root
first; `metadata.txt` with the index of each body in Isaac Lab's order. Joint names and frames per second follow there; SONIC
passes over them and takes 50.
"""

from itertools import pairwise
from pathlib import Path

import numpy as np

from robot_retarget.base.arrays import Floats
from robot_retarget.base.errors import TrajectoryError
from robot_retarget.base.untrusted.limits import file_bytes
from robot_retarget.formats.bodies import body_tracks, breadth_first_bodies, breadth_first_hinges, velocities
from robot_retarget.formats.columns import Columns
from robot_retarget.formats.robot_motion import RobotMotion
from robot_retarget.formats.rows import NUMBER
from robot_retarget.formats.source import TrajectorySource, declared

METADATA, NAMES, RATE = "metadata.txt", "Joint names:", "Frames per second:"
JOINTS, PLACES, TURNS = "joint_pos.csv", "body_pos.csv", "body_quat.csv"


def write(motion: RobotMotion, path: Path) -> None:
    """Fill the folder."""
    robot, qvel = motion.robot, velocities(motion)
    hinges, bodies, tracks = breadth_first_hinges(robot), breadth_first_bodies(robot), body_tracks(motion, qvel)
    joints = range(len(hinges))
    _save(path / JOINTS, motion.qpos[:, robot.qpos_index[hinges]], [f"joint_{k}" for k in joints])
    _save(path / "joint_vel.csv", qvel[:, robot.dof_index[hinges]], [f"joint_vel_{k}" for k in joints])
    for name, values, axes in (
        (PLACES, tracks.positions, "xyz"),
        (TURNS, tracks.quaternions, "wxyz"),
        ("body_lin_vel.csv", tracks.linear_of_mass, "xyz"),
        ("body_ang_vel.csv", tracks.angular, "xyz"),
    ):
        titles = [f"body_{k}_{axis}" for k in range(len(bodies)) for axis in axes]
        _save(path / name, values[:, bodies].reshape(len(motion), -1), titles)
    indices = " ".join(map(str, range(len(bodies))))
    text = f"Metadata for: {Path(motion.trajectory.source).stem or motion.robot.name}\n{'=' * 30}\n\nBody part indexes:\n[{indices}]\n\nTotal timesteps: {len(motion)}\n"
    (path / "metadata.txt").write_text(text, encoding="utf-8")


def _save(path: Path, table: Floats, titles: list[str]) -> None:
    np.savetxt(path, table, fmt=NUMBER, delimiter=",", header=",".join(titles), comments="")


def read(source: TrajectorySource) -> Columns:
    """Read the joints, and the root from the first body.

    Raises:
        TrajectoryError: a table is missing, of another length, or no table of numbers.
    """
    angles, places, turns = (_table(source.path / name) for name in (JOINTS, PLACES, TURNS))
    if not len(angles) == len(places) == len(turns):
        raise TrajectoryError(f"{len(angles)} rows of joints, {len(places)} of places, {len(turns)} of quaternions")
    names, fps = _stated(source.path / METADATA)
    return Columns(angles, names, places[:, :3], turns[:, :4], fps, breadth_first_hinges(source.robot))


def _stated(path: Path) -> tuple[tuple[str, ...] | None, float | None]:
    """Joint names and frames per second; None where the folder of another program does not say them."""
    lines = file_bytes(path).decode("utf-8", "replace").splitlines() if path.is_file() else []
    names = next((tuple(after.strip("[] ").split()) for line, after in pairwise(lines) if line.strip() == NAMES), None)
    rate = next((float(line.removeprefix(RATE)) for line in lines if line.startswith(RATE)), None)
    return names, rate


def _table(path: Path) -> Floats:
    if not path.is_file():
        raise TrajectoryError(f"lacks {path.name}")
    lines = file_bytes(path).decode("utf-8", "replace").splitlines()[1:]
    try:
        table = np.array([[float(cell) for cell in line.split(",")] for line in lines if line.strip()])
    except ValueError as error:
        raise TrajectoryError(f"{path.name}: no table of numbers ({error})") from error
    if table.ndim != 2 or not table.size:
        raise TrajectoryError(f"{path.name}: no rows after the header")
    return table


FORMAT = declared(
    "sonic", write, read, lambda source: all((source.path / name).is_file() for name in (JOINTS, PLACES, TURNS))
)
