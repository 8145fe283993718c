"""Format `keyframe-kit`: the `.lz4` of robot-keyframe-kit and ToddlerBot's motions.

joblib, lz4-packed: `time` (T,), `qpos` (T, nq), `motor_vel`, `joint_vel`, poses and velocities of all bodies in the world
(`is_robot_relative_frame` False), no `action`; `keyframes` [{name, motor_pos, joint_pos, qpos}] twice a second and
`timed_sequence` [(name, s)], which its editor opens. Velocities are those to the next frame; `body_lin_vel` and
`body_ang_vel` are the halves of MuJoCo's `cvel`, as the kit stores them.
"""

from pathlib import Path
from typing import Any

import numpy as np

from robot_retarget.base.errors import TrajectoryError
from robot_retarget.base.untrusted.limits import lz4_packed
from robot_retarget.base.untrusted.pickles import dump_pickle
from robot_retarget.formats.bodies import body_tracks, motor_tracks, onward_velocities
from robot_retarget.formats.columns import Columns, array_in, holds
from robot_retarget.formats.named_csv import rate
from robot_retarget.formats.robot_motion import RobotMotion
from robot_retarget.formats.source import TrajectorySource, declared

EVERY = 0.5
"""Between keyframes for the editor [s]: as far apart as hand-made ones."""


def write(motion: RobotMotion, path: Path) -> None:
    """Write the file (extra `formats`)."""
    qvel, times = onward_velocities(motion), np.arange(len(motion)) / motion.fps
    tracks, (motors, motor_rates) = body_tracks(motion, qvel), motor_tracks(motion, qvel)
    frames = np.unique(np.append(np.arange(0, len(motion), max(1, round(EVERY * motion.fps))), len(motion) - 1))
    single = np.float32
    table = {
        "time": times,
        "qpos": motion.qpos,
        "motor_vel": motor_rates.astype(single),
        "joint_vel": qvel[:, motion.robot.dof_index].astype(single),
        "body_pos": tracks.positions.astype(single),
        "body_quat": tracks.quaternions.astype(single),
        "body_lin_vel": tracks.spatial[..., 3:].astype(single),
        "body_ang_vel": tracks.spatial[..., :3].astype(single),
        "site_pos": np.zeros((len(motion), 0), single),
        "site_quat": np.zeros((len(motion), 0), single),
        "action": None,
        "keyframes": [_keyframe(motion, motors, int(frame)) for frame in frames],
        "timed_sequence": [(_called(int(frame)), float(times[frame])) for frame in frames],
        "is_robot_relative_frame": False,
        "motion_name": Path(motion.trajectory.source).stem or "motion",
        "joint_names": list(motion.joints),
    }
    path.write_bytes(lz4_packed(dump_pickle(table)))


def _keyframe(motion: RobotMotion, motors: np.ndarray, frame: int) -> dict[str, Any]:
    single = np.float32
    return {
        "name": _called(frame),
        "motor_pos": motors[frame].astype(single),
        "joint_pos": motion.angles[frame].astype(single),
        "qpos": motion.qpos[frame].astype(single),
    }


def _called(frame: int) -> str:
    return f"frame_{frame}"


def read(source: TrajectorySource) -> Columns:
    """Read qpos over time.

    Raises:
        TrajectoryError: the file has none, as before its motion was played.
    """
    table = source.pickled
    if not holds(table, "qpos", "time") or not np.size(table["qpos"]):
        raise TrajectoryError("no qpos over time: play the motion in the editor and save it")
    qpos = array_in(table, "qpos", (None, None))
    return Columns(qpos=qpos, fps=rate(array_in(table, "time", (len(qpos),))))


FORMAT = declared(
    "keyframe-kit", write, read, lambda source: holds(source.pickled, "keyframes", "timed_sequence", "time", "qpos")
)
