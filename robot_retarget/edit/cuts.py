"""Cut and mirror trajectories."""

import numpy as np
from scipy.spatial.transform import Rotation

from robot_retarget.base.arrays import Floats
from robot_retarget.base.errors import TrajectoryError, UsageError
from robot_retarget.robot.mirror import mirror_of
from robot_retarget.robot.model import Robot
from robot_retarget.robot.recognise import recognise
from robot_retarget.robot.timing import require_same_robot
from robot_retarget.scene.scene import reflected
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
    scene = None if trajectory.scene is None else trajectory.scene.at(kept)
    return trajectory.altered(qpos=trajectory.qpos[kept], source_time=trajectory.source_time[kept], scene=scene)


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
    qpos, left = trajectory.qpos.copy(), np.asarray(mirror.left)
    qpos[:, robot.qpos_index] = mirror.angles(trajectory.qpos[:, robot.qpos_index])
    plane = np.zeros(3), left
    if robot.floating:
        root = slice(robot.root_address, robot.root_address + 7)
        plane = _plane(trajectory.qpos[0, root], left)
        qpos[:, root] = reflected(trajectory.qpos[:, root], plane, left)
    scene = None if trajectory.scene is None else trajectory.scene.mirrored(plane)
    return trajectory.altered(qpos=qpos, scene=scene)


def _plane(root: Floats, left: Floats) -> tuple[Floats, Floats]:
    """Return a point (3,) and the normal (3,) of the vertical plane of a heading, that of a free joint (7,)."""
    across = Rotation.from_quat(np.array(root[3:]), scalar_first=True).apply(left) * [1, 1, 0]
    return root[:3], across / np.linalg.norm(across)
