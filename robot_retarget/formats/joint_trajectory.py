"""ROS 2's `trajectory_msgs/JointTrajectory` as YAML: `ros-joint-trajectory`, one message, and `ros-limb-trajectories`, one for each limb."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from robot_retarget.base.arrays import Floats
from robot_retarget.base.errors import TrajectoryError, UsageError, install_line
from robot_retarget.base.untrusted.documents import read_text
from robot_retarget.base.untrusted.limits import BROKEN, one_line, require_tree
from robot_retarget.formats.bodies import central
from robot_retarget.formats.columns import Columns, array_in, holds
from robot_retarget.formats.named_csv import rate
from robot_retarget.formats.robot_motion import RobotMotion
from robot_retarget.formats.source import TrajectorySource, declared
from robot_retarget.robot.anatomy import LIMBS, joints_by_limb
from robot_retarget.robot.recognise import recognise

# Format `ros-joint-trajectory`: a ROS 2 `trajectory_msgs/JointTrajectory` as YAML.
#
# `joint_names`, `points` with `positions` [rad], `velocities` [rad/s] and `time_from_start`. No root. Velocities by central
# differences, at rest at both ends as controllers of ros2_control ask for it.

NANO = 10**9


def write_joint_trajectory(motion: RobotMotion, path: Path) -> None:
    """Write the message (extra `formats`)."""
    write_message(path, motion.joints, motion.angles, motion.fps)


def write_message(path: Path, joints: Sequence[str], angles: Floats, fps: float) -> None:
    """Write the angles (T, n) of some joints [rad] as a message."""
    yaml = _yaml()
    rates = central(angles, fps)
    rates[[0, -1]] = 0.0
    stamps = [round(frame / fps * NANO) for frame in range(len(angles))]
    message = {
        "header": {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": ""},
        "joint_names": list(joints),
        "points": [
            {
                "positions": row.tolist(),
                "velocities": speeds.tolist(),
                "time_from_start": {"sec": stamp // NANO, "nanosec": stamp % NANO},
            }
            for row, speeds, stamp in zip(angles, rates, stamps, strict=True)
        ],
    }
    dumper = getattr(yaml, "CSafeDumper", yaml.SafeDumper)
    with path.open("w", encoding="utf-8") as stream:
        yaml.dump(message, stream, dumper, default_flow_style=None, sort_keys=False, width=10**6)


def read_joint_trajectory(source: TrajectorySource) -> Columns:
    """Read the message.

    Raises:
        TrajectoryError: it is no YAML, or no JointTrajectory.
    """
    return read_message(source.text)


def read_message(text: str) -> Columns:
    """Read the text of a message; as `read`."""
    yaml = _yaml()
    try:
        message: Any = yaml.load(text, getattr(yaml, "CSafeLoader", yaml.SafeLoader))
        require_tree(message, len(text))
        points = [(point["positions"], point["time_from_start"]) for point in message["points"]]
        times = [float(stamp["sec"]) + float(stamp.get("nanosec", 0)) / NANO for _, stamp in points]
    except (yaml.YAMLError, *BROKEN) as error:
        raise TrajectoryError(f"no JointTrajectory: {one_line(str(error))}") from error
    if not points or not holds(message, "joint_names"):
        raise TrajectoryError("no JointTrajectory with joint_names and points")
    angles = array_in({"positions": [angles for angles, _ in points]}, "positions", (len(points), None))
    return Columns(angles, tuple(map(str, message["joint_names"])), fps=rate(np.array(times)))


def _yaml() -> Any:
    try:
        import yaml
    except ImportError:
        raise UsageError(f"YAML needs PyYAML: {install_line('formats')}") from None
    return yaml


JOINT_TRAJECTORY = declared(
    "ros-joint-trajectory",
    write_joint_trajectory,
    read_joint_trajectory,
    lambda source: "joint_names:" in source.text and "time_from_start:" in source.text,
)


# Format `ros-limb-trajectories`: a folder with a ROS 2 JointTrajectory for each limb, for robots with a controller per limb.
#
# `left_arm.yaml`, `right_arm.yaml`, `left_leg.yaml`, `right_leg.yaml`, `head.yaml` and `torso.yaml`, those that the robot has, each
# as in `ros-joint-trajectory`. All have the same times. Fingers are joints of their arm.

FILES = tuple(f"{limb}.yaml" for limb in (*LIMBS, "torso"))


def write_limb_trajectories(motion: RobotMotion, path: Path) -> None:
    """Fill the folder (extra `formats`)."""
    for limb, joints in joints_by_limb(motion.robot, recognise(motion.robot)).items():
        columns = [motion.joints.index(joint) for joint in joints]
        write_message(path / f"{limb}.yaml", joints, motion.angles[:, columns], motion.fps)


def read_limb_trajectories(source: TrajectorySource) -> Columns:
    """Read the messages of all limbs.

    Raises:
        TrajectoryError: one is no JointTrajectory, or they have not the same times.
    """
    files = [source.path / name for name in FILES if (source.path / name).is_file()]
    limbs = [read_message(read_text(file, TrajectoryError)) for file in files]
    angles = [limb.angles for limb in limbs if limb.angles is not None]
    if len({(len(table), limb.fps) for table, limb in zip(angles, limbs, strict=True)}) != 1:
        raise TrajectoryError("the limbs have other numbers of points or other times")
    names = tuple(name for limb in limbs for name in limb.names or ())
    return Columns(np.concatenate(angles, axis=1), names, fps=limbs[0].fps)


LIMB_TRAJECTORIES = declared(
    "ros-limb-trajectories",
    write_limb_trajectories,
    read_limb_trajectories,
    lambda source: any((source.path / name).is_file() for name in FILES),
)
