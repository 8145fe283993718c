"""The points of a foot that stand on the floor, as the figures on feet see them."""

from dataclasses import dataclass

import mujoco
import numpy as np

from robot_retarget.base.arrays import Floats
from robot_retarget.robot import Anatomy, Points, Robot, world_points
from robot_retarget.robot.kinematics import BLOCK
from robot_retarget.robot.links import local_points

LAYER = 0.01
"""Points this near to the lowest of the foot in the reference pose belong to its sole [m]."""
COUNT = 80
"""A sole is sampled by at most this many points, evenly in the order of the model's vertices."""


_ROUND = (mujoco.mjtGeom.mjGEOM_SPHERE, mujoco.mjtGeom.mjGEOM_CAPSULE, mujoco.mjtGeom.mjGEOM_CYLINDER)


@dataclass(frozen=True, eq=False)
class Foot:
    """How a sole moves over T frames."""

    lowest: Floats
    """(T,) height of its lowest point [m]."""
    middle: Floats
    """(T, 2) the mean of its points, seen from above [m]."""
    slip: Floats
    """(T,) speed along the floor of its slowest point, 0 at the first frame [m/s]."""


def foot_of(robot: Robot, sole: Points, qpos: Floats, fps: float) -> Foot:
    """Follow a sole through configurations (T, nq), a block of frames at a time."""
    count = len(qpos)
    lowest, middle, slip = np.empty(count), np.empty((count, 2)), np.zeros(count)
    for first in range(0, count, BLOCK):
        before = max(first - 1, 0)
        places, new = world_points(robot, sole, qpos[before : first + BLOCK]), slice(first, first + BLOCK)
        own = places[first - before :]
        lowest[new], middle[new] = own[..., 2].min(axis=1), own[..., :2].mean(axis=1)
        steps = np.linalg.norm(np.diff(places[..., :2], axis=0), axis=2) * fps
        slip[before + 1 : first + BLOCK] = steps.min(axis=1, initial=np.inf)
    return Foot(lowest, middle, slip)


def soles_of(robot: Robot, anatomy: Anatomy) -> tuple[Points, ...]:
    """The left and the right sole; none where the robot has not both."""
    feet = [anatomy.sites.get(f"{side}_toe", anatomy.sites.get(f"{side}_ankle")) for side in "lr"]
    soles = tuple(sole_points(robot, foot.body) for foot in feet if foot)
    return soles if len(soles) == 2 and all(len(sole) for sole in soles) else ()


def sole_points(robot: Robot, foot: int) -> Points:
    """The sole of a body: vertices of its geoms within `LAYER` of the lowest in the reference pose.

    Spheres, capsules and cylinders count by the lowest points of their ends.
    """
    model, data = robot.model, mujoco.MjData(robot.model)
    mujoco.mj_forward(model, data)
    clouds = [_places(model, data, int(geom)) for geom in np.flatnonzero(model.geom_bodyid == foot)]
    cloud = np.concatenate([np.zeros((0, 3)), *clouds])
    if not len(cloud):
        return Points(np.zeros(0, int), cloud)
    cloud = cloud[cloud[:, 2] < cloud[:, 2].min() + LAYER]
    cloud = cloud[np.linspace(0, len(cloud) - 1, min(COUNT, len(cloud))).astype(int)]
    return Points(np.full(len(cloud), foot), (cloud - data.xpos[foot]) @ data.xmat[foot].reshape(3, 3))


def _places(model: mujoco.MjModel, data: mujoco.MjData, geom: int) -> Floats:
    """(P, 3) the outermost points of a geom in the world [m]."""
    kind, size = int(model.geom_type[geom]), model.geom_size[geom]
    local, below = local_points(model, geom), np.zeros(3)
    if kind in _ROUND:
        half = 0.0 if kind == mujoco.mjtGeom.mjGEOM_SPHERE else float(size[1])
        local, below = np.array([[0.0, 0.0, -half], [0.0, 0.0, half]]), np.array([0.0, 0.0, size[0]])
    return local @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom] - below
