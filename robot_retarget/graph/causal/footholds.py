"""Footholds of a stream: a sole stands where the robot put it down; in swing it returns to the human's path."""

import numpy as np
from numpy.linalg import norm

from robot_retarget.arrays import Floats, bearing
from robot_retarget.graph.context import RetargetContext, StreamFrame
from robot_retarget.graph.footholds import Sole, Surface, placed_feet, sole_of, surface_under
from robot_retarget.graph.soles import HEEL, TOE, flattened, lengths, raised, turned
from robot_retarget.graph.track import HARD
from robot_retarget.graph.weights import RAMP, Weights
from robot_retarget.human.features import HumanFeatures
from robot_retarget.ramps import smoothstep
from robot_retarget.robot.feet import CORNERS

STRAYED = 0.2
"""A foot has stepped if the human moves it farther than this from its foothold, over the leg [-]."""
BLENDED = 0.3
"""A swing foot loses the offset of its foothold within this time [s]."""


class CausalFootholds:
    """The edges of one robot's soles; F feet."""

    feet: tuple[str, ...]
    weights: Weights
    offset: Floats
    landed: Floats

    def __init__(self, context: RetargetContext, across: float, backlash: float):
        """Map the soles of a calibrated performer.

        Args:
            across: π across the floor of soles that stand.
            backlash: by which a foot heads away from its foothold before this turns with it [rad].
        """
        feet = placed_feet(context.match, context.robot)
        self.soles: list[Sole] = [sole_of(context.human, context.match, context.robot, foot) for foot in feet]
        self.feet, self.weights = feet, context.weights
        self.hard: Floats = np.array([HARD, HARD, across])
        self.held: Floats = np.zeros((len(feet), CORNERS), dtype=bool)
        self.places: Floats = np.zeros((len(feet), CORNERS, 3))
        self.backlash = backlash
        self.offset, self.landed = np.zeros_like(self.places), np.zeros_like(self.places)
        self.height: Floats = np.zeros((len(feet), CORNERS))
        """Height of corners over their foothold at touchdown [m]."""
        self.strayed: float = STRAYED * context.leg
        self.since: Floats = np.full(len(feet), np.inf)
        """Time since a foot last touched down or rose [s]."""

    def at(self, frame: StreamFrame) -> tuple[Floats, Floats, Floats]:
        """Return the intervals of corners (F · 4 · 3) [m], and π."""
        human, corners, seconds = frame.human, frame.corners, frame.seconds
        target, priority = np.empty_like(self.places), np.zeros((len(self.feet), CORNERS, 3))
        upper = np.empty_like(self.places)
        for k, sole in enumerate(self.soles):
            surface = None if frame.scene is None else surface_under(human, frame.scene, sole.foot)
            carried = sole.places(human)[0] + (0.0 if surface is None else surface.shift[0])
            held = self._stands(human, sole.foot) & self._still(k, carried)
            stood_before, stands = bool(self.held[k].any()), bool(held.any())
            self.since[k] = 0.0 if stood_before != stands else self.since[k] + seconds
            if stands and not (stood_before and held[self.held[k]].all()):
                self.places[k], self.landed[k] = _come_down(corners[k], carried, held, surface), carried
                self.height[k] = corners[k, :, 2] - self.places[k, :, 2]
            elif stands:
                self._turn(k, carried, held)
            if stood_before and not stands:
                self.offset[k] = corners[k] - carried
            self.held[k] = held
            target[k], priority[k] = self._standing(k) if stands else self._swinging(k, carried)
            upper[k] = target[k]
            upper[k, :, 2] += sole.rises(human, held[None])[0]
        return target.ravel(), upper.ravel(), priority.ravel()

    def _stands(self, human: HumanFeatures, foot: str) -> np.ndarray:
        held, schedule = np.zeros(CORNERS, dtype=bool), human.contacts.get(foot)
        if schedule is not None:
            held[TOE], held[HEEL] = schedule[0]
        return held

    def _still(self, foot: int, carried: Floats) -> bool:
        """Whether a foot may stand: the human has not moved it away from its foothold, and it has not just risen."""
        if self.held[foot].any():
            return bool(np.abs(carried - self.landed[foot]).max() < self.strayed)
        return bool(self.since[foot] >= RAMP)

    def _turn(self, foot: int, carried: Floats, held: np.ndarray) -> None:
        """Turn the foothold about the ball of the big toe, or that side of the heel, as far as the human's foot heads away."""
        away = bearing(lengths(carried)) - bearing(lengths(self.landed[foot]))
        away = (away + np.pi) % (2 * np.pi) - np.pi
        level, shown = (float(norm(lengths(sole))) for sole in (self.places[foot], carried))
        slack = self.backlash * level / max(shown, 1e-9)  # as in `settled_heading`
        turn = away - np.clip(away, -slack, slack)
        if turn:
            corner = (TOE if held[TOE].any() else HEEL)[self.feet[foot] == "l"]
            pair = np.stack([self.places[foot], self.landed[foot]])
            self.places[foot], self.landed[foot] = turned(pair, np.full(2, turn), corner)

    def _standing(self, foot: int) -> tuple[Floats, Floats]:
        """Return the targets of a stance while the sole moves to the ground.

        π rises by equal factors over `RAMP`, from the geometric mean of a swing and a stance.
        """
        share = min(self.since[foot] / RAMP, 1.0)
        place = self.places[foot].copy()
        place[:, 2] += (1 - smoothstep(np.array(share))) * self.height[foot]
        return place, np.where(self.held[foot][:, None], self._between((1 + share) / 2), 0.0)

    def _swinging(self, foot: int, carried: Floats) -> tuple[Floats, Floats]:
        """Return the targets of a swing: the human's path, plus the decaying offset of the last foothold.

        π falls by equal factors over `RAMP`, from the geometric mean of a swing and a stance.
        """
        share = min(self.since[foot] / RAMP, 1.0)
        left = 1 - smoothstep(np.minimum(self.since[foot] / BLENDED, 1.0))
        return carried + left * self.offset[foot], self._between((1 - share) / 2)

    def _between(self, share: float) -> Floats:
        """Return π (3,) between a swing, share 0, and a stance, share 1, in equal factors."""
        return self.hard**share * self.weights.swing ** (1 - share)


def _come_down(corners: Floats, carried: Floats, held: np.ndarray, surface: Surface | None) -> Floats:
    """Return a foothold (4, 3) under corners (4, 3): flat, headed as the human's foot (4, 3), held corners in place.

    It is on the floor, or on a surface of one frame.
    """
    place = flattened(carried)
    place[:, :2] += (corners - place)[held, :2].mean(axis=0)
    return place if surface is None else raised(place, surface.places[0], surface.normals[0])
