"""Footholds: the place of each standing sole on the floor, and the swing reference between stances.

The robot's ankle stands where the human's does, scaled by the leg and moved outward by half the difference of the hip
widths; its sole points where the human's foot points. The foothold of a stance is the median of its frames. Between two
stances a swing foot follows its own path, with an offset that changes from one foothold's to the next one's.
"""

from dataclasses import dataclass

import numpy as np

from robot_retarget.base.arrays import Bools, Floats, Ints, bearing, intervals, leftward, smoothstep, unit
from robot_retarget.contact.rule import JOINTS
from robot_retarget.graph.path import RootScaling, root_scaling_of
from robot_retarget.graph.placed_scene import PlacedScene, placed_scene
from robot_retarget.graph.soles import HEEL, TOE, flattened, lengths, raised, turned
from robot_retarget.human.features import HumanFeatures
from robot_retarget.human.match import Match
from robot_retarget.robot import Points, Robot, world_points
from robot_retarget.robot.support import CORNERS, sole_corners
from robot_retarget.scene.scene import as_pose, composed, inverse

STEP = 2
"""Frames by which the step of a freed foot begins earlier and ends later than the feet are out of reach."""


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


def footholds_of(human: HumanFeatures, match: Match, robot: Robot, backlash: float = np.inf) -> Footholds:
    """Return the footholds of the matched feet; empty for a robot with a fixed base.

    Args:
        backlash: by which a foot heads away from its foothold before this turns with it [rad].
    """
    feet = placed_feet(match, robot)
    held = np.zeros((len(human), len(feet), CORNERS), dtype=bool)
    places = np.zeros((*held.shape, 3))
    if not feet:
        return Footholds(feet, held, places, np.zeros(held.shape))
    soles, scene = soles_of(human, match, robot), placed_scene(human, match)
    ways = soles.lifted(human)
    for k, foot in enumerate(feet):
        if foot in human.contacts:
            held[:, k, TOE], held[:, k, HEEL] = human.contacts[foot][:, :1], human.contacts[foot][:, 1:]
        corners = ways[:, k]
        heading = settled_heading(held[:, k], lengths(corners), backlash)
        if scene is None:
            places[:, k] = foothold_corners(held[:, k], corners, heading=heading)
            continue
        surface = surface_under(human, scene, foot)
        corners = corners + surface.shift[:, None]
        places[:, k] = foothold_corners(held[:, k], corners, surface=surface, heading=heading)
    return Footholds(feet, held, places, soles.rises(human, held))


def placed_feet(match: Match, robot: Robot) -> tuple[str, ...]:
    """Return the feet with hips and ankle on both bodies; empty for a robot with a fixed base."""
    known, feet = set(match.keypoints), match.anatomy.soles if robot.root_joints.size else ()
    return tuple(foot for foot in feet if {"l_hip", "r_hip", f"{foot}_ankle"} <= known)


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


@dataclass(frozen=True, eq=False)
class Soles:
    """Map the soles of F feet: scale each ankle by the leg, and move it outward by half the hip widths' difference."""

    feet: tuple[str, ...]
    root_scaling: RootScaling
    hips: Ints
    """(2,) left and right among the keypoints."""
    ankles: Ints
    """(F,)"""
    leftward: Floats
    """(F, 1) by which the ankles move to the left of the body [m]."""
    corners: Floats
    """(F, 4, 3) corners relative to the ankles: ahead, to their left and up [m]."""
    tips: tuple[tuple[Floats, Floats], ...]
    """Per foot, points (P, 3) from the front corners on, and from the rear corners back: toes and heel are round [m]."""
    parts: Ints
    """(F, 2) toe and ankle among the keypoints."""
    rests: Floats
    """(F, 2) their heights over the ground in stance [m]; infinite for an unknown toe."""

    def places(self, human: HumanFeatures) -> Floats:
        """Return (T, F, 4, 3) corners with the rotations of the human's feet [m]."""
        x = human.positions
        middle = x.take(self.hips, axis=1).sum(axis=1, keepdims=True) / 2
        places = self.root_scaling.path(human)[:, None] + self.root_scaling.ratio * (
            x.take(self.ankles, axis=1) - middle
        )
        places[..., :2] += self.leftward * leftward(human.heading)[:, None]
        return places[:, :, None] + self.corners @ self._turns(human).swapaxes(2, 3)

    def lifted(self, human: HumanFeatures) -> Floats:
        """Return places (T, F, 4, 3) whose front corners are as high as the lower of the human's toe and heel, scaled, or higher [m].

        A sole does not bend at its toes, and reaches lower than a human's pitched foot.
        """
        corners = self.places(human)
        low = self.root_scaling.ratio * (human.positions[:, self.parts, 2] - self.rests).min(axis=2)
        corners[..., 2] += np.maximum(low - corners[:, :, TOE, 2].min(axis=2), 0.0)[..., None]
        return corners

    def rises(self, human: HumanFeatures, held: np.ndarray) -> Floats:
        """Return (T, F, 4) how high standing corners are while the pitched foot touches the ground with its tip [m].

        A round foot that stands on its toes or its heel alone touches the ground beyond their corners.

        Args:
            held: (T, F, 4) which corners stand.
        """
        up, found = unit(self._turns(human)[:, :, 2] * [1.0, 0.0, 1.0]), np.zeros(held.shape)
        for k, tips in enumerate(self.tips):
            for edge, other, tip in zip((TOE, HEEL), (HEEL, TOE), tips, strict=True):
                alone = held[:, k, edge] & ~held[:, k, other]
                lowest = (up[:, k] @ tip.T).min(axis=1, keepdims=True)
                found[:, k, edge] = alone * (up[:, k] @ self.corners[k, edge].T - lowest)
        return found

    def _turns(self, human: HumanFeatures) -> Floats:
        """Return (T, F, 3, 3) the axes of the human's feet."""
        return np.stack([human.segments.get(f"{foot}_foot", human.facing) for foot in self.feet], axis=1)


def soles_of(human: HumanFeatures, match: Match, robot: Robot) -> Soles:
    """Return the map of the soles of one or more placed feet, from a whole motion."""
    feet = placed_feet(match, robot)
    hips = np.array([match.index(f"{side}_hip") for side in "lr"])
    ankles = np.array([match.index(f"{foot}_ankle") for foot in feet])
    wide, points = zip(*(_hip_and_sole(robot, match, foot) for foot in feet), strict=True)
    left, right = human.positions[:, hips].swapaxes(0, 1)
    apart = match.leg_ratio * float(np.median(np.linalg.norm(left - right, axis=1))) / 2
    outward = [[(hip - apart) * (1 if foot == "l" else -1)] for hip, foot in zip(wide, feet, strict=True)]
    corners, tips = np.array([own[:CORNERS] for own in points]), tuple(_tips(own) for own in points)
    parts, rests = _parts(human, match, feet)
    return Soles(feet, root_scaling_of(human, match), hips, ankles, np.array(outward), corners, tips, parts, rests)


def _parts(human: HumanFeatures, match: Match, feet: tuple[str, ...]) -> tuple[Ints, Floats]:
    """Return toe and ankle (F, 2) of feet among the keypoints, and their heights over the ground in stance [m]; infinite for an unknown toe."""
    toes = [f"{foot}_toe" if f"{foot}_toe" in match.keypoints else f"{foot}_ankle" for foot in feet]
    parts = np.array([[match.index(toe), match.index(f"{foot}_ankle")] for toe, foot in zip(toes, feet, strict=True)])
    known = parts[:, 0] != parts[:, 1]
    toe, ankle = (JOINTS.floor_height(human.positions[:, part, 2]) for part in parts.T)
    over = np.where(known, toe - ankle, np.inf)
    return parts, human.ankle_height + np.column_stack([over, np.zeros(len(feet))])


def _tips(points: Floats) -> tuple[Floats, Floats]:
    """Return the points of a sole (P, 3), whose first are its corners, from the front corners on, and from the rear ones back."""
    corners, ahead = points[:CORNERS], points[:, 0]
    return points[ahead >= corners[TOE, 0].min()], points[ahead <= corners[HEEL, 0].max()]


def _hip_and_sole(robot: Robot, match: Match, foot: str) -> tuple[float, Floats]:
    """Return half the hip width [m], and points (P, 3) of the sole ahead of the ankle, to its left and up, standing [m].

    The first points are the corners.
    """
    sites, corners, sole = match.anatomy.sites, sole_corners(match.anatomy, foot), match.anatomy.soles[foot]
    named = [sites[k] for k in ("l_hip", "r_hip", f"{foot}_ankle")]
    points = Points(
        np.concatenate([[site.body for site in named], corners.bodies, sole.bodies]),
        np.vstack([*(site.offset for site in named), corners.offsets, sole.offsets]),
    )
    left, right, ankle, *own = world_points(robot, points, robot.standing()[None])[0]
    along = np.array(own) - ankle
    ahead = unit(lengths(along[:CORNERS]))
    turned = np.column_stack([along[:, :2] @ ahead, along[:, :2] @ leftward(ahead), along[:, 2]])
    return float(np.linalg.norm((left - right)[:2])) / 2, turned


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
        held[max(start - STEP, fixed) : stop + STEP, away[start:stop].mean(axis=0).argmax()] = False
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
