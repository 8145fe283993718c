"""Pickled dictionaries: `gmr`, `mimickit`, `phc`, and the tensors of `protomotions`."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from robot_retarget.base.arrays import Floats
from robot_retarget.base.errors import TrajectoryError
from robot_retarget.base.untrusted.arrays import rate_of
from robot_retarget.base.untrusted.limits import lz4_packed
from robot_retarget.base.untrusted.pickles import dump_pickle, dump_torch
from robot_retarget.formats.bodies import (
    body_names,
    body_tracks,
    motor_tracks,
    onward_velocities,
    robot_bodies,
    velocities,
)
from robot_retarget.formats.columns import LAST_FIRST, ArrayKeys, Columns, array_in, holds, keyed
from robot_retarget.formats.robot_motion import RobotMotion
from robot_retarget.formats.source import TrajectorySource, declared, declared_by_keys
from robot_retarget.formats.tables import rate
from robot_retarget.robot.kinematics import body_frames
from robot_retarget.robot.recognise import recognise

# Format `gmr`: the pickled dictionary of GMR, which TWIST and TWIST2 train on.
#
# `fps`; `root_pos` (T, 3); `root_rot` (T, 4) **x y z w**; `dof_pos` (T, n) in the model's order; `local_body_pos` (T, B, 3) of
# all bodies in the root's frame and `link_body_list`, their names, which TWIST2 wants to be there. No joint names.


GMR_KEYS = ArrayKeys("root_pos", "root_rot", "dof_pos", order="xyzw")
PHC_KEYS = ArrayKeys("root_trans_offset", "root_rot", "dof", order="xyzw")
PROTOMOTIONS_KEYS = ArrayKeys("rigid_body_pos", "rigid_body_rot", "dof_pos", order="xyzw", bodies=True)


def write_gmr(motion: RobotMotion, path: Path) -> None:
    """Write the rate, the pose of the root, the joint angles, and the bodies' positions in the frame of the root."""
    bodies = robot_bodies(motion.robot)
    path.write_bytes(
        dump_pickle(
            {
                "fps": int(motion.fps) if motion.fps == int(motion.fps) else motion.fps,
                "root_pos": motion.position,
                "root_rot": motion.quaternion[:, LAST_FIRST],
                "dof_pos": motion.angles,
                "local_body_pos": _in_root(motion, bodies),
                "link_body_list": list(body_names(motion.robot, bodies)),
            }
        )
    )


def _in_root(motion: RobotMotion, bodies: np.ndarray) -> Floats:
    """(T, B, 3) positions of bodies in the root's frame [m]."""
    places = body_frames(motion.robot, motion.qpos)[0][:, bodies] - motion.position[:, None]
    undo = Rotation.from_quat(motion.quaternion, scalar_first=True).inv().as_matrix()
    return np.einsum("tij,tbj->tbi", undo, places)


GMR = declared_by_keys("gmr", write_gmr, "pickled", GMR_KEYS)


# Format `mimickit`: MimicKit's motion pickle.
#
# `loop_mode` 0 (clamp) or 1 (wrap), `fps`, `frames`: T lists of root x y z [m], root rotation vector [rad], joints [rad] in the
# model's order.

CLAMP = 0
"""A motion ends where it ends."""


def write_mimickit(motion: RobotMotion, path: Path) -> None:
    """Write the pickle, as lists of numbers."""
    turns = Rotation.from_quat(motion.quaternion, scalar_first=True).as_rotvec()
    frames = np.column_stack([motion.position, turns, motion.angles])
    path.write_bytes(dump_pickle({"loop_mode": CLAMP, "fps": motion.fps, "frames": frames.tolist()}))


def read_mimickit(source: TrajectorySource) -> Columns:
    """Read the pickle, restricted to data."""
    frames = array_in(source.pickled, "frames", (None, None))
    quaternion = Rotation.from_rotvec(frames[:, 3:6]).as_quat(scalar_first=True)
    return Columns(frames[:, 6:], source.names(), frames[:, :3], quaternion, rate_of(source.pickled))


MIMICKIT = declared(
    "mimickit", write_mimickit, read_mimickit, lambda source: holds(source.pickled, "loop_mode", "fps", "frames")
)


# Format `phc`: the joblib dictionary of PHC for humanoids, which ASAP and PBHC read too.
#
# {clip: {`root_trans_offset` (T, 3) [m], `root_rot` (T, 4) **x y z w**, `dof` (T, n) [rad], `pose_aa` (T, 1 + n + 3, 3), `fps`,
# `contact_mask` (T, 2) of left and right foot, which PBHC reads}},
# all in single precision, as their torch code wants them. `pose_aa` holds rotation vectors: the root's, every joint's angle
# times its axis, and three rows of zeros for bodies that these projects add to a G1. The 23 joints of their G1 are named by
# `--joints`.

ADDED = 3
"""Rows of zeros behind the joints."""


def write_phc(motion: RobotMotion, path: Path) -> None:
    """Write the dictionary of one clip, called as the motion's source."""
    clip = {
        "root_trans_offset": motion.position.astype(np.float32),
        "pose_aa": _rotation_vectors(motion).astype(np.float32),
        "dof": motion.angles.astype(np.float32),
        "root_rot": motion.quaternion[:, LAST_FIRST].astype(np.float32),
        "fps": int(motion.fps) if motion.fps == int(motion.fps) else motion.fps,
        "contact_mask": np.array(list(motion.foot_contacts.values()), dtype=np.float32).reshape(-1, len(motion)).T,
    }
    path.write_bytes(dump_pickle({Path(motion.trajectory.source).stem or "motion": clip}))


def _rotation_vectors(motion: RobotMotion) -> Floats:
    robot = motion.robot
    axes = robot.model.jnt_axis[[robot.joint_ids[robot.joint_names.index(name)] for name in motion.joints]]
    root = Rotation.from_quat(motion.quaternion, scalar_first=True).as_rotvec()[:, None]
    return np.concatenate([root, motion.angles[..., None] * axes, np.zeros((len(motion), ADDED, 3))], axis=1)


def read_phc(source: TrajectorySource) -> Columns:
    """Read the only clip.

    Raises:
        TrajectoryError: there are more, which are named.
    """
    clips = source.pickled
    if not isinstance(clips, dict) or len(clips) != 1:
        raise TrajectoryError(f"one clip a file is read; it has {', '.join(map(str, clips or ())) or 'none'}")
    ((name, clip),) = clips.items()
    return replace(keyed(clip, PHC_KEYS, source.names()), source=str(name))


def claims_phc(source: TrajectorySource) -> bool:
    """Whether every value of a dictionary is a clip."""
    clips = source.pickled
    return isinstance(clips, dict) and bool(clips) and all(holds(clip, *PHC_KEYS.required) for clip in clips.values())


PHC = declared("phc", write_phc, read_phc, claims_phc)


# Format `protomotions`: a `.motion` of ProtoMotions 3, a dict of tensors that `torch.load` reads.
#
# `fps`; `dof_pos`, `dof_vel` (T, n) [rad, rad/s]; `rigid_body_pos`, `rigid_body_vel`, `rigid_body_ang_vel` (T, B, 3) and
# `rigid_body_rot` (T, B, 4) x y z w of all bodies' frames in the world, the root first; `rigid_body_contacts` (T, B), of the bodies of the soles.
# Joints and bodies in the order of the MJCF. Single precision.


def write_protomotions(motion: RobotMotion, path: Path) -> None:
    """Write the file."""
    qvel = velocities(motion)
    tracks, bodies = body_tracks(motion, qvel), robot_bodies(motion.robot)
    tensors: dict[str, Floats] = {
        "dof_pos": motion.angles,
        "dof_vel": qvel[:, motion.robot.dof_index],
        "rigid_body_pos": tracks.positions[:, bodies],
        "rigid_body_rot": tracks.quaternions[:, bodies][..., LAST_FIRST],
        "rigid_body_vel": tracks.linear[:, bodies],
        "rigid_body_ang_vel": tracks.angular[:, bodies],
    }
    contacts = np.zeros((len(motion), len(bodies)), dtype=bool)
    for foot, stands in motion.foot_contacts.items():
        contacts[:, np.isin(bodies, recognise(motion.robot).treads[foot[0]].bodies)] |= stands[:, None]
    singles = {name: values.astype("f4") for name, values in tensors.items()}
    dump_torch(path, {"fps": motion.fps, **singles, "rigid_body_contacts": contacts})


PROTOMOTIONS = declared_by_keys("protomotions", write_protomotions, "pickled", PROTOMOTIONS_KEYS)


# Format `keyframe-kit`: the `.lz4` of robot-keyframe-kit and ToddlerBot's motions.
#
# joblib, lz4-packed: `time` (T,), `qpos` (T, nq), `motor_vel`, `joint_vel`, poses and velocities of all bodies in the world
# (`is_robot_relative_frame` False), no `action`; `keyframes` [{name, motor_pos, joint_pos, qpos}] twice a second and
# `timed_sequence` [(name, s)], which its editor opens. Velocities are those to the next frame; `body_lin_vel` and
# `body_ang_vel` are the halves of MuJoCo's `cvel`, as the kit stores them.

EVERY = 0.5
"""Between keyframes for the editor [s]: as far apart as hand-made ones."""


def write_keyframe_kit(motion: RobotMotion, path: Path) -> None:
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


def read_keyframe_kit(source: TrajectorySource) -> Columns:
    """Read qpos over time.

    Raises:
        TrajectoryError: the file has none, as before its motion was played.
    """
    table = source.pickled
    if not holds(table, "qpos", "time") or not np.size(table["qpos"]):
        raise TrajectoryError("no qpos over time: play the motion in the editor and save it")
    qpos = array_in(table, "qpos", (None, None))
    return Columns(qpos=qpos, fps=rate(array_in(table, "time", (len(qpos),))))


KEYFRAME_KIT = declared(
    "keyframe-kit",
    write_keyframe_kit,
    read_keyframe_kit,
    lambda source: holds(source.pickled, "keyframes", "timed_sequence", "time", "qpos"),
)
