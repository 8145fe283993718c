"""Format `locomujoco`: LocoMuJoCo's `Trajectory`.

`qpos` (T, nq), `qvel` (T, nv), body and site poses in MuJoCo's order, w x y z, `split_points` [0, T]; `joint_names` with
the root's, `frequency`; and the part of the model that its loader wants. A key it does not know is an error there, so the
file holds only these. qvel by central differences over two frames.
"""

from pathlib import Path

import numpy as np

from robot_retarget.base.errors import TrajectoryError
from robot_retarget.base.untrusted.arrays import save_npz, shaped
from robot_retarget.formats.bodies import body_tracks, site_tracks, velocities
from robot_retarget.formats.columns import Columns
from robot_retarget.formats.format import TrajectoryFormat
from robot_retarget.formats.robot_motion import RobotMotion
from robot_retarget.formats.source import TrajectorySource
from robot_retarget.robot.model import FREE

MODEL_FIELDS = (
    *(f"body_{field}" for field in ("rootid", "weldid", "mocapid", "pos", "quat", "ipos", "iquat")),
    *(f"site_{field}" for field in ("bodyid", "pos", "quat")),
)
COORDINATES = {int(FREE): 7, 1: 4}
"""How many coordinates a joint of a kind has; slides and hinges one."""


def write(motion: RobotMotion, path: Path) -> None:
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


def read(source: TrajectorySource) -> Columns:
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


FORMAT = TrajectoryFormat(
    name="locomujoco",
    suffix=".npz",
    description="LocoMuJoCo's Trajectory: qpos, qvel, bodies",
    write=write,
    read=read,
    claims=lambda source: {"qpos", "qvel", "split_points", "frequency", "jnt_type"} <= source.arrays.keys(),
    readers="LocoMuJoCo 1.x (Trajectory.load)",
)
