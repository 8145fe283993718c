"""Footholds: the place of each standing sole on the floor, and the swing reference between stances.

The robot's ankle stands where the human's does, scaled by the leg and moved outward by half the difference of the hip
widths; its sole points where the human's foot points. The foothold of a stance is the median of its frames. Between two
stances a swing foot follows its own path, with an offset that changes from one foothold's to the next one's.
"""

from dataclasses import dataclass
from itertools import product
from math import inf, pi

import numpy as np

from robot_retarget.base.arrays import Bools, Floats, bearing, intervals, leftward, smoothstep, unit
from robot_retarget.graph.kind import RetargetContext, StreamFrame
from robot_retarget.graph.placed_scene import PlacedScene, placed_scene
from robot_retarget.graph.soles import HEEL, TOE, Soles, flattened, lengths, placed_feet, raised, soles_of, turned
from robot_retarget.graph.track import HARD
from robot_retarget.graph.weights import RAMP
from robot_retarget.human.features import HumanFeatures
from robot_retarget.human.match import Match
from robot_retarget.robot import Robot
from robot_retarget.robot.support import CORNERS
from robot_retarget.scene.scene import as_pose, composed, inverse

FREED_EARLIER = 2
"""Frames by which the step of a freed foot begins earlier and ends later than the feet are out of reach. Half and
double change neither a dance of the G1 nor a boxing OP3."""


@dataclass(frozen=True, eq=False)
class Footholds:
    """Footholds of F feet over T frames."""

    feet: tuple[str, ...]
    held: np.ndarray
    """(T, F, 4) which corners stand: the front ones while the toe does, the rear ones while the heel does."""
    places: Floats
    """(T, F, 4, 3) places of standing corners, and targets of a swing foot's corners [m]."""
    rises: Floats
    """(T, F, 4) largest heights of standing corners over their places [m]."""


def footholds_of(
    human: HumanFeatures, match: Match, robot: Robot, backlash: float = np.inf, known: bool = False
) -> Footholds:
    """Return the footholds of the matched feet; empty for a robot with a fixed base.

    Args:
        backlash: by which a foot heads away from its foothold before this turns with it [rad].
        known: whether soles are exact, as a robot's are: a stance then keeps its rolling and slipping.
    """
    feet = placed_feet(match, robot)
    held = np.zeros((len(human), len(feet), CORNERS), dtype=bool)
    places = np.zeros((*held.shape, 3))
    if not feet:
        return Footholds(feet, held, places, np.zeros(held.shape))
    soles, scene = soles_of(human, match, robot), placed_scene(human, match)
    ways = soles.places(human) if known else soles.lifted(human)
    for k, foot in enumerate(feet):
        held[:, k, TOE], held[:, k, HEEL] = np.split(human.contacts.of(foot), 2, axis=1)
        corners = ways[:, k]
        if known and scene is None:
            places[:, k] = corners
            continue
        heading = settled_heading(held[:, k], lengths(corners), backlash)
        if scene is None:
            places[:, k] = foothold_corners(held[:, k], corners, heading=heading)
            continue
        surface = surface_under(human, scene, foot)
        corners = corners + surface.shift[:, None]
        places[:, k] = foothold_corners(held[:, k], corners, surface=surface, heading=heading)
    rises = np.zeros(held.shape) if known and scene is None else soles.rises(human, held)
    return Footholds(feet, held, places, rises)


@dataclass(frozen=True, eq=False)
class Surface:
    """The surface under one foot in the robot's world, over T frames."""

    places: Floats
    """(T, 3) a point of it [m]."""
    normals: Floats
    """(T, 3) pointing up."""
    shift: Floats
    """(T, 3) from where the scaled path puts that point to where the body has it; 0 on the floor and on bodies that are
    scaled with the human [m]."""

    def over(self, frames: slice) -> tuple[Floats, Floats]:
        """Return point and normal of the plane of a stance: those of its median height."""
        middle = frames.start + int(np.argsort(self.places[frames, 2], kind="stable")[len(self.places[frames]) // 2])
        return self.places[middle], self.normals[middle]


def surface_under(human: HumanFeatures, scene: PlacedScene, foot: str) -> Surface:
    """Return the surface under a foot: that of its toe or ankle, the one nearer to the ground.

    Args:
        human: features of T frames, with a scene.
        scene: its bodies in the robot's world.
        foot: `l` or `r`.
    """
    assert human.around is not None
    ground, frames = human.around.ground, np.arange(len(human))
    own = [k for k, name in enumerate(ground.keypoints) if name[0] == foot]
    column = np.array(own)[ground.places[:, own, 2].argmax(axis=1)]
    place, normal, body = ground.places[frames, column], ground.normals[frames, column], ground.bodies[frames, column]
    scaled = scene.ratio * (place - [*scene.origin, 0.0])
    poses = scene.poses(len(human))[frames, body]
    local = composed(inverse(human.around.scene.poses(len(human))[frames, body]), as_pose(place))[:, :3]
    on_body = composed(poses, as_pose(scene.size * local))[:, :3]
    found = np.where((body >= 0)[:, None], on_body, scaled)
    return Surface(found, normal, found - scaled)


def without_unreachable(held: np.ndarray, away: Floats, unreached: Bools, fixed: int = 0) -> np.ndarray:
    """Free one foot while the robot's legs do not put both feet on their footholds together.

    The foot that is farther from its foothold steps from its place before to its place afterwards.

    Args:
        held: (T, F, 4) which corners stand.
        away: (T, F) distances of the feet on the coarse path from their footholds [m].
        unreached: (T,) frames at which footholds are out of reach.
        fixed: number of frames at the start that keep their value.

    Returns:
        (T, F, 4) which corners stand.
    """
    held = held.copy()
    apart = unreached & (np.asarray(held.any(axis=2)).sum(axis=1) > 1)
    apart[:fixed] = False
    for start, stop in intervals(apart):
        held[max(start - FREED_EARLIER, fixed) : stop + FREED_EARLIER, away[start:stop].mean(axis=0).argmax()] = False
    return held


def foothold_corners(
    held: np.ndarray, corners: Floats, fixed: int = 0, surface: Surface | None = None, heading: Floats | None = None
) -> Floats:
    """Return (T, 4, 3) corners of one foot: at its footholds in stance, on its swing reference otherwise [m].

    A foothold keeps its place, and turns about its stillest corner as the heading does. A swing then keeps the shape of the sole;
    without a heading, as balance plans stances, the sole also stays nearly flat.

    Args:
        held: (T, 4) which corners stand.
        corners: (T, 4, 3) corners without footholds [m]: a stance uses their median, a swing their shape.
        fixed: number of frames at the start that stay unchanged; a stance that began there keeps its place.
        surface: the surface under the foot; None for the floor.
        heading: (T,) of the foot [rad]; by default the foothold does not turn, and its sole swings flat.
    """
    stands, places = np.asarray(held.any(axis=1)), corners.copy()
    for start, stop in intervals(stands):
        known = slice(start, min(fixed, stop) if start < fixed else stop)
        whole = np.asarray(held[known].all(axis=1))
        turn = np.zeros(stop - start) if heading is None else heading[start:stop] - heading[start]
        still = _stillest(corners[start:stop], held[start:stop])
        seen = turned(corners[known], -turn[: known.stop - start], still)[whole if whole.any() else slice(None)]
        pose = median_pose(seen)
        flat = flattened(pose) if held[start:stop].all(axis=1).any() else _edges_down(pose)
        place = turned(np.broadcast_to(flat, (stop - start, *flat.shape)), turn, still)
        places[start:stop] = place if surface is None else raised(place, *surface.over(slice(start, stop)))
    stands[:fixed] = True
    offset = places - corners
    if heading is not None:
        bears = np.where(held.any(axis=1, keepdims=True), held, True)[..., None]
        offset = (offset * bears).sum(axis=1, keepdims=True) / bears.sum(axis=1, keepdims=True)
    places[~stands] += _blended(stands, offset)[~stands]
    return places


def settled_heading(held: np.ndarray, ahead: Floats, backlash: float) -> Floats:
    """Return the heading (T,) of a foot that turns in stance only where it heads away by more than a backlash [rad].

    Soles that roll over their toes, and noise, turn no foothold. A foot that points up or down shows little of its heading:
    the backlash grows as its length along the floor falls.

    Args:
        held: (T, 4) which corners stand.
        ahead: (T, 2) from the heel to the toes along the floor, in any unit.
        backlash: of a level foot [rad].
    """
    heading, size = np.unwrap(bearing(ahead)), np.linalg.norm(ahead, axis=1)
    slack = backlash * size.max() / np.maximum(size, 1e-9)
    for start, stop in intervals(np.asarray(held.any(axis=1))):
        lower, upper = heading[start:stop] - slack[start:stop], heading[start:stop] + slack[start:stop]
        kept = float(np.median(heading[start:stop]))
        for t, ends in enumerate(zip(lower, upper, strict=True), start):
            kept = heading[t] = min(max(kept, ends[0]), ends[1])
    return heading


def _stillest(corners: Floats, held: np.ndarray) -> int:
    """Return the corner of (T, 4, 3) that moves least over the floor, of those held (T, 4) for the longest time."""
    moves = np.linalg.norm(np.diff(corners[..., :2], axis=0), axis=-1).sum(axis=0)
    often = held.sum(axis=0)
    return int(np.where(often == often.max(), moves, np.inf).argmin())


def median_pose(corners: Floats) -> Floats:
    """Return corners (4, 3) of one rigid sole that fits a stance: median place, heading and pitch of corners (N, 4, 3) [m].

    Medians are taken in axes along the mean heading, so that a stance turned about the vertical gives the same pose, turned.
    """
    pitch = corners[:, TOE, 2].mean(axis=1) - corners[:, HEEL, 2].mean(axis=1)
    typical = corners[np.argsort(pitch, kind="stable")[len(pitch) // 2]]
    headings, middles = unit(lengths(corners)), corners.mean(axis=1)
    mean = unit(headings.sum(axis=0))
    axes = np.stack([mean, leftward(mean)])
    angle = float(np.median(bearing(headings @ axes.T)))
    ahead = np.array([np.cos(angle), np.sin(angle)]) @ axes
    start, middle = unit(lengths(typical)), typical.mean(axis=0)
    turn = np.stack([start, leftward(start)]).T @ np.stack([ahead, leftward(ahead)])
    pose = typical - middle
    pose[:, :2] = pose[:, :2] @ turn + middles[0, :2] + np.median((middles - middles[0])[:, :2] @ axes.T, axis=0) @ axes
    pose[:, 2] += np.median(middles[:, 2])
    return pose


def _edges_down(corners: Floats) -> Floats:
    """Return corners (4, 3) of a sole on its toes or heels: both edges on the floor, with their place and width."""
    down = corners.copy()
    for edge in (TOE, HEEL):
        width = np.linalg.norm(corners[edge[0]] - corners[edge[1]]) / 2
        across = unit((corners[edge[0]] - corners[edge[1]]) * [1.0, 1.0, 0.0])
        middle = corners[edge].mean(axis=0) * [1.0, 1.0, 0.0]
        down[edge] = middle + width * across, middle - width * across
    return down


def _blended(stands: np.ndarray, offset: Floats) -> Floats:
    """Return (T, C, 3) offsets in swing, from the last stance's to the next one's, with zero slope at both ends.

    Args:
        stands: (T,) whether the foot stands.
        offset: (T, C, 3) of its corners, or the mean of those that bear it: a raised heel is not drawn to the floor [m].
    """
    known, frames = np.flatnonzero(stands), np.arange(len(stands))
    if not known.size:
        return np.zeros_like(offset)
    after = np.searchsorted(known, frames)
    first, last = known[np.maximum(after - 1, 0)], known[np.minimum(after, len(known) - 1)]
    share = smoothstep(np.clip((frames - first) / np.maximum(last - first, 1), 0.0, 1.0))[:, None, None]
    return (1 - share) * offset[first] + share * offset[last]


# Footholds of a stream: a sole stands where the robot put it down, with the heading that it had; in swing it returns to the human's path.

STRAYED = 0.2
"""A foot has stepped if the human moves it farther than this from its foothold, over the leg [-]. In streams of a clap and a
kick on the G1 and the OP3 half moves the OP3 by 0.2 rad at most, double nothing."""
BLENDED = 0.3
"""A swing foot loses the offset of its foothold within this time [s]. Half and double change the limb errors of streams of a
clap and a kick on the G1 and the OP3 by 0.02°."""
SWERVE = 0.7
"""A foothold that heads away from the human's foot by more than this turns towards it [rad] (half and double change the limb
errors of streams of a clap and a kick on the G1 and the OP3 by 0.1° at most) ..."""
CLOSING = 2.0
"""... with this angular speed: at once, a turn of the whole body would follow [rad/s]. Half and double change them by 0.1° at
most."""
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
            wanted = tuple(human.contacts.of(foot)[0].tolist())
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
