"""How a robot stood in a simulation: which feet touched, how they slipped and lifted, and how far inside its support it was balanced.

The zero moment point comes from the force F and the torque τ (about the origin) that the ground exerts:
x = (z F_x − τ_y) / F_z, y = (z F_y + τ_x) / F_z on a floor of height z.
"""

from typing import Any

import mujoco
import numpy as np

from robot_retarget.arrays import Floats
from robot_retarget.robot.feet import feet_of
from robot_retarget.robot.kinematics import world_points
from robot_retarget.robot.stance import DOWN, Stance, margins
from robot_retarget.simulate.plant import Plant
from robot_retarget.simulate.stepping import Rollout

LIGHT = 0.05
"""The zero moment point is undefined while the ground carries less than this share of the weight [-]."""


def stance_of(plant: Plant, rollout: Rollout) -> Stance | None:
    """How the robot stood in a free rollout; None for a robot without recognised feet."""
    feet = feet_of(plant.robot)
    if not feet.names or not len(rollout.times):
        return None
    floor = floor_height(plant.model)
    points = world_points(plant.robot, feet.soles, rollout.qpos)
    points[..., 2] -= floor
    touching = np.zeros((len(rollout.times), len(feet.names)), dtype=bool)
    scene = rollout.contacts.scene
    for foot, bodies in enumerate(feet.bodies):
        touching[scene.frame[np.isin(scene.bodies[:, 1], list(bodies))], foot] = True
    down = touching[:, feet.owner] & (points[..., 2] < DOWN)
    zmp = zero_moment_point(rollout.ground, floor, float(plant.model.body_mass.sum()) * plant.robot.gravity)
    com = rollout.com[:, :2]
    margin = margins(np.stack([com, zmp]), points[..., :2], down)
    return Stance(feet, rollout.times, touching, points, down, com, zmp, margin[0], margin[1])


def floor_height(model: mujoco.MjModel) -> float:
    """Return the height of the highest plane of the scene [m], 0 without one."""
    planes = np.flatnonzero((model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE) & (model.geom_bodyid == 0))
    return float(model.geom_pos[planes, 2].max()) if planes.size else 0.0


def zero_moment_point(ground: Floats, floor: float, weight: float) -> Floats:
    """(N, 2) [m] of wrenches (N, 6) about the origin; NaN where less than LIGHT of the weight is on the ground."""
    force, torque = ground[:, :3], ground[:, 3:]
    with np.errstate(divide="ignore", invalid="ignore"):
        lever = np.stack([floor * force[:, 0] - torque[:, 1], floor * force[:, 1] + torque[:, 0]], axis=1)
        point = lever / force[:, 2:]
    point[force[:, 2] < LIGHT * weight] = np.nan
    return point


def slip_distances(stance: Stance) -> Floats:
    """(F,) the furthest each foot slid from where it began to stand [m].

    Between two states a standing foot moves as its carrying points do on average, so that rolling over an edge is no slip.
    """
    found = np.zeros(len(stance.feet.names))
    for foot in range(len(found)):
        mine = stance.feet.owner == foot
        both = stance.down[1:, mine] & stance.down[:-1, mine]
        moves = np.diff(stance.points[:, mine, :2], axis=0)
        count = both.sum(1)
        mean = (moves * both[..., None]).sum(1) / np.maximum(count, 1)[:, None]
        path = np.zeros(2)
        for standing, move in zip(count > 0, mean, strict=True):
            path = path + move if standing else np.zeros(2)
            found[foot] = max(found[foot], float(np.linalg.norm(path)))
    return found


def stance_figures(stance: Stance | None, until: float | None) -> dict[str, Any]:
    """Slip, clearance and margins while the trajectory plays, up to a fall at `until` [s]."""
    names = ("foot_slip_m", "sole_clearance_m", "com_margin_m", "zmp_margin_m", "support_share")
    if stance is None:
        return dict.fromkeys(names)
    end = np.inf if until is None else until
    playing = (stance.times >= 0) & (stance.times < end)
    if not playing.any():
        return dict.fromkeys(names)
    part = Stance(stance.feet, *(getattr(stance, name)[playing] for name in list(vars(stance))[1:]))
    owner = part.feet.owner
    lowest = np.stack([part.points[:, owner == f, 2].min(1) for f in range(len(part.feet.names))], axis=1)
    return {
        "foot_slip_m": round(float(slip_distances(part).max()), 5),
        "sole_clearance_m": {n: round(float(h), 4) for n, h in zip(part.feet.names, lowest.max(0), strict=True)},
        "com_margin_m": _least(part.com_margin),
        "zmp_margin_m": _least(part.zmp_margin),
        "support_share": {n: round(float(s), 4) for n, s in zip(part.feet.names, part.touching.mean(0), strict=True)},
    }


def _least(margin: Floats) -> float | None:
    return None if np.isnan(margin).all() else round(float(np.nanmin(margin)), 5)
