"""Foothold: a sole point of a standing foot keeps its place of the frame before, δ = 0; a swing foot has a reference.

Edges of length 0 from frame to frame chain a stance to one place, the foothold. An edge with the priority of a hard
edge joins each coordinate of a held corner to it. The foothold's position comes from the human (`graph.footholds`)
until a coarse path of the robot shows where its legs put the foot.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np

from robot_retarget.base.arrays import Bools, Floats, intervals, smoothstep, unit
from robot_retarget.graph.footholds import (
    CausalFootholds,
    Footholds,
    Surface,
    foothold_corners,
    footholds_of,
    settled_heading,
    without_unreachable,
)
from robot_retarget.graph.kind import (
    AXES,
    FrameTargets,
    Grounding,
    Kind,
    Measures,
    PlaybackFrames,
    RetargetContext,
    StreamFrame,
    Track,
    exact,
)
from robot_retarget.graph.soles import lengths
from robot_retarget.graph.symbolic_robot import SymbolicRobot
from robot_retarget.graph.track import HARD
from robot_retarget.graph.weights import Weights
from robot_retarget.robot.kinematics import carrying
from robot_retarget.robot.support import CORNER_NAMES


@dataclass(frozen=True)
class FootholdKind(Kind):
    """The corners of every sole."""

    name: str = "foothold"
    whole = True
    tilting: float = 20.0
    """π normal to the floor for soles that fewer than six hinges cannot lay flat anywhere, over the leg [-]: half and
    double change the cost of a walk on the H1 by 1 %, its limbs by 0.02° and its jerk from 231 to 220 and 240
    rad/s³."""

    known: bool = False
    """Whether stances are known exactly, as a robot's are; a human's foot still slides in the first frame of its stance, so feet
    without balance land a frame earlier."""
    met: float = 1e-3
    """Known stances keep their places if half of the coarse path, a spline between moments, comes nearer [m]."""
    backlash: float = 0.1
    """A foot that stands turns with the human's where that heads away by more [rad]; half and double change the costs of four
    clips on the G1 and the OP3 by 1 % at most ..."""
    pivots: bool = False
    """... and swings with its shape, where the trajectory is not balanced; balance plans stances and swings of flat feet."""
    frees: bool = True
    """Whether one of two feet steps where the robot's legs do not reach both footholds ..."""
    freed: float = 10.0
    """... and its π on the way, over the leg [-]: with 4, that of swings, a foot slides at 23 cm/s in the last frames of a fall on
    the OP3 (2.4 with 10, 2.3 with 20); with 20 and 40 the fall costs 1.4 and 1.3 times as much, a ballet 1.05 and 1.08 times."""
    laid: float = 3000.0
    """π normal to the floor on the coarse path, over the leg [-]: hard edges would bend every step of its descents.
    Half and double change the cost of a dance on the G1 by 1.2 and -1.3 %, and its limbs by 0.02° at most."""

    on_bodies: float = 1000.0
    """π normal to the surface among bodies, over the leg [-]: below `HARD`, because their clearance knows the whole
    foot. Half and double change the cost of the box sample by less than 0.6 %, and no limb."""

    def targets(self, context: RetargetContext) -> Track | None:
        """Footholds read off the human."""
        kind = self if context.scene is None else replace(self, frees=False)  # a step has one place for a foot
        footholds = footholds_of(context.human, context.match, context.robot, self.backlash, self.known)
        return kind.track(footholds, context.leg, context.weights, self.across(context)) if footholds.feet else None

    def track(self, footholds: Footholds, leg: float, weights: Weights, across: float = HARD) -> Track:
        """Return edges to given footholds.

        Args:
            footholds: of F feet over T frames.
            leg: length of the robot's leg [m].
            weights: π of swings.
            across: π across the floor of soles that stand.
        """
        ends = [
            (f"{foot} sole {corner}", "foothold") for foot in footholds.feet for corner in CORNER_NAMES for _ in AXES
        ]
        held = np.where(footholds.held[..., None], [HARD, HARD, across], 0.0)
        stands = np.asarray(footholds.held.any(axis=2))[:, :, None, None]
        priority = np.where(stands, held, weights.swing).reshape(len(footholds.places), -1)
        places = footholds.places.reshape(len(footholds.places), -1)
        edges = exact(self, ends, places, priority, leg, axes=AXES * (len(ends) // len(AXES)))
        return replace(edges, upper=(footholds.places + _up(footholds.rises)).reshape(places.shape))

    def measure(self, track: Track, body: SymbolicRobot) -> ca.SX:
        """Where the corners are, x y z of one after the other [m]."""
        found = []
        for sole, _ in track.ends[:: len(AXES)]:
            foot, corner = sole.split(" sole ")
            found.append(body.corners(foot)[CORNER_NAMES.index(corner)])
        return ca.vertcat(*found)

    def step(self, context: StreamFrame, memory: dict[str, Any]) -> FrameTargets:
        """Return the footholds where the robot put its soles down, and the swing references to the human's path."""
        if not memory:
            memory["footholds"] = CausalFootholds(context.calibration, self.across(context), self.backlash)
        return memory["footholds"].at(context)

    def for_robot(self) -> "FootholdKind":
        """Return the kind for stances that are known exactly."""
        return replace(self, known=True)

    def grounded(self, track: Track, grounding: Grounding) -> Track:
        """Return the footholds without free fall."""
        return grounding.lowered(track)

    def played(self, track: Track, measured: Measures, frames: PlaybackFrames) -> Track:
        """Return the places and the grip of a playback's plan."""
        return replace(track, lower=frames.soles, upper=frames.soles, priority=frames.grip)

    def unbalanced(self, track: Track) -> Track:
        """Return targets of feet that swing with the human's shape, and that land a frame earlier where stances are not known exactly."""
        return replace(track if self.known else self._landed(track), kind=replace(self, pivots=True))

    def _landed(self, track: Track) -> Track:
        """Return targets of feet that land a frame earlier, so that they do not slide into place as they begin to stand."""
        stood = self._held(track)
        feet = ~stood[:-1].any(axis=2) & stood[1:].any(axis=2)
        lands = np.repeat(np.repeat(feet, len(CORNER_NAMES), axis=1), len(AXES), axis=1)
        lower, upper, priority = track.lower.copy(), track.upper.copy(), track.priority.copy()
        for side in (lower, upper, priority):
            side[:-1][lands] = side[1:][lands]
        return replace(track, lower=lower, upper=upper, priority=priority)

    def coarse(self, track: Track) -> Track:
        """Return targets that lay standing soles on the floor, at any place."""
        priority = track.priority.reshape(len(track.priority), -1, len(AXES)).copy()
        priority[~self._held(track).reshape(len(priority), -1)] = 0.0
        priority[..., :2] = 0.0
        priority[..., 2] = np.minimum(priority[..., 2], self.laid)
        return replace(track, priority=priority.reshape(track.priority.shape))

    def solved(self, track: Track, measured: Measures, fixed: int = 0, unreached: Bools | None = None) -> Track:
        """Return footholds where the legs put the feet; fixed frames stay."""
        planned = self._held(track)
        corners = measured[self.name].reshape(*planned.shape, len(AXES))
        plan = track.lower.reshape(corners.shape)
        planes = [_plane(before) for before in plan.swapaxes(0, 1)]
        headings = self._headings(planned, plan, corners) if self.pivots else [None] * len(planes)
        held, places = planned, _places(planned, corners, fixed, planes, headings)
        if self.frees and unreached is not None:
            away = np.linalg.norm((corners - places)[..., :2], axis=-1).mean(axis=2)
            held = without_unreachable(planned, away, unreached, fixed)
            places = _standing(planned & ~held, held, places, _places(held, corners, fixed, planes, headings))
        if self.pivots:
            places[fixed:] = _lifted(places, plan, planned)[fixed:]
        if self.known and np.median(np.abs(corners - plan).max(axis=3)[planned]) < self.met:
            places = plan
        places = places.reshape(track.lower.shape)
        priority = np.where((planned & ~held)[..., None], self.freed, track.priority.reshape(*held.shape, len(AXES)))
        upper = places + np.where(
            np.repeat(held, len(AXES), axis=-1).reshape(track.lower.shape), track.upper - track.lower, 0.0
        )
        return replace(track, lower=places, upper=upper, priority=priority.reshape(track.lower.shape))

    def _headings(self, held: np.ndarray, plan: Floats, corners: Floats) -> list[Floats]:
        """Return the heading (T,) of each foot with which its stances turn [rad].

        It is halfway between the human's and that of the robot's leg: a foot goes where its knee points, which a straight leg
        leaves open. A foot that points up or down counts as much as it shows along the floor.

        Args:
            held: (T, F, 4) which corners stand.
            plan: (T, F, 4, 3) corners read off the human [m].
            corners: (T, F, 4, 3) corners on the coarse path [m].
        """
        shown, sole = lengths(corners), np.linalg.norm(lengths(plan), axis=-1, keepdims=True)
        ahead = unit(lengths(plan)) + shown / np.maximum(sole, 1e-9)
        return [settled_heading(held[:, k], ahead[:, k], self.backlash) for k in range(held.shape[1])]

    @staticmethod
    def _held(track: Track) -> np.ndarray:
        """Return (T, F, 4) which corners stand."""
        along = track.priority[:, :: len(AXES)] >= HARD
        return along.reshape(len(along), -1, len(CORNER_NAMES))

    def across(self, context: RetargetContext) -> float:
        """π across the floor of soles that stand."""
        moves = carrying(context.robot.model)
        sites, soles = context.match.anatomy.sites, context.match.anatomy.soles
        pelvis = moves[sites["pelvis"].body] if "pelvis" in sites else moves[context.robot.root_body]
        hinges = [int((moves[sole.bodies[0]] & ~pelvis).sum()) for sole in soles.values()]
        laid = HARD if min(hinges, default=6) >= 6 else self.tilting
        return laid if context.scene is None else min(laid, self.on_bodies)


def _up(heights: Floats) -> Floats:
    """Return heights (…) as vectors (…, 3) [m]."""
    return heights[..., None] * [0.0, 0.0, 1.0]


def _places(
    held: np.ndarray,
    corners: Floats,
    fixed: int,
    planes: Sequence[Surface | None],
    headings: Sequence[Floats | None],
) -> Floats:
    """Return (T, F, 4, 3) places of feet on their planes, from which corners stand and corners on the coarse path [m]."""
    places = [
        foothold_corners(held[:, k], corners[:, k], fixed, plane, heading)
        for k, (plane, heading) in enumerate(zip(planes, headings, strict=True))
    ]
    return np.stack(places, axis=1)


def _standing(freed: np.ndarray, held: np.ndarray, stances: Floats, places: Floats) -> Floats:
    """Return places (T, F, 4, 3) in which freed feet step from their last place to their next one; a foot without either keeps its stance.

    Args:
        freed: (T, F, 4) corners that are freed.
        held: (T, F, 4) corners that stand.
        stances: (T, F, 4, 3) places with no foot freed [m].
        places: (T, F, 4, 3) places with the freed feet in swing [m].
    """
    places = places.copy()
    for k in range(places.shape[1]):
        for start, stop in intervals(np.asarray(freed[:, k].any(axis=1))):
            beside = [t for t in (start - 1, stop) if 0 <= t < len(places) and held[t, k].any()]
            ends = [places[t, k] for t in beside] or [stances[t, k] for t in (start, stop - 1)]
            way = smoothstep(np.arange(1, stop - start + 1) / (stop - start + 1))[:, None, None]
            places[start:stop, k] = ends[0] + way * (ends[-1] - ends[0])
    return places


def _lifted(places: Floats, plan: Floats, held: np.ndarray) -> Floats:
    """Return places (T, F, 4, 3) with no corner of a swing foot (held: (T, F, 4)) lower than the plan's foot, which the human lifts."""
    lifted, least = places.copy(), plan[..., 2].min(axis=2, keepdims=True)
    swings = ~held.any(axis=2, keepdims=True)
    lifted[..., 2] = np.where(swings, np.maximum(places[..., 2], least), places[..., 2])
    return lifted


def _plane(corners: Floats) -> Surface | None:
    """Return the surface under a foot's corners (T, 4, 3); None for the floor."""
    if not corners[..., 2].any():
        return None
    middle = corners.mean(axis=1)
    normal = unit(np.cross(corners[:, 0] - corners[:, 3], corners[:, 1] - corners[:, 2]))
    return Surface(middle, normal * np.sign(normal[:, 2:]), np.zeros_like(middle))
