"""Soles: the human's feet as soles of the robot, the heading of corners, and their flat placement on the floor."""

from dataclasses import dataclass

import numpy as np

from robot_retarget.base.arrays import Floats, Ints, bearing, leftward, unit
from robot_retarget.contact.rule import JOINTS
from robot_retarget.graph.placed_scene import RootScaling, root_scaling_of
from robot_retarget.human.features import HumanFeatures
from robot_retarget.human.match import Match
from robot_retarget.robot import Points, Robot, world_points
from robot_retarget.robot.support import CORNERS, sole_corners

TOE, HEEL = [0, 1], [2, 3]
_LEFT, _RIGHT = [0, 2], [1, 3]


def lengths(corners: Floats) -> Floats:
    """Return (…, 2) vectors from mid-heel to mid-toes of soles (…, 4, 3), along the floor [m]."""
    xy = corners[..., :2]
    return (xy[..., 0, :] + xy[..., 1, :] - xy[..., 2, :] - xy[..., 3, :]) / 2


def heading(soles: Floats) -> Floats:
    """Return the common heading (…) of F soles (…, F, 4, 3), from x towards y [rad]."""
    return bearing(lengths(soles).sum(axis=-2))


def flattened(corners: Floats) -> Floats:
    """Return corners (…, 4, 3) laid flat on the floor: same middle, same heading, same shape."""
    middle = corners.mean(axis=-2, keepdims=True)
    ahead = unit(lengths(corners))[..., None, :]
    left = leftward(ahead)
    length, width = (
        np.linalg.norm(corners[..., one, :] - corners[..., other, :], axis=-1).mean(axis=-1)[..., None, None] / 2
        for one, other in ((TOE, HEEL), (_LEFT, _RIGHT))
    )
    signs = np.array([[1, 1], [1, -1], [-1, 1], [-1, -1]])
    flat = middle[..., :2] + signs[:, :1] * length * ahead + signs[:, 1:] * width * left
    return np.concatenate([flat, np.zeros((*flat.shape[:-1], 1))], axis=-1)


def laid(corners: Floats, place: Floats, normal: Floats) -> Floats:
    """Return corners (4, 3) laid flat on a plane, with the heading and the middle they have seen from above; as `raised`."""
    return raised(flattened(corners), place, normal)


def turned(corners: Floats, angle: Floats, corner: int) -> Floats:
    """Return corners (T, 4, 3) turned about the vertical through one of them.

    Args:
        angle: (T,) from x towards y [rad].
        corner: the one that stays.
    """
    away = corners[..., :2] - corners[:, [corner], :2]
    cos, sin = np.cos(angle)[:, None, None], np.sin(angle)[:, None, None]
    level = corners[:, [corner], :2] + cos * away + sin * leftward(away)
    return np.concatenate([level, corners[..., 2:]], axis=2)


def raised(corners: Floats, place: Floats, normal: Floats) -> Floats:
    """Return corners (…, 4, 3) on the floor moved straight up to a plane.

    Args:
        place: (3,) a point of the plane [m].
        normal: (3,) its unit normal, pointing up.
    """
    height = place[2] - (corners[..., :2] - place[:2]) @ normal[:2] / normal[2]
    return corners + height[..., None] * [0.0, 0.0, 1.0]


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
        """Return (T, F, 3, 3) the axes of the human's feet; an unknown foot is level and heads as the body does."""
        return np.stack([human.segments.get(f"{foot}_foot", human.level) for foot in self.feet], axis=1)


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


def placed_feet(match: Match, robot: Robot) -> tuple[str, ...]:
    """Return the feet with hips and ankle on both bodies; empty for a robot with a fixed base."""
    known, feet = set(match.keypoints), match.anatomy.soles if robot.root_joints.size else ()
    return tuple(foot for foot in feet if {"l_hip", "r_hip", f"{foot}_ankle"} <= known)
