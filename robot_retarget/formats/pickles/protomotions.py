"""Format `protomotions`: a `.motion` of ProtoMotions 3, a dict of tensors that `torch.load` reads.

`fps`; `dof_pos`, `dof_vel` (T, n) [rad, rad/s]; `rigid_body_pos`, `rigid_body_vel`, `rigid_body_ang_vel` (T, B, 3) and
`rigid_body_rot` (T, B, 4) x y z w of all bodies' frames in the world, the root first; `rigid_body_contacts` (T, B), all false.
Joints and bodies in the order of the MJCF. Single precision.
"""

from pathlib import Path

import numpy as np

from robot_retarget.base.arrays import Floats
from robot_retarget.base.untrusted.arrays import rate_of
from robot_retarget.base.untrusted.pickles import dump_torch
from robot_retarget.formats.bodies import body_tracks, velocities
from robot_retarget.formats.columns import Columns
from robot_retarget.formats.format import TrajectoryFormat
from robot_retarget.formats.orders import robot_bodies
from robot_retarget.formats.pickles.dictionary import array_in, holds
from robot_retarget.formats.quaternions import FIRST_LAST, LAST_FIRST
from robot_retarget.formats.robot_motion import RobotMotion
from robot_retarget.formats.source import TrajectorySource


def write(motion: RobotMotion, path: Path) -> None:
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
    singles = {name: values.astype("f4") for name, values in tensors.items()}
    dump_torch(path, {"fps": motion.fps, **singles, "rigid_body_contacts": contacts})


def read(source: TrajectorySource) -> Columns:
    """Read the joints, and the root from the first body."""
    angles = array_in(source.pickled, "dof_pos", (None, None))
    places = array_in(source.pickled, "rigid_body_pos", (len(angles), None, 3))
    turns = array_in(source.pickled, "rigid_body_rot", (len(angles), places.shape[1], 4))
    return Columns(angles, source.names(), places[:, 0], turns[:, 0][:, FIRST_LAST], rate_of(source.pickled))


FORMAT = TrajectoryFormat(
    name="protomotions",
    suffix=".motion",
    description="ProtoMotions 3 motion: joints and bodies with velocities, as tensors",
    write=write,
    read=read,
    claims=lambda source: holds(source.pickled, "rigid_body_pos", "rigid_body_rot", "dof_pos"),
    readers="ProtoMotions (MotionLib, packed motion libraries)",
    complete=False,
    exact=False,
    quaternion="xyzw",
    plain=True,
)
