"""The points of a foot that stand on the floor, as the figures on feet see them."""

import itertools

import mujoco
import numpy as np

from robot_retarget.arrays import Floats
from robot_retarget.robot import Points, Robot

LAYER = 0.01
"""Points this near to the lowest of the foot in the reference pose belong to its sole [m]."""
COUNT = 80
"""A sole is sampled by at most this many points, evenly in the order of the model's vertices."""


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
    kind, size, radius = model.geom_type[geom], model.geom_size[geom], 0.0
    local = np.zeros((0, 3))
    if kind == mujoco.mjtGeom.mjGEOM_MESH:
        mesh = int(model.geom_dataid[geom])
        first, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
        local = np.asarray(model.mesh_vert[first : first + count], dtype=float)
    elif kind == mujoco.mjtGeom.mjGEOM_BOX:
        local = np.array(list(itertools.product(*[(-half, half) for half in size])))
    elif kind == mujoco.mjtGeom.mjGEOM_SPHERE:
        local, radius = np.zeros((1, 3)), float(size[0])
    elif kind in (mujoco.mjtGeom.mjGEOM_CAPSULE, mujoco.mjtGeom.mjGEOM_CYLINDER):
        local, radius = np.array([[0, 0, -size[1]], [0, 0, size[1]]]), float(size[0])
    return local @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom] - [0, 0, radius]
