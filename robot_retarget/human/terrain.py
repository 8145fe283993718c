"""Steps and seats that a capture shows without naming them: heights at which feet stand cluster, and a low pelvis rests.

A foot stands on a step where toe and ankle rest together above the lowest level. The footprints of one level that are side by side
become one box. A seat is under a pelvis that rests low and behind the feet.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from robot_retarget.base.arrays import Floats, bearing, intervals
from robot_retarget.contact.rule import JOINTS, speed_of
from robot_retarget.human.features import ActivityRule, is_supported
from robot_retarget.human.match import Match
from robot_retarget.human.motion import Motion
from robot_retarget.human.surroundings import with_scene
from robot_retarget.scene.scene import RigidBody, Scene
from robot_retarget.scene.shape import ShapeKind, solid


@dataclass(frozen=True)
class TerrainRule:
    """What counts as a step or a seat; lengths over the human's leg.

    Half and double of each were measured on a step, a chair and two walks: `flesh` and `seat` move the height and the sides of
    the chair's seat; the others change nothing.
    """

    rise: float = 0.08
    """Levels are this far apart [-]: errors of captures and bent toes reach 0.05."""
    rest: float = 0.2
    """A foot stands at least this long [s]."""
    upright: float = 0.5
    """The pelvis is this far over a foot that carries [-] ..."""
    carries: float = 0.1
    """... for this time, while the other foot does not rest on a lower level [s]."""
    beside: float = 0.8
    """Footprints of one level at most this far apart are on one box [-]."""
    margin: float = 0.3
    """A box reaches this far around its footprints, or half the way to those of lower levels [-]: soles of small robots are twice as
    long as a human's."""
    flesh: float = 0.1
    """From the pelvis down to a seat [-]."""
    sat: float = 0.8
    """A seat is used at least this long [s]."""
    seat: tuple[float, float, float] = (0.25, 0.12, 0.5)
    """How far a seat reaches behind and before the pelvis, and its width [-]."""
    lowest: float = 0.2
    """A lower seat is the floor [-]."""


@dataclass(frozen=True, eq=False)
class Footprint:
    """Where one foot stands."""

    points: Floats
    """(2, 2) toe and ankle from above [m]."""
    height: float
    """Of the toe [m]."""


def with_terrain(motion: Motion, match: Match) -> Motion:
    """Return a motion with boxes under its steps and seats, its lowest level at z = 0; the same motion on a level floor.

    Args:
        motion: the human's; bodies around it stay.
        match: its keypoints.
    """
    chosen, clip = TerrainRule(), motion.clip
    x = match.human_positions(clip)
    prints = list(_footprints(x, match, motion.fps, chosen))
    if not prints:
        return motion
    levels = _levels(prints, chosen.rise * match.human_leg)
    floor = levels[0][0]
    bodies = [*_steps(levels, chosen, match.human_leg), *_seats(x, floor, match, motion.fps, chosen)]
    if not bodies:
        return motion
    known = () if clip.scene is None else clip.scene.bodies
    low = floor if abs(floor) > chosen.rise * match.human_leg else 0.0
    raised = replace(clip, positions=clip.positions - [0.0, 0.0, low], scene=None, whole=None)
    part = raised if motion.whole is None else raised.frames(motion.span.start, motion.span.stop)
    return with_scene(part, Scene((*known, *bodies), "the capture", tuple(_said(body) for body in bodies)))


def _said(body: RigidBody) -> str:
    length, width, height = body.shape.size.tolist()
    return f"Terrain: {body.name}, {height:.2f} m high, {length:.2f} × {width:.2f} m."


def _footprints(x: Floats, match: Match, fps: float, rule: TerrainRule) -> Iterator[Footprint]:
    """Find where toe and ankle of a foot rest together and carry: below the pelvis, and not above another foot that rests."""
    leg = match.human_leg
    if not {"pelvis", *(f"{side}_{part}" for side in "lr" for part in ("toe", "ankle"))} <= set(match.keypoints):
        return
    feet = x[:, [[match.index(f"{side}_{part}") for part in ("toe", "ankle")] for side in "lr"]]
    rests = np.asarray((speed_of(feet / leg, fps) < JOINTS.enter_speed).all(axis=2))
    height, pelvis = feet[:, :, 0, 2], x[:, match.index("pelvis"), 2]
    for foot in range(2):
        lifted = rests[:, 1 - foot] & (height[:, foot] > height[:, 1 - foot] + rule.rise * leg)
        carries = ~lifted & (pelvis - height[:, foot] > rule.upright * leg)
        for start, stop in intervals(rests[:, foot]):
            if stop - start >= rule.rest * fps and carries[start:stop].sum() >= rule.carries * fps:
                place = np.median(feet[start:stop, foot], axis=0)
                yield Footprint(place[:, :2], float(place[0, 2]))


def _levels(prints: list[Footprint], rise: float) -> list[tuple[float, list[Footprint]]]:
    """Return the levels [m] with their footprints, the lowest first: heights at most `rise` apart cluster."""
    ordered = sorted(prints, key=lambda each: each.height)
    gaps = np.flatnonzero(np.diff([each.height for each in ordered]) > rise) + 1
    groups = [list(group) for group in np.split(np.array(ordered, dtype=object), gaps)]
    return [(float(np.median([each.height for each in group])), group) for group in groups]


def _steps(levels: list[tuple[float, list[Footprint]]], rule: TerrainRule, leg: float) -> Iterator[RigidBody]:
    """Return a box for the footprints of each level above the lowest that are side by side."""
    count = 0
    for level, (height, prints) in enumerate(levels[1:], 1):
        below = np.concatenate([each.points for _, lower in levels[:level] for each in lower])
        for group in _beside(prints, rule.beside * leg):
            count += 1
            yield _box(
                f"step {count}",
                height - levels[0][0],
                np.concatenate([each.points for each in group]),
                below,
                rule.margin * leg,
            )


def _beside(prints: list[Footprint], reach: float) -> list[list[Footprint]]:
    """Return footprints in groups that are at most `reach` apart [m]."""
    groups: list[list[Footprint]] = []
    for each in prints:
        near = [g for g in groups if any(np.linalg.norm(each.points[0] - one.points[0]) < reach for one in g)]
        groups = [g for g in groups if g not in near] + [[each, *(one for g in near for one in g)]]
    return groups


def _box(name: str, height: float, points: Floats, below: Floats, margin: float) -> RigidBody:
    """Return a box from the floor up to a height around points (P, 2), along their feet, at most half the way to the points `below` (Q, 2)."""
    ahead = (points[::2] - points[1::2]).sum(axis=0)
    heading = float(bearing(ahead))
    axes = np.array([[np.cos(heading), np.sin(heading)], [-np.sin(heading), np.cos(heading)]])
    own, others = points @ axes.T, below @ axes.T
    least, most = own.min(axis=0), own.max(axis=0)
    low, high = least - margin, most + margin
    for place in others:
        axis = int(np.maximum(least - place, place - most).argmax())
        if place[axis] < least[axis]:
            low[axis] = max(low[axis], (place[axis] + least[axis]) / 2)
        elif place[axis] > most[axis]:
            high[axis] = min(high[axis], (place[axis] + most[axis]) / 2)
    return _standing(name, np.append(high - low, height), (low + high) / 2 @ axes, heading)


def _standing(name: str, size: Floats, middle: Floats, heading: float) -> RigidBody:
    """Return a fixed box of a size (3,) that stands on the floor [m]."""
    pose = [*middle, size[2] / 2, np.cos(heading / 2), 0.0, 0.0, np.sin(heading / 2)]
    return RigidBody(name, solid(ShapeKind.BOX, (float(size[0]), float(size[1]), float(size[2]))), np.array(pose))


def _seats(x: Floats, floor: float, match: Match, fps: float, rule: TerrainRule) -> Iterator[RigidBody]:
    """Return a box under the pelvis for every time in which it rests low and behind the feet."""
    if not {"pelvis", "l_knee", "r_knee"} <= set(match.keypoints):
        return
    leg, pelvis = match.human_leg, x[:, match.index("pelvis")]
    knees = x[:, [match.index(f"{side}_knee") for side in "lr"]].mean(axis=1)
    rests = is_supported(x - [0.0, 0.0, floor], match, ActivityRule()) & (
        speed_of(pelvis / leg, fps) < JOINTS.enter_speed
    )
    found = [span for span in intervals(rests) if (span[1] - span[0]) / fps >= rule.sat]
    for count, (start, stop) in enumerate(found, 1):
        middle = np.median(pelvis[start:stop], axis=0)
        ahead = np.median(knees[start:stop], axis=0) - middle
        height, heading = middle[2] - floor - rule.flesh * leg, float(bearing(ahead))
        if height < rule.lowest * leg:
            continue
        behind, before, width = (share * leg for share in rule.seat)
        way = np.array([np.cos(heading), np.sin(heading)])
        size = np.array([behind + before, width, height])
        yield _standing(f"seat {count}", size, middle[:2] + (before - behind) / 2 * way, heading)
