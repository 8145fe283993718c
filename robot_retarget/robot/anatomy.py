"""The anatomy of a robot: keypoints, segment orientations and soles."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from robot_retarget.base.arrays import Floats, Ints, frozen
from robot_retarget.base.keypoints import KEYPOINTS
from robot_retarget.robot.kinematics import Points, carrying
from robot_retarget.robot.model import Robot

SURE, LIKELY, GUESSED, UNSURE = 0.95, 0.75, 0.5, 0.3
"""Confidence in a keypoint: where axes meet, a name agrees or a surface ends; by geometry alone; on a robot without that
part; on a finger or gripper [-]."""


@dataclass(frozen=True)
class KeypointSite:
    """A keypoint of a robot: a point fixed to a body."""

    body: int
    offset: Floats
    """(3,) in the body's frame [m]."""
    confidence: float
    """0 … 1."""
    evidence: str

    def __post_init__(self) -> None:
        object.__setattr__(self, "offset", frozen(self.offset))


@dataclass(frozen=True)
class Anatomy:
    """The keypoints, segments and soles of a robot."""

    sites: Mapping[str, KeypointSite]
    """Keypoints by name; those the robot lacks are absent."""
    frames: Mapping[str, tuple[int, Floats]]
    """Segments (pelvis, chest, head, feet, hands that turn any way, arms' links where a source shows them): body, and (3, 3)
    its local forward, left and up as columns."""
    soles: Mapping[str, Points]
    """Per foot (`l`, `r`) the points, seen or felt, that can be its lowest."""
    treads: Mapping[str, Points]
    """Per foot the points of its solid surface on which it stands flat: what carries the robot."""
    forward: Floats
    """(3,) where the robot looks in its reference pose."""
    notes: tuple[str, ...]

    @cached_property
    def points(self) -> Points:
        """All keypoints in the order of `names`."""
        return self.points_of(self.names)

    def points_of(self, keypoints: Sequence[str]) -> Points:
        """Some keypoints, in their order."""
        sites = [self.sites[k] for k in keypoints]
        return Points(np.array([s.body for s in sites]), np.array([s.offset for s in sites]))

    @cached_property
    def names(self) -> tuple[str, ...]:
        """The keypoints the robot has, in the vocabulary's order."""
        return tuple(k for k in KEYPOINTS if k in self.sites)

    @cached_property
    def ankle_height(self) -> float:
        """Mean height of the ankles above their level soles [m]; 0 without feet."""
        heights = []
        for side, sole in self.soles.items():
            up = self.frames[f"{side}_foot"][1][:, 2]
            heights.append(float(self.sites[f"{side}_ankle"].offset @ up - (sole.offsets @ up).min()))
        return float(np.mean(heights)) if heights else 0.0

    @property
    def missing(self) -> tuple[str, ...]:
        """The keypoints the robot lacks."""
        return tuple(k for k in KEYPOINTS if k not in self.sites)


def limb_hinges(robot: Robot, anatomy: Anatomy, end: str) -> Ints:
    """Which hinges are those of an arm or of the neck: they move the hand or head and not the chest.

    Args:
        anatomy: the robot's keypoints.
        end: keypoint at the end of the limb.
    """
    sites, moves = anatomy.sites, carrying(robot.model)[:, robot.dof_index]
    still = moves[sites["chest"].body] if "chest" in sites else np.zeros(moves.shape[1], dtype=bool)
    return np.flatnonzero(moves[sites[end].body] & ~still)


LIMBS = {"left_arm": "l_hand", "right_arm": "r_hand", "left_leg": "l_ankle", "right_leg": "r_ankle", "head": "head"}
"""Limbs by the keypoint at their end."""


def joints_by_limb(robot: Robot, anatomy: Anatomy) -> dict[str, tuple[str, ...]]:
    """The joints of each limb that the robot has, which move its end and no other limb's, fingers with their arm; the others
    as `torso`."""
    moves, bodies = carrying(robot.model)[:, robot.dof_index], robot.model.dof_bodyid[robot.dof_index]
    ends = {limb: moves[anatomy.sites[end].body] for limb, end in LIMBS.items() if end in anatomy.sites}
    moved = np.sum(list(ends.values()), axis=0)
    below = {limb: moves[bodies][:, hinges & (moved == 1)].any(axis=1) for limb, hinges in ends.items()}
    below["torso"] = ~np.any(list(below.values()), axis=0)
    return {limb: tuple(np.array(robot.joint_names)[which].tolist()) for limb, which in below.items() if which.any()}
