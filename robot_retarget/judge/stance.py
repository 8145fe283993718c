"""How a robot stood in a simulation: which feet touched, how they slipped and lifted, and how far inside its support it was balanced.

The zero moment point comes from the wrench of all contacts, on the plane through the sole points that carry (`robot.support`).
"""

import itertools
from collections.abc import Mapping
from typing import Any, NamedTuple

import mujoco
import numpy as np
from scipy.ndimage import maximum_filter1d

from robot_retarget.base.arrays import Bools, Floats, intervals, unit
from robot_retarget.contact.stance import DOWN, Stance, contact_planes, margins
from robot_retarget.contact.touch import BRIEF
from robot_retarget.judge.bodies import SimulatedBodies
from robot_retarget.judge.plant import Plant
from robot_retarget.judge.playback import Rollout
from robot_retarget.robot.body_distances import RobotAmongBodies
from robot_retarget.robot.contacts import Contacts
from robot_retarget.robot.geoms import solid_geoms
from robot_retarget.robot.kinematics import carrying, world_points
from robot_retarget.robot.model import Robot
from robot_retarget.robot.support import CORNERS, Feet, Planes, feet_of
from robot_retarget.scores.subject import OVERLAP
from robot_retarget.trajectory import Trajectory

LATERAL = 0.5**0.5
"""Cosine between the axis of a hinge that pitches the foot and the direction across it: 45°, halfway to a roll [-]."""
LIGHT = 0.05
"""The zero moment point is undefined while the ground carries less than this share of the weight [-]."""


def stance_of(plant: Plant, rollout: Rollout) -> Stance | None:
    """How the robot stood in a free rollout; None for a robot without recognised feet."""
    feet = feet_of(plant.robot) if plant.ground.level else feet_of(plant.robot).filled
    if not feet.names or not len(rollout.times):
        return None
    places, floor = world_points(plant.robot, feet.soles, rollout.qpos), floor_height(plant.model)
    points = places.copy()
    points[..., 2] -= np.maximum(plant.ground.under(places)[0], floor)
    carrying = _carrying(plant, rollout, feet)
    touching = np.zeros((len(rollout.times), len(feet.names)), dtype=bool)
    for foot, contacts in enumerate(carrying):
        touching[contacts.frame, foot] = True
    down = touching[:, feet.owner] & (points[..., 2] < DOWN)
    spots, spanned = (points, down) if plant.ground.level else _spots(carrying, len(rollout.times))
    planes = contact_planes(spots, spanned, plant.ground, floor)
    weight = float(plant.robot.model.body_mass.sum()) * plant.robot.gravity
    zmp = zero_moment_point(rollout.ground, planes, weight)
    com = rollout.com[:, :2]
    margin = margins(np.stack([com, zmp]), spots[..., :2], spanned)
    return Stance(feet, rollout.times, touching, points, down, com, zmp, margin[0], margin[1])


def ankle_figures(plant: Plant, qpos: Floats) -> dict[str, float]:
    """Return the stiffness of both ankles in pitch, Σ k, and that with which gravity tips the robot over them, m g h [N m/rad].

    A robot whose ankles are softer than gravity falls without feedback, however well its goals are balanced.

    Args:
        plant: the servos.
        qpos: (nq,) a pose in which it stands.
    """
    robot, model, feet = plant.robot, plant.model, feet_of(plant.robot)
    data = mujoco.MjData(robot.model)
    data.qpos[:] = qpos
    mujoco.mj_kinematics(robot.model, data)
    mujoco.mj_comPos(robot.model, data)
    corners = world_points(robot, feet.corners, qpos[None])[0].reshape(-1, CORNERS, 3)
    ankles, moves = [], carrying(robot.model)
    for bodies, (front_left, front_right, _, _) in zip(feet.bodies, corners, strict=True):
        across = np.abs(data.xaxis[robot.joint_ids] @ unit(front_left - front_right)) > LATERAL
        above = moves[min(bodies), robot.dof_index]
        ankles += np.flatnonzero(across & above & (plant.servos >= 0)).tolist()[-1:]
    if len(ankles) < 2:
        return {}
    servos, joints = plant.servos[ankles], robot.joint_ids[ankles]
    stiffness = float(-(model.actuator_gear[servos, 0] ** 2 @ model.actuator_biasprm[servos, 1]))
    height = float(data.subtree_com[robot.root_body, 2] - data.xanchor[joints, 2].mean())
    gravity = float(robot.model.body_mass.sum()) * robot.gravity * height
    return {"ankle_stiffness_Nm_rad": round(stiffness, 2), "tipping_stiffness_Nm_rad": round(gravity, 2)}


def _carrying(plant: Plant, rollout: Rollout, feet: Feet) -> list[Contacts]:
    """Return the contacts of each foot with the floor or a body at rest."""
    still = [] if plant.bodies is None else plant.bodies.still
    floor, around = rollout.contacts.scene, rollout.around.of(np.isin(rollout.around.bodies[:, 1], still))
    every = Contacts(*(np.concatenate([getattr(floor, name), getattr(around, name)]) for name in vars(floor)))
    foot = np.concatenate([floor.bodies[:, 1], around.bodies[:, 0]])
    return [every.of(np.isin(foot, list(bodies))) for bodies in feet.bodies]


def _spots(carrying: list[Contacts], states: int) -> tuple[Floats, Bools]:
    """Return the places (N, P, 3) of contacts over N states [m], and which there are (N, P): a step may be smaller than a sole."""
    frame, places = (np.concatenate([getattr(each, name) for each in carrying]) for name in ("frame", "places"))
    order = np.argsort(frame, kind="stable")
    frame, places = frame[order], places[order]
    rank = np.arange(len(frame)) - np.searchsorted(frame, frame)
    spots = np.zeros((states, int(rank.max(initial=0)) + 1, 3))
    spots[frame, rank] = places
    return spots, np.arange(spots.shape[1]) < np.bincount(frame, minlength=states)[:, None]


def floor_height(model: mujoco.MjModel) -> float:
    """Return the height of the highest plane of the scene [m], 0 without one."""
    planes = np.flatnonzero((model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE) & (model.geom_bodyid == 0))
    return float(model.geom_pos[planes, 2].max()) if planes.size else 0.0


def zero_moment_point(ground: Floats, planes: Planes, weight: float) -> Floats:
    """(N, 2) [m] of wrenches (N, 6) about the origin; NaN where less than LIGHT of the weight is on the ground."""
    with np.errstate(divide="ignore", invalid="ignore"):
        point = planes.points(ground)[:, :2]
    point[ground[:, 2] < LIGHT * weight] = np.nan
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


# Contacts with bodies that a simulation keeps: those of the plan, link by link, and when one is missing.

LATE_CONTACT = 0.15
"""A contact may begin and end later or earlier than planned by this time [s]: by .075 s, 0.6 % of the contacts of the box sample on the OP3 count
as lost, in place of none."""

MISSED = 0.5
"""A foot misses a body that it touches for less than this share of a planned stance [-]: half of it."""


class Touch(NamedTuple):
    """A planned touch of a link and a body over some frames."""

    link: int
    body: int
    first: int
    last: int


def planned_touches(robot: Robot, trajectory: Trajectory) -> list[Touch]:
    """Return the touches of a trajectory, in which surfaces are within `OVERLAP` of each other, without passing ones."""
    scene = trajectory.scene
    if scene is None:
        return []
    poses, links = scene.poses(len(trajectory)), list(solid_geoms(robot))
    near = RobotAmongBodies(robot, scene).along(trajectory.qpos, poses, OVERLAP) < OVERLAP
    return [
        Touch(link, body, start, stop - 1)
        for (k, link), body in itertools.product(enumerate(links), range(len(scene)))
        for start, stop in intervals(near[:, body * len(links) + k])
        if stop - start >= BRIEF * trajectory.fps
    ]


def contact_figures(
    bodies: SimulatedBodies | None, rollout: Rollout, robot: Robot, trajectory: Trajectory, until: float | None
) -> dict[str, Any]:
    """Return how many of the planned contacts with bodies a simulation keeps, up to a fall at `until` [s]; empty without any.

    `body_contacts` has a line per planned touch: link, body, from when to when, the share kept, the first frame without it,
    and the foot that the body carries. `lost_contact` names the worst.
    """
    touches = planned_touches(robot, trajectory) if bodies is not None else []
    end = len(trajectory) if until is None else round(until * trajectory.fps)
    touches = [touch for touch in touches if touch.first < end]
    if bodies is None or not touches:
        return {}
    happened = _happened(bodies, rollout, robot, trajectory)
    lines, kept, planned = [], 0, 0
    for touch in touches:
        there = happened[touch.first : min(touch.last + 1, end), touch.link, touch.body]
        kept, planned = kept + int(there.sum()), planned + len(there)
        lines.append(_line(touch, there, bodies, robot, trajectory.fps))
    worst = max(lines, key=lambda line: (1 - line["kept"]) * (line["to_s"] - line["from_s"]))
    named = f"{worst['link']} leaves {worst['body']}, first at {worst['lost_s']} s" if kept < planned else None
    return {"body_contacts_lost": round(1 - kept / planned, 4), "lost_contact": named, "body_contacts": lines}


def _happened(bodies: SimulatedBodies, rollout: Rollout, robot: Robot, trajectory: Trajectory) -> Bools:
    """Return (T, links, B) whether a link touched a body within `LATE_CONTACT` of each frame."""
    model, around = robot.model, rollout.around
    found = np.zeros((len(trajectory), model.nbody, len(bodies.scene)), bool)
    frame = np.round(rollout.times[around.frame] * trajectory.fps).astype(int)
    body = (around.bodies[:, 1:] == bodies.ids).argmax(axis=1)
    inside = (frame >= 0) & (frame < len(trajectory)) & np.isin(around.bodies[:, 1], bodies.ids)
    found[frame[inside], model.body_weldid[around.bodies[inside, 0]], body[inside]] = True
    return maximum_filter1d(found.astype(np.uint8), 2 * round(LATE_CONTACT * trajectory.fps) + 1, axis=0).astype(bool)


def _line(touch: Touch, there: Bools, bodies: SimulatedBodies, robot: Robot, fps: float) -> dict[str, Any]:
    feet, body = feet_of(robot), bodies.scene.bodies[touch.body]
    foot = next((name for name, own in zip(feet.names, feet.bodies, strict=True) if touch.link in own), None)
    return {
        "link": robot.model.body(touch.link).name,
        "body": body.name,
        "foot": foot if body.fixed else None,
        "from_s": round(touch.first / fps, 3),
        "to_s": round(touch.last / fps, 3),
        "kept": round(float(there.mean()), 4),
        "lost_s": None if there.all() else round((touch.first + int(there.argmin())) / fps, 3),
    }


def missed_steps(figures: Mapping[str, Any]) -> list[str]:
    """Return the reasons of feet that did not stand on their bodies for most of a stance."""
    sides = {"l": "left", "r": "right"}
    return [
        f"the {sides.get(line['foot'], line['foot'])} foot misses {line['body']} at {line['lost_s']:g} s"
        for line in figures.get("body_contacts", [])
        if line["foot"] and line["kept"] < MISSED
    ]
