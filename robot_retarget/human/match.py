"""Match of human and robot: shared keypoints, their tree, and the bone lengths of both bodies."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from robot_retarget.base.arrays import Floats, Ints, bearing, frozen, leftward
from robot_retarget.base.errors import MatchError, known
from robot_retarget.base.keypoints import KEYPOINTS, parent_indices, parents_within
from robot_retarget.base.untrusted.documents import read_toml
from robot_retarget.human.motion import Motion
from robot_retarget.human.recognition import Recognition, apply_override
from robot_retarget.robot import Anatomy, Points, Robot, recognise_with, world_points

# Distances of a body, normalised by the path of bones between two joints [Mucherino2017, §II].
#
#     τ_uv = Σ δ over the bones of the path P_uv,    D̄_uv = ‖x_u − x_v‖ / τ_uv,
#     π_uv = (|P_max| − |P_uv| + 2) / |P_max|,       |P| counts the vertices of the path.
#
# D̄ is 1 on a bone and 1 elsewhere only for a stretched limb; contact is 0.

NEAR = 0.35
"""Two points at this share of the path between them are half near [-]: hands in a clap are nearer, stretched limbs farther. In 2 s of a clap the
limbs of the OP3 are off by 13.88° with half and 14.11° with double (14.02), and the jerk is 176 and 120 rad/s³."""


def paths(parents: ArrayLike) -> NDArray[np.bool_]:
    """(V, V, V): whether the bone above joint b lies on the path from u to v."""
    up = np.asarray(parents, dtype=np.int64)
    above = np.zeros((len(up), len(up)), dtype=bool)
    for joint in range(len(up)):
        if up[joint] >= 0:
            above[joint] = above[up[joint]]
            above[joint, joint] = True
    return above[:, None] ^ above[None]


def path_weights(parents: ArrayLike, lengths: ArrayLike) -> Floats:
    """τ (V, V), the length of the path between every two joints [m].

    Args:
        parents: (V,) index of each joint's parent, −1 at the root.
        lengths: (V,) distance of each joint to its parent [m].
    """
    return paths(parents) @ np.asarray(lengths, dtype=np.float64)


def normalised_distances(positions: ArrayLike, parents: ArrayLike, lengths: ArrayLike) -> Floats:
    """D̄ (…, V, V) of postures (…, V, K), with 0 on the diagonal.

    Args:
        positions: (…, V, K) [m].
        parents: (V,) index of each joint's parent, −1 at the root.
        lengths: (V,) distance of each joint to its parent [m].
    """
    x = np.asarray(positions, dtype=np.float64)
    tau = path_weights(parents, lengths)
    distance = np.linalg.norm(x[..., :, None, :] - x[..., None, :, :], axis=-1)
    return np.divide(distance, tau, out=np.zeros_like(distance), where=tau > 0)


def path_priorities(parents: ArrayLike) -> Floats:
    """π (V, V): 1 on a bone, 2/|P_max| on the longest path; 0 on the diagonal."""
    vertices = paths(parents).sum(axis=2) + 1
    longest = vertices.max()
    priority = (longest - vertices + 2) / longest
    np.fill_diagonal(priority, 0.0)
    return priority


TABLES = ("human", "robot")
LEGS = (0.1, 2.0)
"""Lengths of a leg that a body can have [m]; others are refused: those of a newborn are 0.17, those of the tallest man on record 1.3."""


@dataclass(frozen=True)
class Match:
    """Which joint answers to which point, and how long the bones between are on either body."""

    recognition: Recognition
    anatomy: Anatomy
    keypoints: tuple[str, ...]
    """The keypoints that both bodies have, parents first."""
    parents: Ints
    """(K,) index of each keypoint's parent among them, −1 at the root."""
    human_bones: Floats
    robot_bones: Floats
    """(K,) length of the bone to the parent, 0 at the root [m]; the robot's in its reference pose."""
    rest: Floats
    """(K, 3) where the robot's keypoints are in its reference pose [m]."""
    ankle_height: float
    """Height of the robot's ankles above its level soles [m]; 0 for a robot without legs."""

    def __repr__(self) -> str:
        return f"<Match of {len(self.keypoints)} keypoints: {', '.join(self.keypoints[:4])} …>"

    @property
    def points(self) -> Points:
        """The robot's points, in the order of `keypoints`."""
        return self.anatomy.points_of(self.keypoints)

    def index(self, keypoint: str) -> int:
        """Return the index of a keypoint in the arrays."""
        return self.keypoints.index(keypoint)

    def named(self, x: Floats) -> dict[str, Floats]:
        """Return the keypoints (T, 3) of an array (T, K, 3) by name."""
        return {keypoint: x[:, k] for k, keypoint in enumerate(self.keypoints)}

    def human_positions(self, motion: Motion) -> Floats:
        """Return (T, K, 3) the human's keypoints [m]."""
        return self.weights(len(motion.skeleton)) @ motion.positions

    def weights(self, joints: int) -> Floats:
        """Return (K, J) shares of the human's joints in the keypoints."""
        return self.recognition.weights(self.keypoints, joints)

    @cached_property
    def human_paths(self) -> Floats:
        """(K, K) τ_uv, length of the path of the human's bones between two keypoints [m]; ∞ in place of 0."""
        tau = path_weights(self.parents, self.human_bones)
        return np.where(tau > 0, tau, np.inf)

    def figure(self, motion: Motion) -> tuple[Floats, Ints]:
        """Return all keypoints of the human (T, H, 3) [m] and the pairs (B, 2) that a bone joins, for drawing."""
        own = self.recognition.keypoints
        bones = [(own.index(child), own.index(parent)) for child, parent in parents_within(own).items()]
        return self.recognition.place(motion.positions), np.array(bones)

    def heading(self, x: Floats) -> Floats:
        """Return (T,) how far the hip line of keypoints (T, K, 3) is turned about z from y, positive to the left [rad]; 0 without hips."""
        if not {"l_hip", "r_hip"} <= set(self.keypoints):
            return np.zeros(len(x))
        left = x[:, self.index("l_hip")] - x[:, self.index("r_hip")]
        return bearing(-leftward(left))

    def among(self, keypoints: tuple[str, ...], human: Floats, robot: Floats) -> "Match":
        """Return the match of some keypoints; its bones have the lengths of the places (T, K, 3) of human and robot [m]."""
        parents = parent_indices(keypoints)
        bones = {"human_bones": bone_lengths(human, parents), "robot_bones": bone_lengths(robot, parents)}
        rest = self.rest[[self.index(keypoint) for keypoint in keypoints]]
        return replace(self, keypoints=keypoints, parents=parents, rest=frozen(rest), **bones)

    def _leg(self, bones: Floats) -> float:
        """Thigh and shin of a body, the mean of both legs, or all its bones where one of the bodies has no legs [m]."""
        legs = [f"{side}_{k}" for side in "lr" for k in ("knee", "ankle")]
        own = [self.index(k) for k in legs if k in self.keypoints]
        sides = len({self.keypoints[k][0] for k in own})
        return float(bones[own].sum()) / sides if own else float(bones.sum())

    @cached_property
    def human_leg(self) -> float:
        """The human's leg [m]."""
        return self._leg(self.human_bones)

    @cached_property
    def robot_leg(self) -> float:
        """The robot's leg [m]: the length that makes errors dimensionless."""
        return self._leg(self.robot_bones)

    @property
    def leg_ratio(self) -> float:
        """Robot leg over human leg."""
        return self.robot_leg / self.human_leg

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes about doubtful keypoints of both bodies."""
        return (*self.recognition.notes, *self.anatomy.notes)


def match(motion: Motion, robot: Robot, overrides: str | Path | None = None) -> Match:
    """Find the keypoints of both bodies.

    Args:
        overrides: a TOML file with tables `[human]` (keypoint = "Joint") and `[robot]`
            (keypoint = ["body", x, y, z], forward = [x, y, z]) that replace any line of the map.

    Raises:
        MatchError: the motion is not human, the robot is no humanoid, an override names an unknown joint or
            body, or the two share too few keypoints.
    """
    tables = read_map(Path(overrides)) if overrides is not None else {}
    recognition = recognition_with(motion, tables.get("human", {}))
    anatomy = recognise_with(robot, tables.get("robot", {}))
    return match_bodies(motion, robot, recognition, anatomy)


def recognition_with(motion: Motion, table: Mapping[str, Any]) -> Recognition:
    """Return the keypoints of a motion, given the table `[human]` of a map file.

    A table that names every keypoint is used even without a recognised body.

    Args:
        table: keypoint → name of a joint, or several names, for the mean of their joints.

    Raises:
        MatchError: Nothing is recognised and the table lacks a keypoint, or it names an unknown joint.
    """
    try:
        found = motion.recognition
    except MatchError as error:
        if not table.keys() >= set(KEYPOINTS):
            raise
        found = Recognition({}, (f"{error}; the map, which names every keypoint, is used",))
    return apply_override(found, motion.skeleton, table)


def match_bodies(motion: Motion, robot: Robot, recognition: Recognition, anatomy: Anatomy) -> Match:
    """Join two recognised bodies.

    Args:
        motion: the human.
        recognition: keypoints of the human.
        anatomy: the robot's keypoints.

    Raises:
        MatchError: they share fewer than two bones, or the legs of the human are longer or shorter than any.
    """
    shared = tuple(k for k in KEYPOINTS if k in recognition.marks and k in anatomy.sites)
    if len(parents_within(shared)) < 2:
        raise MatchError(
            f"{motion.source or 'the motion'} and {robot.name} share only {', '.join(shared) or 'nothing'}: "
            "nothing to retarget"
        )
    parents = parent_indices(shared)
    exact = recognition.ankle_height is not None
    measured = motion.skeleton.rest()[None] if exact else motion.clip.positions
    human = recognition.weights(shared, len(motion.skeleton)) @ measured
    points = anatomy.points_of(shared)
    rest = world_points(robot, points, robot.neutral()[None])
    source = bone_lengths(human, parents)
    found = Match(
        recognition,
        anatomy,
        shared,
        parents,
        human_bones=source,
        robot_bones=bone_lengths(rest, parents),
        rest=frozen(rest[0]),
        ankle_height=anatomy.ankle_height,
    )
    if not exact and not LEGS[0] <= found.human_leg <= LEGS[1]:
        raise MatchError(
            f"{motion.source or 'the motion'}: legs of {found.human_leg:.3g} m, where a body has {LEGS[0]:g} to {LEGS[1]:g} m: "
            "positions are in metres; read_motion finds the unit of a file"
        )
    return found


def bone_lengths(positions: Floats, parents: Ints) -> Floats:
    """Return the median lengths (K,) of the bones to the parents, 0 at the root [m]; positions are (T, K, 3).

    Args:
        positions: (T, K, 3) keypoints [m].
        parents: (K,) index of each keypoint's parent, −1 at the root.
    """
    lengths = np.where(parents >= 0, np.linalg.norm(positions - positions[:, parents], axis=2), 0.0)
    return frozen(np.median(lengths, axis=0))


def read_map(path: Path) -> Mapping[str, Mapping[str, Any]]:
    """The tables `[human]` and `[robot]` of a map file.

    Raises:
        MatchError: it is not TOML, or has another table.
    """
    tables = read_toml(path, MatchError)
    for key, table in tables.items():
        if key not in TABLES:
            raise MatchError(f"{path}: unknown table [{key}]; {known(TABLES, typed=key)}")
        if not isinstance(table, dict):
            raise MatchError(f"{path}: {key} must be a table, [{key}], got {table!r}")
    return tables
