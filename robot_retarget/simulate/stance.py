"""How a robot stands: which feet touch, how they slip and lift, and how far inside its support it is balanced.

The margin of a point is its distance to the nearest edge of the convex hull of the sole points that carry. The zero moment point comes from the force F and
the torque τ (about the origin) that the ground exerts: x = (z F_x − τ_y) / F_z, y = (z F_y + τ_x) / F_z on a floor of height z.
"""

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from scipy.spatial import QhullError

from robot_retarget.arrays import Floats
from robot_retarget.balance.zmp import GRAVITY, support
from robot_retarget.robot.dynamics import momenta, zero_moment_points
from robot_retarget.robot.kinematics import world_points
from robot_retarget.robot.model import Robot
from robot_retarget.simulate.feet import Feet, feet_of
from robot_retarget.simulate.plant import Plant
from robot_retarget.simulate.stepping import Rollout
from robot_retarget.trajectory import Trajectory

DOWN = 0.003
"""Sole points of a touching foot this near to the floor carry it [m]."""
SMOOTH = 0.05
"""Of the momenta of a plan [s]."""
LIGHT = 0.05
"""Under this part of its weight on the ground a robot has no zero moment point worth the name."""


@dataclass(frozen=True, eq=False)
class Stance:
    """F feet, K sole points, over the N states of a rollout."""

    feet: Feet
    times: Floats
    """(N,) [s]."""
    touching: np.ndarray
    """(N, F) whether a foot is in contact with the scene."""
    points: Floats
    """(N, K, 3) sole points [m], heights above the floor."""
    down: np.ndarray
    """(N, K) whether a sole point carries its foot."""
    com: Floats
    """(N, 2) the centre of mass, seen from above [m]."""
    zmp: Floats
    """(N, 2) the zero moment point [m], NaN where the robot hardly touches the ground."""
    com_margin: Floats
    zmp_margin: Floats
    """(N,) inside the support [m], negative outside, NaN without support."""


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
    zmp = zero_moment_point(rollout.ground, floor, float(plant.model.body_mass.sum()))
    com = rollout.com[:, :2]
    margin = margins(np.stack([com, zmp]), points[..., :2], down)
    return Stance(feet, rollout.times, touching, points, down, com, zmp, margin[0], margin[1])


def planned_stance(robot: Robot, trajectory: Trajectory) -> Stance | None:
    """How the robot would stand if it followed the trajectory on a floor under its lowest sole point of every frame.

    None for a robot without recognised feet or a free root.
    """
    feet = feet_of(robot)
    if not feet.names or not robot.floating:
        return None
    points = world_points(robot, feet.soles, trajectory.qpos)
    floor = points[..., 2].min(axis=1)
    points[..., 2] -= floor[:, None]
    down = points[..., 2] < 2 * DOWN
    touching = np.stack([down[:, feet.owner == f].any(1) for f in range(len(feet.names))], axis=1)
    on_floor = trajectory.qpos.copy()
    on_floor[:, robot.root_address + 2] -= floor
    com = momenta(robot, on_floor, np.zeros((len(on_floor), robot.model.nv)))[0]
    pushed = zero_moment_points(robot, on_floor, trajectory.fps, SMOOTH)
    margin = margins(np.stack([com[:, :2], pushed]), points[..., :2], down)
    times = np.arange(len(trajectory)) / trajectory.fps
    return Stance(feet, times, touching, points, down, com[:, :2], pushed, margin[0], margin[1])


def floor_height(model: mujoco.MjModel) -> float:
    """Of the highest plane of the scene [m], 0 without one."""
    planes = np.flatnonzero((model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE) & (model.geom_bodyid == 0))
    return float(model.geom_pos[planes, 2].max()) if planes.size else 0.0


def zero_moment_point(ground: Floats, floor: float, mass: float) -> Floats:
    """(N, 2) [m] of wrenches (N, 6) about the origin; NaN where less than LIGHT of the weight is on the ground."""
    force, torque = ground[:, :3], ground[:, 3:]
    with np.errstate(divide="ignore", invalid="ignore"):
        lever = np.stack([floor * force[:, 0] - torque[:, 1], floor * force[:, 1] + torque[:, 0]], axis=1)
        point = lever / force[:, 2:]
    point[force[:, 2] < LIGHT * mass * GRAVITY] = np.nan
    return point


def margins(places: Floats, corners: Floats, down: np.ndarray) -> Floats:
    """How far inside the hull of its frame's corners that are down each place is.

    Args:
        places: (M, N, 2) [m].
        corners: (N, K, 2) [m].
        down: (N, K).

    Returns:
        (M, N) [m], negative beyond an edge, NaN without support.
    """
    found = np.full(places.shape[:2], np.nan)
    for k in np.flatnonzero(down.any(1)):
        found[:, k] = _inside(corners[k, down[k]], places[:, k])
    return found


def _inside(corners: Floats, places: Floats) -> list[float]:
    try:
        polygon = support(corners)
    except (QhullError, ValueError):  # a point or a line has no inside
        return (-np.linalg.norm(places[:, None] - corners, axis=2).min(1)).tolist()
    return [polygon.margin(place) for place in places]


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
