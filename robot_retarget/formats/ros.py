"""ROS 2: a bag (`mcap`) of joint states and transforms, and `JointTrajectory` messages as YAML."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from robot_retarget.base.arrays import Floats
from robot_retarget.base.errors import TrajectoryError, UsageError, install_line
from robot_retarget.base.untrusted.documents import read_text
from robot_retarget.base.untrusted.limits import BROKEN, one_line, require_tree
from robot_retarget.base.untrusted.tables import MAGIC, bag_messages
from robot_retarget.formats.bodies import central, robot_bodies
from robot_retarget.formats.columns import FIRST_LAST, Columns, array_in, holds
from robot_retarget.formats.robot_motion import RobotMotion
from robot_retarget.formats.source import TrajectorySource, declared
from robot_retarget.formats.tables import rate
from robot_retarget.robot.anatomy import LIMBS, joints_by_limb
from robot_retarget.robot.kinematics import body_frames
from robot_retarget.robot.recognise import recognise

# Definitions of the ROS 2 messages that a bag carries with it, as rosbag2 concatenates them.

_LINE = "=" * 80
_TIME = f"{_LINE}\nMSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
_HEADER = f"{_LINE}\nMSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n{_TIME}"
_VECTOR = f"{_LINE}\nMSG: geometry_msgs/Vector3\nfloat64 x\nfloat64 y\nfloat64 z\n"
_QUATERNION = f"{_LINE}\nMSG: geometry_msgs/Quaternion\nfloat64 x\nfloat64 y\nfloat64 z\nfloat64 w\n"
_TRANSFORM = (
    f"{_LINE}\nMSG: geometry_msgs/Transform\ngeometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation\n"
    f"{_VECTOR}{_QUATERNION}"
)

JOINT_STATE = (
    "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n" + _HEADER
)
TRANSFORMS = (
    "geometry_msgs/TransformStamped[] transforms\n"
    f"{_LINE}\nMSG: geometry_msgs/TransformStamped\nstd_msgs/Header header\nstring child_frame_id\n"
    f"geometry_msgs/Transform transform\n{_HEADER}{_TRANSFORM}"
)


WORLD = "world"
NANO = 1_000_000_000


def write_bag(motion: RobotMotion, path: Path) -> None:
    """Write the bag (extra `formats`)."""
    ros = _library()
    rates, transforms = central(motion.angles, motion.fps), _Transforms(motion)
    with path.open("wb") as stream:
        writer = ros.writer.Writer(stream)
        states = writer.register_msgdef("sensor_msgs/msg/JointState", JOINT_STATE)
        frames = writer.register_msgdef("tf2_msgs/msg/TFMessage", TRANSFORMS)
        for t in range(len(motion)):
            stamp = round(t / motion.fps * NANO)
            state = {
                "header": _header(stamp, ""),
                "name": list(motion.joints),
                "position": motion.angles[t].tolist(),
                "velocity": rates[t].tolist(),
                "effort": [],
            }
            writer.write_message("/joint_states", states, state, stamp, stamp, t)
            writer.write_message("/tf", frames, {"transforms": transforms.at(t, stamp)}, stamp, stamp, t)
        writer.finish()


class _Transforms:
    """Every body in its parent's frame over time."""

    def __init__(self, motion: RobotMotion):
        model = motion.robot.model
        self.bodies = robot_bodies(motion.robot)
        self.parents = model.body_parentid[self.bodies]
        self.names = [model.body(b).name for b in range(model.nbody)]
        positions, turns = body_frames(motion.robot, motion.qpos)
        undo = np.swapaxes(turns[:, self.parents], 2, 3)
        self.places = np.einsum("tbij,tbj->tbi", undo, positions[:, self.bodies] - positions[:, self.parents])
        local = (undo @ turns[:, self.bodies]).reshape(-1, 3, 3)
        self.turns = Rotation.from_matrix(local).as_quat().reshape(*self.places.shape[:2], 4)

    def at(self, frame: int, stamp: int) -> list[dict[str, Any]]:
        return [
            {
                "header": _header(stamp, self.names[parent] if parent else WORLD),
                "child_frame_id": self.names[body],
                "transform": {
                    "translation": dict(zip("xyz", self.places[frame, k].tolist(), strict=True)),
                    "rotation": dict(zip("xyzw", self.turns[frame, k].tolist(), strict=True)),
                },
            }
            for k, (body, parent) in enumerate(zip(self.bodies, self.parents, strict=True))
        ]


def _header(stamp: int, frame: str) -> dict[str, Any]:
    return {"stamp": {"sec": stamp // NANO, "nanosec": stamp % NANO}, "frame_id": frame}


def read_bag(source: TrajectorySource) -> Columns:
    """Read joint states, and the root from the transform of the robot's root in `world` if present.

    Raises:
        TrajectoryError: it is no bag, or has no joint states.
    """
    states, roots = _messages(source)
    if not states:
        raise TrajectoryError("no sensor_msgs/JointState in the bag")
    times, names = np.array([stamp for stamp, _ in states]) / NANO, tuple(states[0][1].name)
    if any(tuple(state.name) != names for _, state in states):
        raise TrajectoryError("joint states of several sets of joints")
    angles = np.array([state.position for _, state in states])
    if len(roots) != len(states):
        return Columns(angles, names, fps=rate(times))
    pose = np.array([[getattr(part, a) for part, axes in _parts(root) for a in axes] for root in roots])
    return Columns(angles, names, pose[:, :3], pose[:, 3:][:, FIRST_LAST], rate(times))


def _parts(transform: Any) -> tuple[tuple[Any, str], ...]:
    return (transform.translation, "xyz"), (transform.rotation, "xyzw")


def _messages(source: TrajectorySource) -> tuple[list[tuple[int, Any]], list[Any]]:
    """Stamped joint states, and the root's transforms."""
    root, states, roots = source.robot.model.body(source.robot.root_body).name, [], []
    for schema, _, message, content in bag_messages(source.path, [_library().decoder.DecoderFactory()]):
        if schema.name == "sensor_msgs/msg/JointState":
            states.append((message.log_time, content))
        elif schema.name == "tf2_msgs/msg/TFMessage":
            roots += [t.transform for t in content.transforms if t.child_frame_id == root]
    return states, roots


def claims_bag(source: TrajectorySource) -> bool:
    """Whether the file begins as a bag does."""
    if not source.path.is_file():
        return False
    with source.path.open("rb") as stream:
        return stream.read(len(MAGIC)) == MAGIC


def _library() -> Any:
    """Return the library, with its modules `decoder` and `writer`."""
    try:
        import mcap_ros2.decoder
        import mcap_ros2.writer
    except ImportError:
        raise UsageError(f"MCAP needs mcap: {install_line('formats')}") from None
    return mcap_ros2


MCAP = declared("mcap", write_bag, read_bag, claims_bag)


# ROS 2's `trajectory_msgs/JointTrajectory` as YAML: `ros-joint-trajectory`, one message, and `ros-limb-trajectories`, one for each limb.

# Format `ros-joint-trajectory`: a ROS 2 `trajectory_msgs/JointTrajectory` as YAML.
#
# `joint_names`, `points` with `positions` [rad], `velocities` [rad/s] and `time_from_start`. No root. Velocities by central
# differences, at rest at both ends as controllers of ros2_control ask for it.


def write_message(path: Path, joints: Sequence[str], angles: Floats, fps: float) -> None:
    """Write the angles (T, n) of some joints [rad] as a message (extra `formats`)."""
    yaml = _yaml()
    rates = central(angles, fps)
    rates[[0, -1]] = 0.0
    stamps = [round(frame / fps * NANO) for frame in range(len(angles))]
    message = {
        "header": _header(0, ""),
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


def read_message(text: str) -> Columns:
    """Read the text of a message.

    Raises:
        TrajectoryError: it is no YAML, or no JointTrajectory.
    """
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
    lambda motion, path: write_message(path, motion.joints, motion.angles, motion.fps),
    lambda source: read_message(source.text),
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
