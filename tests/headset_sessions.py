"""Sessions of headsets, made from a motion: what the SDKs hand over and what Isaac Capture records."""

import importlib.util
import struct
from itertools import pairwise
from pathlib import Path

import numpy as np
from mcap.writer import CompressionType, Writer

from robot_retarget.human.motion import Motion
from robot_retarget.human.read import read_motion


def performer(folder: Path, seconds: float = 3.0, fps: float = 60.0) -> Motion:
    """The 24 joints of SMPL, walking on the spot with swinging arms."""
    t = np.arange(round(seconds * fps)) / fps
    poses = np.zeros((len(t), 24, 3))
    swing = 0.6 * np.sin(2 * np.pi * t)
    poses[:, 1, 0], poses[:, 2, 0] = -swing, swing
    poses[:, 4, 0], poses[:, 5, 0] = np.maximum(swing, 0), np.maximum(-swing, 0)
    poses[:, 16, 2], poses[:, 17, 2] = -1.2, 1.2
    poses[:, 18, 1], poses[:, 19, 1] = -0.4 + 0.3 * swing, 0.4 + 0.3 * swing
    np.savez(folder / "smpl.npz", poses=poses.reshape(len(t), -1), trans=np.zeros((len(t), 3)), mocap_framerate=fps)
    return read_motion(folder / "smpl.npz")


def poses_of(motion: Motion) -> np.ndarray:
    """(T, 24, 7) x y z and quaternion x y z w in OpenXR's axes: x right, y up, z back."""
    assert motion.rotations is not None
    (x, y, z), (w, i, j, k) = np.moveaxis(motion.positions, 2, 0), np.moveaxis(motion.rotations, 2, 0)
    return np.stack([-y, z, -x, -j, k, -i, w], axis=2)


def record(poses: np.ndarray | None, tracked: np.ndarray | None = None) -> bytes:
    """`core.FullBodyPoseRecord` as FlatBuffers lays it out: root, its fields (data, timestamp), the body, its field (joints)."""
    if poses is None:
        return struct.pack("<IHHHHi", 12, 6, 4, 0, 0, 8)
    joints = np.zeros(24, np.dtype([("pose", "<f4", 7), ("tracked", "u1"), ("padding", "u1", 3)]))
    joints["pose"], joints["tracked"] = poses, 1 if tracked is None else tracked
    root = struct.pack("<IHHHHiI", 12, 6, 8, 4, 0, 8, 12)
    body = struct.pack("<HHHH", 8, 772, 4, 0)
    return root + body + struct.pack("<i", 8) + joints.tobytes()


def isaac_session(
    path: Path, records: list[bytes], fps: float = 60.0, topic: str = "full_body/full_body", schema: bytes = b""
) -> Path:
    """A session as Isaac Capture records it."""
    with path.open("wb") as stream:
        writer = Writer(stream, compression=CompressionType.NONE)
        writer.start()
        kind = writer.register_schema("core.FullBodyPoseRecord", "flatbuffer", schema)
        channel = writer.register_channel(topic, "flatbuffer", kind)
        for k, data in enumerate(records):
            stamp = 10**9 + round(k / fps * 1e9)
            writer.add_message(channel, stamp, data, stamp, k)
        writer.finish()
    return path


def their_schema() -> bytes:
    """The binary schema of a body in their library, which a session carries: from its size to the next schema."""
    library = importlib.util.find_spec("isaacteleop.deviceio_session._deviceio_session")
    assert library is not None and library.origin is not None
    schemas = Path(library.origin).read_bytes().split(b"BFBS")
    found = next((a, b) for a, b in pairwise(schemas) if b"core.FullBodyPoseRecord" in b and b"core.BodyJoints" in b)
    return found[0][-4:] + b"BFBS" + found[1][:-4]
