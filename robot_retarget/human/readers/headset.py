"""Bodies of headsets: the 24 joints of XR_BD_body_tracking, which are those of SMPL, each with a flag whether it is tracked.

OpenXR's axes: x right, y up, z back. Ours: x' = −z, y' = −x, z' = y. Rotations are those of the joints in the world.
"""

import struct
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from robot_retarget.base.arrays import Bools, Floats
from robot_retarget.base.errors import MotionError
from robot_retarget.base.untrusted.rotations import LENGTHS
from robot_retarget.base.untrusted.tables import MAGIC, bag_messages
from robot_retarget.human.capture import Capture, FileHeader, Request
from robot_retarget.human.readers.smpl import NAMES, PARENTS, mean_skeleton
from robot_retarget.human.skeleton import Skeleton

JOINTS = len(NAMES)


class HeldBody:
    """Joints that are not tracked keep their pose in their parent: a limb is held, it does not fly away.

    x_j = x_p + Q (y_j − y_p) with the parent p, the body y of the frame before, and Q the turn of the parent since then. The
    first frame follows the mean body in T-pose.
    """

    def __init__(self) -> None:
        mean, _ = mean_skeleton(None)
        self.skeleton: Skeleton = Skeleton(NAMES, PARENTS, mean.offsets[:, [2, 0, 1]])  # x left, y up, z ahead
        self._places, self._turns = self.skeleton.rest(), np.tile([1.0, 0, 0, 0], (JOINTS, 1))

    def step(self, poses: Floats, tracked: Bools) -> tuple[Floats, Floats] | None:
        """Return positions (24, 3) [m] and rotations (24, 4) w x y z of a frame; None without its pelvis.

        Args:
            poses: (24, 7) x y z [m] and quaternion x y z w in OpenXR's axes.
            tracked: (24,) flags.
        """
        lengths = np.linalg.norm(poses[:, 3:], axis=1)
        seen = tracked & np.isfinite(poses).all(axis=1) & (lengths > LENGTHS[0]) & (lengths < LENGTHS[1])
        if not seen[0]:
            return None
        x, y, z, qx, qy, qz, qw = np.where(seen[:, None], poses, [0, 0, 0, 0, 0, 0, 1.0]).T
        places = np.stack([-z, -x, y], axis=1)
        turns = np.stack([qw, -qz, -qx, qy], axis=1) / np.where(seen, lengths, 1.0)[:, None]
        for joint in np.flatnonzero(~seen):
            parent = PARENTS[joint]
            since = _rotation(turns[parent]) * _rotation(self._turns[parent]).inv()
            places[joint] = places[parent] + since.apply(self._places[joint] - self._places[parent])
            turns[joint] = (since * _rotation(self._turns[joint])).as_quat(scalar_first=True)
        self._places, self._turns = places, turns
        return places, turns


def _rotation(turn: Floats) -> Rotation:
    return Rotation.from_quat(turn, scalar_first=True)


# Isaac Capture (NVIDIA's Isaac Teleop): a session recorded as `.mcap`, with messages `core.FullBodyPoseRecord` in FlatBuffers.
#
# A record holds `data` (empty while no body is tracked) with `joints`: 24 structs of 32 bytes, position x y z [m] and orientation
# x y z w in single precision, a byte `is_valid`, and padding. Times are those of the log.

SCHEMA = "core.FullBodyPoseRecord"
JOINT = np.dtype([("pose", "<f4", 7), ("tracked", "u1"), ("padding", "u1", 3)])
FIRST = 4
"""Offset of the first field in a table of offsets [bytes]; a field of `data` and `joints` alike."""
NANOSECOND = 1e-9
"""A nanosecond, the unit of the log [s]."""
PAUSED = 4.0
"""Most frames of a clip for each of its records [-]: a pause of three quarters of a session (1 − 1/4) is cut, not
held."""


def matches_format(header: FileHeader) -> bool:
    """Whether a file begins as an MCAP file does."""
    return header.head.startswith(MAGIC)


def read(path: Path, request: Request) -> Capture:
    """Read the body of every record; joints that are not tracked are held.

    Raises:
        MotionError: no record has a tracked pelvis, or a record is broken.
    """
    topics, bodies, body = set(), [], HeldBody()
    for schema, channel, message, content in bag_messages(path):
        topics.add(channel.topic)
        if schema is not None and schema.name == SCHEMA:
            rows = joints_of(content)
            held = None if rows is None else body.step(rows["pose"].astype(float), rows["tracked"] != 0)
            if held is not None and rows is not None:
                bodies.append((message.log_time * NANOSECOND, *held, rows["tracked"] == 0))
    if len(bodies) < 2:
        listed = ", ".join(sorted(topics)) or "nothing"
        raise MotionError(f"needs two records {SCHEMA} or more with a tracked pelvis; it holds {listed}", path)
    times, places, turns, lost = (np.array(part) for part in zip(*bodies, strict=True))
    fps, notes = request.rate(float(np.round(1 / np.median(np.diff(times)), 2)))
    if not (times[-1] - times[0]) * fps < PAUSED * len(times):
        pause = f"{float(np.diff(times).max()):.3g} s"
        raise MotionError(
            f"its records stop for up to {pause}: cut the session there, or say its rate with --fps", path
        )
    nearest = _nearest(times, fps)
    away = [
        f"{name} {100 * share:.0f} %"
        for name, share in zip(body.skeleton.names, lost.mean(axis=0), strict=True)
        if share
    ]
    if away:
        notes = (*notes, f"Joints that were not tracked are held: {', '.join(away)} of the frames.")
    return Capture(body.skeleton, places[nearest], turns[nearest], fps, str(path), notes, up="+z")


def joints_of(record: bytes) -> np.ndarray | None:
    """The joints (24,) of a record; None while no body was tracked.

    Raises:
        ValueError, struct.error: offsets leave the record.
    """
    data = _field(record, struct.unpack_from("<I", record)[0])
    at = None if data is None else _field(record, data + struct.unpack_from("<I", record, data)[0])
    return None if at is None else np.frombuffer(record, JOINT, JOINTS, at)


def _field(record: bytes, table: int) -> int | None:
    """Where the first field of a table stands; None if it is absent."""
    offsets = table - struct.unpack_from("<i", record, table)[0]
    if offsets < 0 or struct.unpack_from("<H", record, offsets)[0] <= FIRST:
        return None
    offset = struct.unpack_from("<H", record, offsets + FIRST)[0]
    return table + offset if offset else None


def _nearest(times: Floats, fps: float) -> np.ndarray:
    """The record nearest to each of the even times."""
    even = np.arange(times[0], times[-1] + 0.5 / fps, 1 / fps)
    after = np.clip(np.searchsorted(times, even), 1, len(times) - 1)
    return after - (even - times[after - 1] < times[after] - even)
