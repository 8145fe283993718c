"""Format `bvh`: the robot's own skeleton as BVH, a joint a body, for animation programs.

Centimetres, y up, root position and Z X Y angles in degrees [six decimals]; every body's turn in its parent, rest pose and
hinges together. Read back, a turn is undone about the axes of the body's hinges.
"""

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from robot_retarget.base.arrays import Floats
from robot_retarget.base.errors import MotionError, TrajectoryError
from robot_retarget.formats.bodies import body_names, robot_bodies
from robot_retarget.formats.columns import Columns
from robot_retarget.formats.robot_motion import RobotMotion
from robot_retarget.formats.source import TrajectorySource, declared
from robot_retarget.formats.tables import CENTIMETRES
from robot_retarget.human.motion import Motion
from robot_retarget.human.readers.bvh import read_bvh, write_bvh
from robot_retarget.human.skeleton import Skeleton
from robot_retarget.robot.kinematics import body_frames
from robot_retarget.robot.model import Robot

UPRIGHT = Rotation.from_matrix([[0, 0, 1], [1, 0, 0], [0, 1, 0]])
"""y up to z up: x = z', y = x', z = y'."""


def write(motion: RobotMotion, path: Path) -> None:
    """Write the skeleton and its motion."""
    model, bodies = motion.robot.model, robot_bodies(motion.robot)
    rank = {int(body): k for k, body in enumerate(bodies)}
    parents = np.array([rank.get(int(model.body_parentid[body]), -1) for body in bodies])
    positions, turns = (frames[:, bodies] for frames in body_frames(motion.robot, motion.qpos))
    quaternions = Rotation.from_matrix(turns.reshape(-1, 3, 3)).as_quat(scalar_first=True)
    skeleton = Skeleton(body_names(motion.robot, bodies), parents, model.body_pos[bodies])
    write_bvh(Motion(skeleton, positions, quaternions.reshape(*positions.shape[:2], 4), motion.fps), path)


def read(source: TrajectorySource) -> Columns:
    """Read the motion back.

    Raises:
        TrajectoryError: it is no BVH, has no rotations, or lacks a body of the robot.
    """
    try:
        capture = read_bvh(source.path)
    except MotionError as error:
        raise TrajectoryError(str(error)) from error
    robot, names = source.robot, capture.skeleton.names
    wanted = body_names(robot, robot_bodies(robot))
    missing = [name for name in wanted if name not in names]
    if missing or capture.rotations is None:
        what = f"the robot's body {missing[0]!r}" if missing else "rotations"
        raise TrajectoryError(f"{what} is not in the skeleton; a human's motion is retargeted, not imported")
    turns = {name: _upright(capture.rotations[:, names.index(name)]) for name in wanted}
    root = names.index(wanted[0])
    return Columns(
        _hinge_angles(robot, turns),
        robot.joint_names,
        UPRIGHT.apply(capture.positions[:, root]) / CENTIMETRES,
        turns[wanted[0]].as_quat(scalar_first=True),
        capture.fps,
    )


def _upright(quaternions: Floats) -> Rotation:
    return UPRIGHT * Rotation.from_quat(quaternions, scalar_first=True) * UPRIGHT.inv()


def _hinge_angles(robot: Robot, turns: dict[str, Rotation]) -> Floats:
    """(T, n) of the hinges [rad], without jumps; whole turns, which a skeleton does not hold, begin in the middle of the range."""
    model = robot.model
    found = np.zeros((len(next(iter(turns.values()))), len(robot.joint_names)))
    for body in np.unique(model.jnt_bodyid[robot.joint_ids]):
        own = [k for k, joint in enumerate(robot.joint_ids) if model.jnt_bodyid[joint] == body]
        parent = turns[model.body(int(model.body_parentid[body])).name]
        rest = Rotation.from_quat(model.body_quat[body], scalar_first=True)
        local = rest.inv() * parent.inv() * turns[model.body(int(body)).name]
        joints = robot.joint_ids[own]
        found[:, own] = _about(local, model.jnt_axis[joints]) + model.qpos0[model.jnt_qposadr[joints]]
    middle = (robot.lower + robot.upper) / 2
    found[0] -= 2 * np.pi * np.round((found[0] - middle) / (2 * np.pi))
    return np.unwrap(found, axis=0)


def _about(turns: Rotation, axes: Floats) -> Floats:
    """(T, k) angles about k axes, one after the other in the body's frame.

    Raises:
        TrajectoryError: neighbouring axes of several hinges on one body are not at right angles.
    """
    if len(axes) == 1:
        quaternions = turns.as_quat(scalar_first=True)
        return 2 * np.arctan2(quaternions[:, 1:] @ axes[0], quaternions[:, 0])[:, None]
    whole = axes if len(axes) == 3 else np.vstack([axes, np.cross(*axes)])
    try:
        return turns.as_davenport(whole, "intrinsic")[:, : len(axes)]
    except ValueError as error:
        raise TrajectoryError(f"hinges that share a body at no right angles: {error}") from error


def claims(source: TrajectorySource) -> bool:
    """Whether the root of a BVH is a body of the robot."""
    start = source.text[:4096].split()
    return start[:2] == ["HIERARCHY", "ROOT"] and start[2] in body_names(source.robot, robot_bodies(source.robot))


FORMAT = declared("bvh", write, read, claims)
