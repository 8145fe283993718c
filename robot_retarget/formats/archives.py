"""Archives of learning libraries: `core`, `isaaclab-amp`, `locomujoco`, `protomotions-pyroki`; and `native`, the trajectory file of this package."""

import hashlib
from pathlib import Path

import numpy as np

from robot_retarget.base.arrays import intervals
from robot_retarget.base.errors import TrajectoryError
from robot_retarget.base.untrusted.arrays import save_npz, shaped
from robot_retarget.formats.bodies import body_names, body_tracks, robot_bodies, site_tracks, velocities
from robot_retarget.formats.columns import ArrayKeys, Columns
from robot_retarget.formats.robot_motion import RobotMotion
from robot_retarget.formats.source import TrajectorySource, declared, declared_by_keys
from robot_retarget.robot.model import FREE
from robot_retarget.robot.timing import require_same_robot
from robot_retarget.trajectory import KEYS as NATIVE_KEYS
from robot_retarget.trajectory import Trajectory, load_trajectory

# Format `core`: CoRe's `core-robot-motion-v1`.
#
# `qpos` (T, nq): root x y z, w x y z, then the joints that `joint_names` lists; `timestamps_s` (T,), `fps`; contacts of feet
# and hands, the latter marked as not available; sha256 of the model and of the motion. No pickles.

TITLE = "core-robot-motion-v1"
LAYOUT = "root_xyz_quat_wxyz_then_model_joint_qpos"
ROOT_NAMES = ("root_x", "root_y", "root_z", "root_quat_w", "root_quat_x", "root_quat_y", "root_quat_z")
CONTACTS = ("left_foot", "right_foot", "left_hand", "right_hand")


def write_core(motion: RobotMotion, path: Path) -> None:
    """Write the archive."""
    feet = motion.foot_contacts
    labels = np.stack([feet.get(name, np.zeros(len(motion), bool)) for name in CONTACTS], axis=1)
    segments = {name: np.array(intervals(labels[:, k]), np.int64).reshape(-1, 2) for k, name in enumerate(CONTACTS[:2])}
    frames, model = len(motion), hashlib.sha256(motion.robot.path.read_bytes()).hexdigest()
    save_npz(
        path,
        schema_version=np.int32(1),
        format=TITLE,
        core_version="robot-retarget",
        robot_id=motion.robot.name,
        model_sha256=model,
        scene_sha256=model,
        source_motion_sha256=hashlib.sha256(motion.qpos.tobytes()).hexdigest(),
        fps=motion.fps,
        timestamps_s=np.arange(frames) / motion.fps,
        qpos=motion.qpos,
        qpos_layout=LAYOUT,
        root_qpos_names=np.array(ROOT_NAMES),
        joint_names=np.array(motion.joints),
        contact_label_names=np.array(CONTACTS),
        contact_labels=labels,
        contact_confidence=np.tile([float(name in feet) for name in CONTACTS], (frames, 1)),
        contact_availability=np.array([name in feet for name in CONTACTS]),
        flight_labels=motion.contacts.flying,
        left_contact_segments=segments["left_foot"],
        right_contact_segments=segments["right_foot"],
        contact_source="kinematics" if feet else "unspecified",
        hand_contact_source="unspecified",
    )


def read_core(source: TrajectorySource) -> Columns:
    """Read the archive.

    Raises:
        TrajectoryError: another layout of qpos than that of version 1, or a missing array.
    """
    layout, names = str(source.array("qpos_layout")), source.names()
    if layout != LAYOUT or names is None:
        raise TrajectoryError(f"qpos_layout is {layout!r}, this reader knows {LAYOUT!r} with joint_names")
    qpos = shaped(source.array("qpos"), (None, 7 + len(names)), "qpos")
    return Columns(qpos[:, 7:], names, qpos[:, :3], qpos[:, 3:7], source.rate)


CORE = declared("core", write_core, read_core, lambda source: str(source.arrays.get("format")) == TITLE)


# Format `isaaclab-amp`: the archive of Isaac Lab's humanoid AMP, joints and bodies by name.
#
# `fps`, `dof_names` (n,), `body_names` (B,), `dof_positions`, `dof_velocities` (T, n) [rad, rad/s], `body_positions` (T, B, 3)
# [m], `body_rotations` (T, B, 4) w x y z, `body_linear_velocities` (T, B, 3) [m/s] and `body_angular_velocities` (T, B, 3)
# [rad/s] of the bodies' frames in the world. The root is the first body. Its loader makes single precision of them.

AMP_KEYS = ArrayKeys("body_positions", "body_rotations", "dof_positions", bodies=True)


def write_isaaclab_amp(motion: RobotMotion, path: Path) -> None:
    """Write the archive."""
    robot, qvel = motion.robot, velocities(motion)
    tracks, bodies = body_tracks(motion, qvel), robot_bodies(robot)
    save_npz(
        path,
        fps=np.array(motion.fps),
        dof_names=np.array(robot.joint_names),
        body_names=np.array(body_names(robot, bodies)),
        dof_positions=motion.qpos[:, robot.qpos_index],
        dof_velocities=qvel[:, robot.dof_index],
        body_positions=tracks.positions[:, bodies],
        body_rotations=tracks.quaternions[:, bodies],
        body_linear_velocities=tracks.linear[:, bodies],
        body_angular_velocities=tracks.angular[:, bodies],
    )


ISAACLAB_AMP = declared_by_keys("isaaclab-amp", write_isaaclab_amp, "arrays", AMP_KEYS, "dof_names", "body_names")


# Format `locomujoco`: LocoMuJoCo's `Trajectory`.
#
# `qpos` (T, nq), `qvel` (T, nv), body and site poses in MuJoCo's order, w x y z, `split_points` [0, T]; `joint_names` with
# the root's, `frequency`; and the part of the model that its loader wants. A key it does not know is an error there, so the
# file holds only these. qvel by central differences over two frames.

MODEL_FIELDS = (
    *(f"body_{field}" for field in ("rootid", "weldid", "mocapid", "pos", "quat", "ipos", "iquat")),
    *(f"site_{field}" for field in ("bodyid", "pos", "quat")),
)
COORDINATES = {int(FREE): 7, 1: 4}
"""How many coordinates a joint of a kind has; slides and hinges one."""


def write_locomujoco(motion: RobotMotion, path: Path) -> None:
    """Write the archive."""
    model, qvel = motion.robot.model, velocities(motion)
    tracks, (places, turns) = body_tracks(motion, qvel), site_tracks(motion)
    save_npz(
        path,
        qpos=motion.qpos,
        qvel=qvel,
        xpos=tracks.positions,
        xquat=tracks.quaternions,
        cvel=tracks.spatial,
        subtree_com=tracks.subtree_mass_centres,
        split_points=np.array([0, len(motion)]),
        site_xpos=places,
        site_xmat=turns,
        joint_names=np.array([model.joint(j).name for j in range(model.njnt)]),
        body_names=np.array([model.body(b).name for b in range(model.nbody)]),
        site_names=np.array([model.site(s).name for s in range(model.nsite)], dtype=np.str_),
        frequency=motion.fps,
        njnt=model.njnt,
        jnt_type=model.jnt_type,
        nbody=model.nbody,
        nsite=model.nsite,
        **{field: getattr(model, field) for field in MODEL_FIELDS},
    )


def read_locomujoco(source: TrajectorySource) -> Columns:
    """Read the first clip; more are left out, and said."""
    names, kinds = source.names(), shaped(source.array("jnt_type"), (None,), "jnt_type").astype(int).tolist()
    if names is None or len(names) != len(kinds):
        raise TrajectoryError(f"{len(names or ())} joint names for {len(kinds)} joints")
    sizes = [COORDINATES.get(kind, 1) for kind in kinds]
    qpos = shaped(source.array("qpos"), (None, sum(sizes)), "qpos")
    ends = shaped(source.arrays.get("split_points", [0, len(qpos)]), (None,), "split_points").astype(int)
    clip = qpos[: ends[1]] if len(ends) > 1 else qpos
    starts = np.cumsum([0, *sizes])
    free = [int(start) for start, kind in zip(starts, kinds, strict=False) if kind == FREE]
    single = [k for k, size in enumerate(sizes) if size == 1]
    return Columns(
        clip[:, starts[single]],
        tuple(names[k] for k in single),
        clip[:, free[0] : free[0] + 3] if free else None,
        clip[:, free[0] + 3 : free[0] + 7] if free else None,
        source.rate,
        notes=(f"The first of {len(ends) - 1} clips.",) if len(ends) > 2 else (),
    )


LOCOMUJOCO = declared(
    "locomujoco",
    write_locomujoco,
    read_locomujoco,
    lambda source: {"qpos", "qvel", "split_points", "frequency", "jnt_type"} <= source.arrays.keys(),
)


# Format `protomotions-pyroki`: the archive between PyRoki's retargeting and ProtoMotions' own `.motion`.
#
# `base_frame_pos` (T, 3) [m], `base_frame_wxyz` (T, 4), `joint_angles` (T, n) [rad] in the model's order; `fps` if
# present, else 30. ProtoMotions' `.motion` itself is a torch file that its converter makes of this.

PYROKI_KEYS = ArrayKeys("base_frame_pos", "base_frame_wxyz", "joint_angles")


def write_pyroki(motion: RobotMotion, path: Path) -> None:
    """Write the archive."""
    save_npz(
        path,
        base_frame_pos=motion.position,
        base_frame_wxyz=motion.quaternion,
        joint_angles=motion.angles,
        joint_names=np.array(motion.joints),
        fps=motion.fps,
    )


PYROKI = declared_by_keys("protomotions-pyroki", write_pyroki, "arrays", PYROKI_KEYS)


# Format `native`: this package's own trajectory file; see `robot_retarget.trajectory`.


def write_native(motion: RobotMotion, path: Path) -> None:
    """Write the file."""
    path.write_bytes(motion.trajectory.serialised())


def read_native(source: TrajectorySource) -> Trajectory:
    """Read the file, with times of the source and goals of the servos.

    Raises:
        TrajectoryError: it is broken, or another robot's.
    """
    trajectory = load_trajectory(source.path)
    require_same_robot(trajectory, source.robot)
    return trajectory


NATIVE = declared("native", write_native, read_native, lambda source: set(NATIVE_KEYS) <= source.arrays.keys())
