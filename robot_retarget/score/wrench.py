"""The root's residual wrench, which no contact force provides.

    r_t = ‖(f, τ/c)‖ / (m g),   (f, τ) = the root's part of inverse dynamics less contact forces, τ about the centre of mass

Contact forces act at the corners of the soles that stand, within friction pyramids (μ = 0.8), non-negative, and are chosen by
least squares. c is the height of the centre of mass in the reference pose. A motion that walks, runs or flies ballistically has
r = 0. Unit: 1. Range: 0 and more. Source: dynamic consistency as in KDMR and SPARK; velocities are smoothed over 0.05 s. Hands and
knees on the floor count as no contact.
"""

import numpy as np
from scipy.spatial.transform import Rotation

from robot_retarget.arrays import Floats
from robot_retarget.robot import Robot
from robot_retarget.robot.dynamics import momenta, root_dofs
from robot_retarget.score.figure import Figure, Measure, Value
from robot_retarget.score.subject import Subject


def measure(subject: Subject) -> tuple[Value, ...]:
    """The mean and the 95th percentile over the frames."""
    if not subject.robot.floating or len(subject) < 3:
        return None, None
    residual = _residuals(subject)
    return residual.mean(), np.percentile(residual, 95)


def _residuals(subject: Subject) -> Floats:
    """(T,) in weights of the robot."""
    robot, qpos = subject.robot, subject.trajectory.qpos
    model, first = robot.model, robot.root_address
    standing, centre = (_centres(robot, poses) for poses in (robot.neutral()[None], qpos))
    height = float(standing[0, 2] - subject.floor_of(robot.neutral()[None]))
    wrench = subject.forces[:, root_dofs(robot)]
    turns = Rotation.from_quat(qpos[:, first + 3 : first + 7], scalar_first=True)
    force = wrench[:, :3]
    torque = turns.apply(wrench[:, 3:]) - np.cross(
        centre - subject.root, force
    )  # a free joint's torque is in its own frame
    weight = float(model.body_subtreemass[robot.root_body] * np.linalg.norm(model.opt.gravity))
    return np.linalg.norm(np.hstack([force, torque / height]), axis=1) / weight


def _centres(robot: Robot, poses: Floats) -> Floats:
    """(T, 3) the centre of mass [m]."""
    return momenta(robot, poses, np.zeros((len(poses), robot.model.nv)))[0]


MEASURE = Measure(
    (
        Figure("root_residual", "weights", 3, "force on the root that no contact provides, mean"),
        Figure("root_residual_p95", "weights", 3, "the same, 95th percentile"),
    ),
    measure,
    feet=True,
)
