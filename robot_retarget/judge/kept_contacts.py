"""Contacts with bodies that a simulation keeps: those of the plan, link by link, and when one is missing."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from scipy.ndimage import maximum_filter1d

from robot_retarget.base.arrays import Bools, intervals
from robot_retarget.judge.bodies import SimulatedBodies
from robot_retarget.judge.stepping import Rollout
from robot_retarget.robot.body_distances import RobotAmongBodies
from robot_retarget.robot.model import Robot
from robot_retarget.robot.support import feet_of
from robot_retarget.trajectory import Trajectory

TOUCH = 0.001
"""Surfaces of a plan this near to each other touch; links that pass a body keep a larger margin [m]."""
BRIEF = 0.2
"""A plan passes bodies in shorter touches [s]."""
LATE = 0.15
"""A contact may begin and end later or earlier than planned by this time [s]."""

MISSED = 0.5
"""A foot misses a body that it touches for less than this share of a planned stance [-]."""


class Touch(NamedTuple):
    """A planned touch of a link and a body over some frames."""

    link: int
    body: int
    first: int
    last: int


def planned_touches(robot: Robot, trajectory: Trajectory) -> list[Touch]:
    """Return the touches of a trajectory, in which surfaces are within `TOUCH` of each other, without passing ones."""
    scene = trajectory.scene
    if scene is None:
        return []
    among, frames = RobotAmongBodies(robot, scene), len(trajectory)
    near: dict[tuple[int, int], Bools] = {}
    for t, (q, poses) in enumerate(zip(trajectory.qpos, scene.poses(frames), strict=True)):
        found = among.near(q, poses, TOUCH)
        for pair in zip(found.links.tolist(), found.bodies.tolist(), strict=True):
            near.setdefault(pair, np.zeros(frames, bool))[t] = True
    return [
        Touch(*pair, start, stop - 1)
        for pair, flags in sorted(near.items())
        for start, stop in intervals(flags)
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
    """Return (T, links, B) whether a link touched a body within `LATE` of each frame."""
    model, around = robot.model, rollout.around
    found = np.zeros((len(trajectory), model.nbody, len(bodies.scene)), bool)
    frame = np.round(rollout.times[around.frame] * trajectory.fps).astype(int)
    body = (around.bodies[:, 1:] == bodies.ids).argmax(axis=1)
    inside = (frame >= 0) & (frame < len(trajectory)) & np.isin(around.bodies[:, 1], bodies.ids)
    found[frame[inside], model.body_weldid[around.bodies[inside, 0]], body[inside]] = True
    return maximum_filter1d(found.astype(np.uint8), 2 * round(LATE * trajectory.fps) + 1, axis=0).astype(bool)


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
