"""Definitions of the ROS 2 messages that a bag carries with it, as rosbag2 concatenates them."""

from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from robot_retarget.base.errors import TrajectoryError, UsageError, install_line
from robot_retarget.base.untrusted.tables import MAGIC, bag_messages
from robot_retarget.formats.bodies import central, robot_bodies
from robot_retarget.formats.columns import FIRST_LAST, Columns
from robot_retarget.formats.named_csv import rate
from robot_retarget.formats.robot_motion import RobotMotion
from robot_retarget.formats.source import TrajectorySource, declared
from robot_retarget.robot.kinematics import body_frames

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
NANO = 10**9


def write(motion: RobotMotion, path: Path) -> None:
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


def read(source: TrajectorySource) -> Columns:
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


def claims(source: TrajectorySource) -> bool:
    """Whether the file begins as a bag does."""
    if not source.path.is_file():
        return False
    with source.path.open("rb") as stream:
        return stream.read(len(MAGIC)) == MAGIC


class _Ros:
    """The modules of the library."""

    def __init__(self) -> None:
        import mcap_ros2.decoder
        import mcap_ros2.writer

        self.decoder: Any = mcap_ros2.decoder
        self.writer: Any = mcap_ros2.writer


def _library() -> _Ros:
    try:
        return _Ros()
    except ImportError:
        raise UsageError(f"MCAP needs mcap: {install_line('formats')}") from None


FORMAT = declared("mcap", write, read, claims)
