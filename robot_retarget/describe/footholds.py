"""Footholds: where on the floor each sole stands, and the swing reference in between.

Read off the human, the robot's ankle stands where the human's does, scaled by the leg and further out by as much as the
robot's hips are wider; its sole points where the human's foot points. Of a stance the middle of its frames counts. Between
two stances a swing foot follows its own way, shifted from the one foothold's offset to the next one's.
"""

from dataclasses import dataclass

import numpy as np

from robot_retarget.arrays import Floats, leftward, unit
from robot_retarget.describe.path import Carriage, carriage_of
from robot_retarget.describe.soles import CORNERS, HEEL, TOE, flattened, lengths, smoothstep, sole_corners
from robot_retarget.human.features import HumanFeatures
from robot_retarget.human.match import Match
from robot_retarget.human.segments import heading
from robot_retarget.motion.stance import intervals
from robot_retarget.robot import Points, Robot, world_points

LANDING = 0.1
"""A swing foot nears its reference more strongly for so long after its last stance and before its next one [s]."""


@dataclass(frozen=True, eq=False)
class Footholds:
    """Of F feet over T frames."""

    feet: tuple[str, ...]
    held: np.ndarray
    """(T, F, 4) which corners stand: the front ones while the toe does, the rear ones while the heel does."""
    places: Floats
    """(T, F, 4, 3) where corners stand, and where those of a swing foot should be [m]."""
    near: Floats
    """(T, F) how near in time a foot is to a stance: 1 in it, falling to 0 over `LANDING`."""


def footholds_of(human: HumanFeatures, match: Match, robot: Robot) -> Footholds:
    """The footholds of the matched feet; none of a robot that is bolted to the world."""
    feet = placed_feet(match, robot)
    held = np.zeros((len(human), len(feet), CORNERS), dtype=bool)
    places = np.zeros((*held.shape, 3))
    for k, foot in enumerate(feet):
        if foot in human.contacts:
            held[:, k, TOE], held[:, k, HEEL] = human.contacts[foot][:, :1], human.contacts[foot][:, 1:]
        places[:, k] = settled(held[:, k], sole_of(human, match, robot, foot).places(human))
    stands = np.asarray(held.any(axis=2))
    return Footholds(feet, held, places, nearing(stands, round(LANDING * human.fps)))


def placed_feet(match: Match, robot: Robot) -> tuple[str, ...]:
    """The feet of which both bodies have what tells where they are; none of a robot that is bolted to the world."""
    known, feet = set(match.keypoints), match.anatomy.soles if robot.root_joints.size else ()
    return tuple(foot for foot in feet if {"l_hip", "r_hip", f"{foot}_ankle"} <= known)


@dataclass(frozen=True, eq=False)
class Sole:
    """How the sole of one foot is carried over: its ankle by the leg, further out by as much as the robot's hips are wider."""

    foot: str
    carriage: Carriage
    hips: tuple[int, int]
    ankle: int
    wider: float
    """[m]"""
    corners: Floats
    """(4, 3) ahead of the ankle, to its left and up [m]."""

    def places(self, human: HumanFeatures) -> Floats:
        """(T, 4, 3) corners, turned as the human's foot [m]."""
        left, right, ankle = (human.positions[:, k] for k in (*self.hips, self.ankle))
        outward = leftward(heading(human.facing)) * (1 if self.foot == "l" else -1)
        places = self.carriage.path(human) + self.carriage.ratio * (ankle - (left + right) / 2)
        places[:, :2] += self.wider * outward
        turn = human.segments.get(f"{self.foot}_foot", human.facing)
        return places[:, None] + self.corners @ turn.swapaxes(1, 2)


def sole_of(human: HumanFeatures, match: Match, robot: Robot, foot: str) -> Sole:
    """What the whole of a motion tells of that."""
    left, right = (match.index(f"{side}_hip") for side in "lr")
    hip, corners = _hip_and_sole(robot, match, foot)
    apart = np.linalg.norm(human.positions[:, left] - human.positions[:, right], axis=1)
    wider = hip - match.leg_ratio * float(np.median(apart)) / 2
    return Sole(foot, carriage_of(human, match), (left, right), match.index(f"{foot}_ankle"), wider, corners)


def _hip_and_sole(robot: Robot, match: Match, foot: str) -> tuple[float, Floats]:
    """Half the width of the hips [m], and (4, 3) the corners of a sole ahead of its ankle, to the left and up [m]; standing."""
    spots, corners = match.anatomy.spots, sole_corners(match.anatomy, foot)
    named = [spots[k] for k in ("l_hip", "r_hip", f"{foot}_ankle")]
    points = Points(
        np.append([spot.body for spot in named], corners.bodies),
        np.vstack([*(spot.offset for spot in named), corners.offsets]),
    )
    left, right, ankle, *sole = world_points(robot, points, robot.standing()[None])[0]
    along = np.array(sole) - ankle
    ahead = unit(lengths(along))
    own = np.column_stack([along[:, :2] @ ahead, along[:, :2] @ leftward(ahead), along[:, 2]])
    return float(np.linalg.norm((left - right)[:2])) / 2, own


def relaxed(held: np.ndarray, corners: Floats, reach: float, fixed: int = 0) -> np.ndarray:
    """Free both feet while the robot's legs cannot put them on their footholds together.

    The legs put the feet to `corners` by themselves. Footholds that differ from these by more than `reach`, after the best
    common shift and turn, ask for another placement of one foot relative to the other than the legs can give.

    Args:
        held: (T, F, 4) which corners stand.
        corners: (T, F, 4, 3) where the legs put the corners [m].
        reach: [m].
        fixed: number of frames at the beginning that stay as they are.

    Returns:
        (T, F, 4) which corners stand.
    """
    held = held.copy()
    while True:
        places = np.stack([settled(held[:, k], corners[:, k], fixed) for k in range(held.shape[1])], axis=1)
        both = np.flatnonzero(np.asarray(held.any(axis=2)).sum(axis=1) > 1)
        apart = [t for t in both if t >= fixed and _misfit(corners[t][held[t]], places[t][held[t]]) > reach]
        if not apart:
            return held
        held[apart] = False


def _misfit(corners: Floats, places: Floats) -> float:
    """Return the largest distance between points (N, 3) along the floor after the best common shift and turn [m]."""
    a, b = ((x[:, 0] + 1j * x[:, 1]) - (x[:, 0] + 1j * x[:, 1]).mean() for x in (corners, places))
    turn = (a.conj() * b).sum()
    return float(np.abs(a * turn / max(abs(turn), 1e-12) - b).max())


def settled(held: np.ndarray, corners: Floats, fixed: int = 0) -> Floats:
    """(T, 4, 3) one foot at its footholds while it stands, on its swing reference while it does not [m].

    Args:
        held: (T, 4) which corners stand.
        corners: (T, 4, 3) where a foot goes by itself [m]: of a stance the middle counts, of a swing its shape.
        fixed: so many frames at the beginning stay as they are, and a stance that began in them where it was.
    """
    stands, places = np.asarray(held.any(axis=1)), corners.copy()
    for start, stop in intervals(stands):
        known = slice(start, min(fixed, stop) if start < fixed else stop)
        whole = np.asarray(held[known].all(axis=1))
        seen = corners[known][whole if whole.any() else slice(None)]
        pose = median_pose(seen)
        places[start:stop] = flattened(pose) if held[start:stop].all(axis=1).any() else _edges_down(pose)
    stands[:fixed] = True
    places[~stands] += _blended(stands, places - corners)[~stands]
    return places


def median_pose(corners: Floats) -> Floats:
    """Return corners (4, 3) of one rigid sole that fits a stance: median place, heading and pitch of corners (N, 4, 3) [m].

    Medians are taken in axes along the mean heading, so that a stance turned about the vertical gives the same pose, turned.
    """
    pitch = corners[:, TOE, 2].mean(axis=1) - corners[:, HEEL, 2].mean(axis=1)
    typical = corners[np.argsort(pitch, kind="stable")[len(pitch) // 2]]
    headings, middles = unit(lengths(corners)), corners.mean(axis=1)
    mean = unit(headings.sum(axis=0))
    axes = np.stack([mean, leftward(mean)])
    angle = float(np.median(np.arctan2(headings @ axes[1], headings @ axes[0])))
    ahead = np.array([np.cos(angle), np.sin(angle)]) @ axes
    start, middle = unit(lengths(typical)), typical.mean(axis=0)
    turn = np.stack([start, leftward(start)]).T @ np.stack([ahead, leftward(ahead)])
    pose = typical - middle
    pose[:, :2] = pose[:, :2] @ turn + middles[0, :2] + np.median((middles - middles[0])[:, :2] @ axes.T, axis=0) @ axes
    pose[:, 2] += np.median(middles[:, 2])
    return pose


def _edges_down(corners: Floats) -> Floats:
    """Corners (4, 3) of a sole on its toes or heels: either edge on the floor, where it is and as wide as it is."""
    down = corners.copy()
    for edge in (TOE, HEEL):
        width = np.linalg.norm(corners[edge[0]] - corners[edge[1]]) / 2
        across = unit((corners[edge[0]] - corners[edge[1]]) * [1.0, 1.0, 0.0])
        middle = corners[edge].mean(axis=0) * [1.0, 1.0, 0.0]
        down[edge] = middle + width * across, middle - width * across
    return down


def _blended(stands: np.ndarray, offset: Floats) -> Floats:
    """(T, 4, 3) in swing, from the offset of the stance before to that of the next, at rest at both ends."""
    known, frames = np.flatnonzero(stands), np.arange(len(stands))
    if not known.size:
        return np.zeros_like(offset)
    after = np.searchsorted(known, frames)
    first, last = known[np.maximum(after - 1, 0)], known[np.minimum(after, len(known) - 1)]
    share = smoothstep(np.clip((frames - first) / np.maximum(last - first, 1), 0.0, 1.0))[:, None, None]
    return (1 - share) * offset[first] + share * offset[last]


def nearing(stands: np.ndarray, frames: int) -> Floats:
    """(T, F) 1 while feet stand, falling by squares to 0 over so many frames before and after."""
    count = np.arange(len(stands))[:, None]
    before = np.where(stands, count, -np.inf)
    after = np.where(stands, count, np.inf)
    since = count - np.maximum.accumulate(before, axis=0)
    until = np.minimum.accumulate(after[::-1], axis=0)[::-1] - count
    return np.square(np.clip(1 - np.minimum(since, until) / (frames + 1), 0.0, 1.0))
