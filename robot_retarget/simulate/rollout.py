"""Play a trajectory in MuJoCo and judge it: first as pure kinematics, then on position servos."""

from pathlib import Path
from typing import cast, get_args

from robot_retarget.errors import UsageError
from robot_retarget.robot.model import Robot
from robot_retarget.robot.timing import require_same_robot
from robot_retarget.simulate.contacts import replay_contacts
from robot_retarget.simulate.plant import Mode, build_plant
from robot_retarget.simulate.report import Report, Thresholds, build_report
from robot_retarget.simulate.stepping import roll_out
from robot_retarget.trajectory import Trajectory, fingerprint, load_trajectory


def simulate(
    trajectory: Trajectory | str | Path,
    robot: Robot,
    *,
    mode: str = "pinned",
    thresholds: Thresholds | None = None,
) -> Report:
    """Play a trajectory and judge it.

    It is replayed as it is (self-contacts, joint ranges, joint speeds) and then tracked by the model's position servos
    under gravity after SETTLE seconds in its first pose (tracking errors, torques, contacts).

    Args:
        trajectory: a trajectory, or the path of its file. The report's sha256 is that of the file (`fingerprint`).
        mode: `pinned` carries the root along its path in the air: the limbs feel gravity as the root turns, but not
            the root's accelerations. `free` sets the robot on a floor and leaves it alone.
        thresholds: what is still a pass.

    Raises:
        UsageError: an unknown mode, or `free` for a robot without a free root.
        TrajectoryError: the file cannot be read, or is of another robot.
        RobotError: the robot's MJCF cannot be prepared.
    """
    if mode not in get_args(Mode):
        raise UsageError(f"unknown mode {mode!r}; known: {', '.join(get_args(Mode))}")
    if mode == "free" and not robot.floating:
        raise UsageError(f"mode 'free' needs a robot with a free root; the root of {robot.name!r} is not free")
    played = trajectory if isinstance(trajectory, Trajectory) else load_trajectory(trajectory)
    require_same_robot(played, robot)
    plant = build_plant(robot, cast(Mode, mode))
    replayed = replay_contacts(robot, played.qpos)
    rollout = roll_out(plant, played, cast(Mode, mode))
    return build_report(played, plant, replayed, rollout, mode, fingerprint(trajectory), thresholds or Thresholds())
