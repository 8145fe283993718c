"""Cut and mirror trajectories."""

import numpy as np
from scipy.spatial.transform import Rotation

from robot_retarget.arrays import Floats
from robot_retarget.errors import TrajectoryError, UsageError
from robot_retarget.robot.mirror import mirror_of
from robot_retarget.robot.model import Robot
from robot_retarget.robot.recognise import recognise
from robot_retarget.robot.timing import require_same_robot
from robot_retarget.trajectory import Trajectory


def trimmed(trajectory: Trajectory, start: float = 0.0, stop: float | None = None) -> Trajectory:
    """Return the frames from `start` to `stop`, both inclusive, without goals [s].

    Raises:
        UsageError: no frame remains, or the times are not within the trajectory.
    """
    end = trajectory.duration if stop is None else stop
    if not 0 <= start <= end <= trajectory.duration + 1e-9:
        raise UsageError(f"{start:g} to {end:g} s is not within the trajectory's 0 to {trajectory.duration:.3g} s")
    first, last = round(start * trajectory.fps), round(end * trajectory.fps)
    kept = slice(first, last + 1)
    return trajectory.altered(qpos=trajectory.qpos[kept], source_time=trajectory.source_time[kept])


def mirrored(trajectory: Trajectory, robot: Robot) -> Trajectory:
    """Return the mirror image of a trajectory, in the vertical plane of the robot's first heading, without goals.

    Raises:
        TrajectoryError: the trajectory belongs to another robot, or the robot has a hinge without a counterpart.
        MatchError: the robot's left is unknown, because it is no humanoid.
    """
    require_same_robot(trajectory, robot)
    mirror = mirror_of(robot, np.cross([0.0, 0.0, 1.0], recognise(robot).forward))
    if not mirror.whole:
        lone = robot.joint_names[int(np.flatnonzero(mirror.partner < 0)[0])]
        raise TrajectoryError(f"{robot.name} cannot be mirrored: {lone} has no counterpart on the other side")
    qpos = trajectory.qpos.copy()
    qpos[:, robot.qpos_index] = mirror.angles(trajectory.qpos[:, robot.qpos_index])
    if robot.floating:
        root = slice(robot.root_address, robot.root_address + 7)
        qpos[:, root] = _reflected(trajectory.qpos[:, root], np.asarray(mirror.left))
    return trajectory.altered(qpos=qpos)


def _reflected(root: Floats, left: Floats) -> Floats:
    """Return free joints (T, 7) mirrored in the vertical plane of the first heading: R ↦ M R m, m in its own axes."""
    turns = Rotation.from_quat(root[:, 3:], scalar_first=True)
    across = turns[0].apply(left) * [1, 1, 0]
    across /= np.linalg.norm(across)
    plane, own = (np.eye(3) - 2 * np.outer(normal, normal) for normal in (across, left))
    places = root[0, :3] + (root[:, :3] - root[0, :3]) @ plane
    turned = Rotation.from_matrix(plane @ turns.as_matrix() @ own)
    return np.concatenate([places, turned.as_quat(scalar_first=True)], axis=1)
