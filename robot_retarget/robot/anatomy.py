"""The anatomy of a robot: keypoints, segment orientations and soles; left and right."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import mujoco
import numpy as np

from robot_retarget.base.arrays import ALIGNED, Floats, Ints, frozen
from robot_retarget.base.keypoints import KEYPOINTS, mirrored
from robot_retarget.robot.kinematics import Points, carrying
from robot_retarget.robot.model import Robot

# The anatomy of a robot: keypoints, segment orientations and soles.

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


def positive_senses(robot: Robot) -> dict[str, str]:
    """Return in words where each joint's positive sense moves the middle of its links; the robot stands and faces +x."""
    data, found = mujoco.MjData(robot.model), {}
    data.qpos[:] = robot.standing()
    mujoco.mj_forward(robot.model, data)
    for name, joint in zip(robot.joint_names, robot.joint_ids, strict=True):
        arm = data.subtree_com[robot.model.jnt_bodyid[joint]] - data.xanchor[joint]
        way = np.cross(data.xaxis[joint], arm)
        k = int(np.abs(way).argmax())
        words = (("backward", "forward"), ("right", "left"), ("down", "up"))[k]
        found[name] = words[int(way[k] > 0)] if np.abs(way[k]) > 1e-3 else "around its axis"
    return found


# Left and right of a robot: points made symmetric, and the counterpart of every hinge.

# Symmetrize points measured on meshes.
#
# The joint axes of most robots mirror each other exactly; their meshes differ by tenths of a millimetre and more. Toes, hands,
# head and soles are measured on meshes, so each is replaced by the mean of itself and its mirror image. A motion and its
# mirror image then pose the same problem. Sides that differ by more stay unchanged.

SLIGHT = 0.02
"""Sides that differ by less than this share of the body, or of the foot, are symmetrized, and hinges whose mirrored
lines do are counterparts [-]: of eight robots half moves one head by 3 mm, and double nothing."""


def symmetric_places(places: Mapping[str, Floats], left: Floats) -> dict[str, Floats]:
    """Return keypoints (3,) [m], each the mean of itself and of the mirror image of its counterpart.

    Args:
        left: (3,) unit vector from the right to the left.
    """
    paired = [k for k in places if mirrored(k) != k and mirrored(k) in places]
    if not paired:
        return dict(places)
    middle = float(np.median([places[k] @ left for k in paired]))
    size = float(np.ptp(np.array(list(places.values())), axis=0).max())
    found = {}
    for keypoint, place in places.items():
        seen = places.get(mirrored(keypoint), place)
        image = seen + 2 * (middle - seen @ left) * left
        found[keypoint] = (place + image) / 2 if np.linalg.norm(image - place) < SLIGHT * size else place
    return found


def symmetric_soles(clouds: Mapping[str, Floats], ankles: Mapping[str, Floats], left: Floats) -> dict[str, Floats]:
    """Return the points of both feet (P, 3) [m], each joined with the mirror image of the other foot.

    Args:
        clouds: per foot `l`, `r` points of its surface in the standing pose.
        ankles: per foot (3,), the origin of its mirror image [m].
    """
    if len(clouds) < 2:
        return dict(clouds)
    own = {side: clouds[side] - ankles[side] for side in "lr"}
    image = {a: own[b] - 2 * (own[b] @ left)[:, None] * left for a, b in ("lr", "rl")}
    ends = [np.array([cloud.min(axis=0), cloud.max(axis=0)]) for cloud in (own["l"], image["l"])]
    if np.abs(ends[0] - ends[1]).max() > SLIGHT * np.ptp(ends[0], axis=0).max():
        return dict(clouds)
    return {side: ankles[side] + np.vstack([own[side], image[side]]) for side in "lr"}


# Reflection of a robot in its sagittal plane: counterpart and sign of every hinge.


@dataclass(frozen=True)
class Mirror:
    """The reflection in the sagittal plane, hinge by hinge."""

    partner: Ints
    """(n,) counterpart on the other side; a hinge in the middle is its own, −1 marks a hinge without a counterpart."""
    sign: Floats
    """(n,) mirrored angle of the partner = sign · angle."""
    left: Floats
    """(3,) the robot's left in the frame of its root body."""

    @property
    def whole(self) -> bool:
        """Whether every hinge has a counterpart."""
        return bool((self.partner >= 0).all())

    def angles(self, angles: Floats) -> Floats:
        """Return the hinge angles (…, n) of the mirrored robot [rad]; hinges without a counterpart are 0."""
        other, sign = self._seen
        return angles[..., other] * sign

    @cached_property
    def _seen(self) -> tuple[Ints, Floats]:
        """Return the source of every mirrored angle, and its sign: 0 for a hinge without a counterpart."""
        other = np.maximum(self.partner, 0)
        return other, np.where(self.partner >= 0, self.sign[other], 0.0)


def mirror_of(robot: Robot, left: Floats) -> Mirror:
    """Find the counterpart of each hinge from its line and direction in the reference pose.

    A rotation by θ about the axis a through p becomes, in the mirror M = 1 − 2 ℓℓᵀ, one by θ about −M a through M p.

    Args:
        left: (3,) unit vector, the robot's left at `qpos0`, in world coordinates.
    """
    data = mujoco.MjData(robot.model)
    mujoco.mj_kinematics(robot.model, data)
    plane = np.eye(3) - 2 * np.outer(left, left)
    middle, size = data.xpos[robot.root_body], float(np.ptp(data.xpos[1:], axis=0).max())
    place, axis = data.xanchor[robot.joint_ids] - middle, data.xaxis[robot.joint_ids]
    gap, turn = (place @ plane)[:, None] - place, -(axis @ plane) @ axis.T
    along = np.abs((gap * axis).sum(axis=2)) / size
    across = np.linalg.norm(gap - (gap * axis).sum(axis=2, keepdims=True) * axis, axis=2) / size
    fit = np.where((across < SLIGHT) & (np.abs(turn) > ALIGNED), across + along, np.inf)
    best, rows = fit.argmin(axis=1), np.arange(len(fit))
    found = np.isfinite(fit[rows, best]) & (best[best] == rows)
    own = data.xmat[robot.root_body].reshape(3, 3).T @ left
    return Mirror(np.where(found, best, -1), np.where(found, np.sign(turn[rows, best]), 0.0), own)
