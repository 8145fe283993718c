"""Footholds of a stream: a sole stands where the robot put it down, with the heading that it had; in swing it returns to the human's path."""

from itertools import product
from math import inf, pi

import numpy as np

from robot_retarget.base.arrays import Bools, Floats, bearing, smoothstep
from robot_retarget.graph.footholds import Surface, surface_under
from robot_retarget.graph.kind import RetargetContext, StreamFrame
from robot_retarget.graph.soles import HEEL, TOE, Soles, flattened, lengths, raised, soles_of, turned
from robot_retarget.graph.track import HARD
from robot_retarget.graph.weights import RAMP

STRAYED = 0.2
"""A foot has stepped if the human moves it farther than this from its foothold, over the leg [-]."""
BLENDED = 0.3
"""A swing foot loses the offset of its foothold within this time [s]."""
SWERVE = 0.7
"""A foothold that heads away from the human's foot by more than this turns towards it [rad] ..."""
CLOSING = 2.0
"""... with this angular speed: at once, a turn of the whole body would follow [rad/s]."""
Stance = tuple[bool, bool]
"""Whether the front corners of a sole stand, and the rear ones."""
STANCES: dict[Stance, Bools] = {
    (toe, heel): np.repeat([toe, heel], 2) for toe, heel in product((False, True), repeat=2)
}
"""(4,) which corners stand."""
SWING: Stance = (False, False)


class CausalFootholds:
    """The edges of one robot's soles; F feet."""

    soles: Soles
    swing: float

    def __init__(self, context: RetargetContext, across: float, backlash: float):
        """Map the soles of a calibrated performer.

        Args:
            across: π across the floor of soles that stand.
            backlash: by which a foot heads away from its foothold before this turns with it [rad].
        """
        self.soles, self.backlash = soles_of(context.human, context.match, context.robot), backlash
        count = len(self.soles.feet)
        self.hard, self.swing = np.array([HARD, HARD, across]), context.weights.swing
        self.held: list[Stance] = [SWING] * count
        self.places: Floats = np.zeros_like(self.soles.corners)
        self.offset, self.landed = np.zeros_like(self.places), np.zeros_like(self.places)
        self.height: Floats = np.zeros(self.places.shape[:2])
        """Height of corners over their foothold at touchdown [m]."""
        self.strayed: float = STRAYED * context.leg
        self.since: list[float] = [inf] * count
        """Time since a foot last touched down or rose [s]."""

    def at(self, frame: StreamFrame) -> tuple[Floats, Floats, Floats]:
        """Return the intervals of corners (F · 4 · 3) [m], and π."""
        human, feet = frame.human, self.soles.feet
        carried, surfaces = self.soles.places(human)[0], [None] * len(feet)
        if frame.scene is not None:
            surfaces = [surface_under(human, frame.scene, foot) for foot in feet]
            carried += np.stack([surface.shift for surface in surfaces])
        away, turns = np.abs(carried - self.landed).max(axis=(1, 2)).tolist(), self._turns(carried, frame.seconds)
        priority = np.empty_like(carried)
        for k, foot in enumerate(feet):
            wanted = tuple(human.contacts[foot][0].tolist()) if foot in human.contacts else SWING
            stands = away[k] < self.strayed if any(self.held[k]) else self.since[k] >= RAMP
            self._change(k, wanted if stands else SWING, carried[k], frame, surfaces[k], turns[k])
            carried[k], priority[k] = self._standing(k) if any(self.held[k]) else self._swinging(k, carried[k])
        upper = carried
        if any(toe != heel for toe, heel in self.held):
            upper = carried.copy()
            upper[..., 2] += self.soles.rises(human, np.array([[STANCES[held] for held in self.held]]))[0]
        return carried.ravel(), upper.ravel(), priority.ravel()

    def _change(
        self, foot: int, held: Stance, carried: Floats, frame: StreamFrame, surface: Surface | None, turn: list[float]
    ) -> None:
        """Put a foot down, turn it with the human's, or let it rise.

        It stands only where the human has not moved it away from its foothold, and after it has just risen.
        """
        before, corners = self.held[foot], frame.corners[foot]
        self.held[foot] = held
        self.since[foot] = 0.0 if any(before) != any(held) else self.since[foot] + frame.seconds
        if any(held) and (before == SWING or any(b and not h for b, h in zip(before, held, strict=True))):
            heading = corners if surface is None else carried  # the human's foot heads along the edges of a body
            self.places[foot] = _come_down(corners, heading, STANCES[held], surface)
            self.landed[foot] = carried
            self.height[foot] = corners[:, 2] - self.places[foot, :, 2]
        elif any(held) and any(turn):
            corner = (TOE if held[0] else HEEL)[self.soles.feet[foot] == "l"]
            pair = np.stack([self.places[foot], self.landed[foot]])
            self.places[foot], self.landed[foot] = turned(pair, np.array(turn), corner)
        elif any(before):
            self.offset[foot] = corners - carried

    def _turns(self, carried: Floats, seconds: float) -> list[list[float]]:
        """Return by how much the foothold of each foot turns, and by how much of it with the human's foot [rad].

        A foothold turns with the human's foot, but for a backlash since the landing. It also turns towards the human's heading
        where the two differ by more than `SWERVE`. The axis is at the ball of the big toe, or at that side of the heel.
        """
        ahead = lengths(np.stack([carried, self.landed, self.places]))
        (now, begun, stands), (size, _, own) = bearing(ahead), np.hypot(ahead[..., 0], ahead[..., 1])
        turn = _beyond(now - begun, self.backlash * own / np.maximum(size, 1e-9))  # as in `settled_heading`
        closing = _beyond(now - stands - turn, SWERVE).clip(-CLOSING * seconds, CLOSING * seconds)
        return np.stack([turn + closing, turn], axis=1).tolist()

    def _standing(self, foot: int) -> tuple[Floats, Floats]:
        """Return the targets of a stance while the sole moves to the ground.

        π rises by equal factors over `RAMP`, from the geometric mean of a swing and a stance.
        """
        share, place = min(self.since[foot] / RAMP, 1.0), self.places[foot]
        if share < 1:
            place = place.copy()
            place[:, 2] += (1 - smoothstep(share)) * self.height[foot]
        return place, STANCES[self.held[foot]][:, None] * self._between((1 + share) / 2)

    def _swinging(self, foot: int, carried: Floats) -> tuple[Floats, Floats]:
        """Return the targets of a swing: the human's path, plus the decaying offset of the last foothold.

        π falls by equal factors over `RAMP`, from the geometric mean of a swing and a stance.
        """
        since = self.since[foot]
        if since < BLENDED:
            carried = carried + (1 - smoothstep(since / BLENDED)) * self.offset[foot]
        return carried, self._between((1 - min(since / RAMP, 1.0)) / 2)

    def _between(self, share: float) -> Floats:
        """Return π (3,) between a swing, share 0, and a stance, share 1, in equal factors."""
        return self.hard**share * self.swing ** (1 - share)


def _come_down(corners: Floats, heading: Floats, held: Bools, surface: Surface | None) -> Floats:
    """Return a foothold (4, 3) under corners (4, 3): flat, with the heading of other corners (4, 3), held corners in place.

    It is on the floor, or on a surface of one frame.
    """
    place = flattened(heading)
    place[:, :2] += (corners - place)[held, :2].mean(axis=0)
    return place if surface is None else raised(place, surface.places[0], surface.normals[0])


def _beyond(angle: Floats, slack: Floats | float) -> Floats:
    """Return how far angles (…) are beyond a slack either way, all between half turns [rad]."""
    away = (angle + pi) % (2 * pi) - pi
    return away - np.clip(away, -slack, slack)
