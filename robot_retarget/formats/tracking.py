"""The archive that motion trackers read: joints with velocities, and the pose and velocity of every body.

`fps` (1,); `joint_pos`, `joint_vel` (T, n) [rad, rad/s]; `body_pos_w` (T, B, 3) [m], `body_quat_w` (T, B, 4) w x y z,
`body_lin_vel_w` (T, B, 3) [m/s], `body_ang_vel_w` (T, B, 3) [rad/s] of the robot's bodies without the world;
`foot_names` (F,) and `foot_contacts` (T, F), which loaders pass over. Two
programs read these keys and differ in the order of joints and bodies, which the keys do not state: the positions of the bodies decide.
"""

from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import numpy as np

from robot_retarget.base.arrays import Floats, Ints
from robot_retarget.base.errors import TrajectoryError
from robot_retarget.base.untrusted.arrays import save_npz, shaped
from robot_retarget.base.untrusted.limits import file_bytes
from robot_retarget.formats.bodies import (
    body_names,
    body_tracks,
    breadth_first_bodies,
    breadth_first_hinges,
    robot_bodies,
    velocities,
)
from robot_retarget.formats.columns import Columns
from robot_retarget.formats.robot_motion import RobotMotion
from robot_retarget.formats.source import TrajectoryFormat, TrajectorySource, declared
from robot_retarget.formats.tables import NUMBER
from robot_retarget.robot.kinematics import body_frames
from robot_retarget.robot.model import Robot

KEYS = ("joint_pos", "joint_vel", "body_pos_w", "body_quat_w", "body_lin_vel_w", "body_ang_vel_w")
SAME_BODIES = 0.005
"""Largest distance of bodies from forward kinematics in the right order [m]: descriptions of one robot differ by less."""
OTHER_BODIES = 0.05
"""Bodies farther from forward kinematics are not those of the robot in this order [m]: HDMI's file read as `beyondmimic` strays by .36."""
LOOKED_AT = 8
"""Number of frames that are compared."""


Order = tuple[Callable[[Robot], Ints], Callable[[Robot], Ints]]
"""Functions of a robot that return the order of its hinges and of its bodies in a file."""


def hinges_of(robot: Robot) -> Ints:
    """Return the hinges depth first, as MuJoCo has them."""
    return np.arange(len(robot.joint_names))


DEPTH_FIRST: Order = hinges_of, robot_bodies
BREADTH_FIRST: Order = breadth_first_hinges, breadth_first_bodies


def tracking_format(name: str, order: Order, mass: bool) -> TrajectoryFormat:
    """Return a format of these archives.

    Args:
        order: of hinges and bodies.
        mass: whether linear velocities are those of centres of mass, not of the bodies' frames.
    """
    hinges, bodies = order
    other, theirs = (breadth_first_hinges, "beyondmimic") if order == DEPTH_FIRST else (hinges_of, "mjlab")
    return declared(
        name,
        lambda motion, path: _write(motion, path, hinges(motion.robot), bodies(motion.robot), mass),
        lambda source: _read(source, hinges(source.robot), (other(source.robot), theirs)),
        lambda source: _claims(source, hinges(source.robot), other(source.robot)),
    )


def _write(motion: RobotMotion, path: Path, hinges: Ints, bodies: Ints, mass: bool) -> None:
    """Write the archive, joints and bodies in the given orders; linear velocities of origins or of mass centres."""
    robot, qvel = motion.robot, velocities(motion)
    tracks, feet = body_tracks(motion, qvel), motion.foot_contacts
    save_npz(
        path,
        fps=np.array([motion.fps]),
        joint_pos=motion.qpos[:, robot.qpos_index[hinges]],
        joint_vel=qvel[:, robot.dof_index[hinges]],
        body_pos_w=tracks.positions[:, bodies],
        body_quat_w=tracks.quaternions[:, bodies],
        body_lin_vel_w=(tracks.linear_of_mass if mass else tracks.linear)[:, bodies],
        body_ang_vel_w=tracks.angular[:, bodies],
        joint_names=np.array([robot.joint_names[k] for k in hinges]),
        body_names=np.array(body_names(robot, bodies)),
        foot_names=np.array(list(feet), dtype=np.str_),
        foot_contacts=np.array(list(feet.values()), dtype=bool).reshape(len(feet), len(motion)).T,
    )


def _read(source: TrajectorySource, hinges: Ints, other: tuple[Ints, str]) -> Columns:
    """Read it. The root is the first body.

    Args:
        hinges: (n,) the order of the joints where the file has no names.
        other: the order of the format that has the same keys, and its name.

    Raises:
        TrajectoryError: a key is missing, a shape is wrong, or the bodies stand where the other order puts them.
    """
    angles = shaped(source.array("joint_pos"), (None, None), "joint_pos")
    positions = shaped(source.array("body_pos_w"), (len(angles), None, 3), "body_pos_w")
    quaternions = shaped(source.array("body_quat_w"), (len(angles), positions.shape[1], 4), "body_quat_w")
    named = source.names() is not None or source.options.joints is not None
    if not named and angles.shape[1] == len(source.robot.joint_names):
        mine, theirs = misfit(source, hinges), misfit(source, other[0])
        if theirs < SAME_BODIES < mine:
            raise TrajectoryError(
                f"bodies are up to {mine:.3g} m from where the joints put them in this order, and within {theirs:.1g} m in "
                f"that of {other[1]!r}: say --format {other[1]}"
            )
    strayed = misfit(source, _order_of(source, hinges))
    if OTHER_BODIES < strayed < np.inf:
        raise TrajectoryError(
            f"bodies are up to {strayed:.3g} m from where the joints put them: another robot, or another order of joints "
            "(--joints a,b,…)"
        )
    return Columns(angles, source.names(), positions[:, 0], quaternions[:, 0], source.rate, hinges)


def _order_of(source: TrajectorySource, hinges: Ints) -> Ints:
    """(n,) the hinge of the robot that each column names; empty if a name is not the robot's."""
    names, robot = source.options.joints or source.names(), source.robot
    if names is None:
        return hinges
    known = set(names) == set(robot.joint_names)
    return np.array([robot.joint_names.index(name) for name in names] if known else [], dtype=np.int64)


def misfit(source: TrajectorySource, hinges: Ints) -> float:
    """Largest distance of bodies from forward kinematics for an order of the joints [m]; infinite for other shapes.

    The distances of all bodies from the root, sorted, are compared: they do not depend on the order of the bodies.
    """
    robot, angles, positions = source.robot, source.arrays["joint_pos"], source.arrays["body_pos_w"]
    count = len(robot_bodies(robot))
    if angles.ndim != 2 or angles.shape[1] != len(hinges) or positions.ndim != 3 or positions.shape[1] != count:
        return float("inf")
    frames = np.unique(np.linspace(0, len(angles) - 1, LOOKED_AT).astype(int))
    expected = _distances(robot, angles[frames], hinges)
    found = np.linalg.norm(positions[frames] - positions[frames, :1], axis=2)
    return float(np.abs(np.sort(found, axis=1) - np.sort(expected, axis=1)).max())


def _distances(robot: Robot, angles: Floats, hinges: Ints) -> Floats:
    """(F, B) of the robot's bodies from its root [m]."""
    qpos = np.tile(robot.standing(), (len(angles), 1))
    qpos[:, robot.qpos_index[hinges]] = angles
    positions = body_frames(robot, qpos)[0][:, robot_bodies(robot)]
    return np.linalg.norm(positions - positions[:, :1], axis=2)


def _claims(source: TrajectorySource, hinges: Ints, other: Ints) -> bool:
    """Whether an archive has the keys, and its names or its bodies do not speak for the other order."""
    if not set(KEYS) <= source.arrays.keys() or source.arrays["joint_pos"].shape != source.arrays["joint_vel"].shape:
        return False
    names = source.names()
    if names is not None:
        order = [source.robot.joint_names[k] for k in hinges]
        swapped = [source.robot.joint_names[k] for k in other]
        return list(names) == order or list(names) != swapped
    return misfit(source, hinges) < SAME_BODIES or misfit(source, other) >= SAME_BODIES


# Format `beyondmimic`: what whole_body_tracking's `csv_to_npz.py` makes in Isaac Lab.
#
# Joints and bodies **breadth first**; `body_lin_vel_w` is that of the bodies' centres of mass, as Isaac Lab has it. Root and
# joint velocities by central differences over two frames, bodies moved by them.

BEYONDMIMIC: TrajectoryFormat = tracking_format("beyondmimic", BREADTH_FIRST, mass=True)


# Format `mjlab`: what mjlab's `csv_to_npz.py` makes.
#
# Joints and bodies **depth first**, as MuJoCo has them; `body_lin_vel_w` is that of the bodies' frames. Root and joint
# velocities by central differences over two frames, bodies moved by them. mjlab does not read `fps`: it plays a frame a step.

MJLAB: TrajectoryFormat = tracking_format("mjlab", DEPTH_FIRST, mass=False)


# Format `sonic`: a reference folder of SONIC's deployment (GR00T-WholeBodyControl), tables of text with a header row.
#
# `joint_pos.csv`, `joint_vel.csv` (n) [rad, rad/s], joints breadth first as Isaac Lab has them; `body_pos.csv` [m],
# `body_quat.csv` w x y z, `body_lin_vel.csv` [m/s], `body_ang_vel.csv` [rad/s] of all bodies in the world, breadth first, the root
# first; `metadata.txt` with the index of each body in Isaac Lab's order. Joint names and frames per second follow there; SONIC
# passes over them and takes 50.

METADATA, NAMES, RATE = "metadata.txt", "Joint names:", "Frames per second:"
JOINTS, PLACES, TURNS = "joint_pos.csv", "body_pos.csv", "body_quat.csv"


def write_sonic(motion: RobotMotion, path: Path) -> None:
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


def read_sonic(source: TrajectorySource) -> Columns:
    """Read the joints, and the root from the first body.

    Raises:
        TrajectoryError: a table is missing, of another length, or no table of numbers.
    """
    angles, places, turns = (_sonic_table(source.path / name) for name in (JOINTS, PLACES, TURNS))
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


def _sonic_table(path: Path) -> Floats:
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


SONIC = declared(
    "sonic",
    write_sonic,
    read_sonic,
    lambda source: all((source.path / name).is_file() for name in (JOINTS, PLACES, TURNS)),
)
