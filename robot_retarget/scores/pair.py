"""The keypoints of a human and of a robot, frame by frame: angles between their bones, and the angles that ranges of joints allow."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import mujoco
import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from robot_retarget.base.arrays import Bools, Floats, Ints, bearing, cross, leftward, unit
from robot_retarget.contact.record import ContactRecord
from robot_retarget.contact.rule import SOLES
from robot_retarget.contact.touch import HandTouches, hand_pairs, hand_touches
from robot_retarget.human.features import features_of
from robot_retarget.human.match import Match, match_bodies, path_weights, recognition_with
from robot_retarget.human.motion import Motion
from robot_retarget.robot import Anatomy, Points, Robot, override, recognise_with, world_points
from robot_retarget.robot.distances import LinkDistances
from robot_retarget.robot.dynamics import root_dofs
from robot_retarget.robot.kinematics import carrying
from robot_retarget.trajectory import Trajectory

PARTS = {"arms": ("elbow", "hand"), "trunk": ("chest",), "legs": ("knee", "ankle")}
"""The keypoints at the ends of the bones of each part."""


@dataclass(frozen=True, eq=False)
class Pair:
    """K keypoints that human and robot share, over T frames."""

    match: Match
    human: Floats
    """(T, K, 3) [m]."""
    robot: Floats
    """(T, K, 3) [m]."""
    contacts: ContactRecord | None = None
    """Which feet of the human are on the ground; None if it is not examined."""
    fps: float = 0.0
    """Frames per second [1/s]; 0 keeps touches of any duration."""
    model: Robot | None = None
    """The robot ..."""
    qpos: Floats = field(default_factory=lambda: np.zeros((0, 0)))
    """... in configurations (T, nq); without it, touches count by keypoints alone."""

    @cached_property
    def touches(self) -> HandTouches:
        """The touches of the human's hands, and which of them the robot keeps: by keypoints, or by surfaces that meet.

        The surfaces of thick hands meet while their keypoints are farther apart than the human's.
        """
        pairs = hand_pairs(self.match.keypoints)
        ends = np.array([[self.index(pair[k]) for pair in pairs] for k in range(2)], dtype=int)
        human, robot = self.closeness(*ends) if pairs else np.zeros((2, len(self.human), 0))
        found = hand_touches(pairs, human, robot, self.fps)
        lost = found.human & ~found.kept
        if self.model is None or not lost.any():
            return found
        frames, surfaces = lost.any(axis=1), LinkDistances(self.model, SOLES.enter_height * self.match.robot_leg)
        meet = surfaces.along(self.qpos[frames]) < surfaces.reach
        links = np.sort(np.asarray(self.model.model.body_weldid)[self.match.points.bodies[ends.T]])
        lost[frames] &= ((surfaces.links == links[:, None]).all(axis=2) @ meet.T > 0).T
        return replace(found, kept=found.kept | lost)

    @cached_property
    def seen(self) -> tuple[Floats, Floats]:
        """(T, K, 3) human and robot, each turned about z so that its hip line points along y [m]."""
        human, robot = (
            np.einsum("tij,tkj->tki", _about_z(-self.match.heading(x)), x) for x in (self.human, self.robot)
        )
        return human, robot

    @cached_property
    def turn(self) -> Floats:
        """(T, 3, 3) about z, from the heading of the human to that of the robot."""
        return _about_z(self.match.heading(self.robot) - self.match.heading(self.human))

    def has(self, *keypoints: str) -> bool:
        """Whether human and robot both have the keypoints."""
        return set(keypoints) <= set(self.match.keypoints)

    def index(self, keypoint: str) -> int:
        """The column of a keypoint."""
        return self.match.index(keypoint)

    def bone_angles(self, compared: Collection[str] = tuple(PARTS)) -> dict[str, Floats]:
        """Per bone of the compared `PARTS` (T,) the angle between the human's and the robot's, by the keypoint in which it ends [rad]."""
        index, parents = self.match.index, self.match.parents
        return {
            keypoint: angles_between(*(x[:, index(keypoint)] - x[:, parents[index(keypoint)]] for x in self.seen))
            for keypoint in compared_bones(self.match, compared)
        }

    def closeness(self, first: ArrayLike, second: ArrayLike) -> tuple[Floats, Floats]:
        """(T, P) distances between keypoints (P,) and (P,) over the paths between them, of the human and of the robot [-]."""
        ends, match = np.array([first, second]), self.match
        found = []
        for x, bones in ((self.human, match.human_bones), (self.robot, match.robot_bones)):
            distance = np.stack([np.linalg.norm(x[:, i] - x[:, j], axis=1) for i, j in ends.T], axis=1)
            found.append(distance / path_weights(match.parents, bones)[*ends])
        return found[0], found[1]


def compared_bones(match: Match, parts: Collection[str]) -> list[str]:
    """Return the bones of some `PARTS` that both bodies have, by the keypoint in which they end."""
    ends = {end for part in parts for end in PARTS[part]}
    both = zip(match.keypoints, match.parents.tolist(), strict=True)
    return [keypoint for keypoint, parent in both if parent >= 0 and keypoint.split("_")[-1] in ends]


def angles_between(one: Floats, other: Floats) -> Floats:
    """(…) the angles arccos(û · v̂) between vectors (…, 3) [rad]."""
    return np.arccos(np.clip((unit(one) * unit(other)).sum(axis=-1), -1.0, 1.0))


def _about_z(angles: Floats) -> Floats:
    return Rotation.from_euler("z", angles[:, None]).as_matrix()


MOMENTS = (2.0, 40)
"""The bound of a clip is found at this many moments a second, and at most at this many in all: angles vary slowly. Half
and double change the bounds of three clips on the OP3 by at most 1.1 and 0.7° (7.7 and 8.1 for 8.7° in a dance)."""
BOUND_STEPS = 25
"""Steps of a descent to the bound; angles change by less than 0.05° after 20 on the shipped clips."""
DRAWN = 6
"""Drawn starts, in addition to the played pose, the standing pose and the middle of the ranges: half and double give
the bounds of six clips to 0.1°."""
FLAT = 0.05
"""Angles below this count by their squares [rad]: the sum of angles has no slope at 0."""


def best_bone_angles(robot: Robot, match: Match, human: Floats, played: Floats, fps: float) -> dict[str, Floats]:
    """Return, per bone of `PARTS`, the angles (M,) to the human's that ranges of joints alone allow, at M moments [rad].

    Minimise Σ_b θ_b over the hinges, within their ranges, and the turn of the root. Gauss–Newton steps with reweighted chords
    descend from the played pose, the standing pose, and the middle of the ranges; the least sum counts. Balance, collisions,
    speeds, contacts and couplings of hinges are left out.

    Args:
        human: (T, K, 3) keypoints of the human [m].
        played: (T, nq) configurations.
        fps: frames per second [1/s].
    """
    bones = compared_bones(match, tuple(PARTS))
    if not bones or not len(human):
        return {}
    rate, most = MOMENTS
    count = int(np.clip(len(human) / fps * rate, 1, min(most, len(human))))
    at = np.round(np.linspace(0, len(human) - 1, count)).astype(int)
    pairs = np.array([(match.index(k), match.parents[match.index(k)]) for k in bones])
    seen = np.einsum("tij,tkj->tki", _about_z(-match.heading(human[at])), human[at])
    middle = np.array(robot.standing())
    ranged = np.isfinite(robot.upper - robot.lower)
    middle[robot.qpos_index[ranged]] = (robot.lower + robot.upper)[ranged] / 2
    low, high = np.maximum(robot.lower, -np.pi), np.minimum(robot.upper, np.pi)
    drawn = np.tile(robot.standing(), (DRAWN, 1))
    drawn[:, robot.qpos_index] = low + (high - low) * np.random.default_rng(0).random((DRAWN, len(low)))
    poses = [robot.standing(), middle, *drawn]
    starts = np.concatenate([played[at], *(np.tile(pose, (count, 1)) for pose in poses)])
    wanted = np.tile(unit(seen[:, pairs[:, 0]] - seen[:, pairs[:, 1]]), (len(poses) + 1, 1, 1))
    angles = _Descent(robot, match, pairs).run(starts, wanted).reshape(len(poses) + 1, count, -1)
    best = angles[angles.sum(axis=2).argmin(axis=0), np.arange(count)]
    return dict(zip(bones, best.T, strict=True))


class _Descent:
    """Descends from many configurations at once to the directions of bones."""

    def __init__(self, robot: Robot, match: Match, pairs: Ints):
        self._robot, self._pairs, self._points = robot, pairs, match.points
        hips = {"l_hip", "r_hip"} <= set(match.keypoints)
        self._hips = [match.index(k) for k in ("l_hip", "r_hip")] if hips else None
        self._dofs = np.concatenate([root_dofs(robot)[3:6] if robot.floating else [], robot.dof_index]).astype(int)
        self._free = len(self._dofs) - len(robot.dof_index)
        self._carried = carrying(robot.model)[match.points.bodies][:, self._dofs, None]
        self._trees = robot.model.body_rootid[robot.model.dof_bodyid[self._dofs]]
        self._data = mujoco.MjData(robot.model)

    def run(self, qpos: Floats, wanted: Floats) -> Floats:
        """Return angles (N, B) [rad] after the descent from qpos (N, nq) to unit directions (N, B, 3)."""
        q, damping = self._within(qpos), np.full(len(qpos), 1e-2)
        bones, slopes = self._bones(q)
        for k in range(BOUND_STEPS):
            error = bones - wanted
            flat = FLAT ** min(1.0, k / 12)
            weight = 1 / np.maximum(angles_between(bones, wanted), flat)
            gradient = np.einsum("nb,nbid,nbi->nd", weight, slopes, error)
            hessian = np.einsum("nb,nbid,nbie->nde", weight, slopes, slopes, optimize=True)
            stuck = self._stuck(q, gradient)
            gradient[stuck] = 0.0
            hessian[stuck] = 0.0
            hessian.swapaxes(1, 2)[stuck] = 0.0
            diagonal = np.arange(len(self._dofs))
            hessian[:, diagonal, diagonal] += damping[:, None] + stuck
            trial = self._moved(q, -np.linalg.solve(hessian, gradient[..., None])[..., 0])
            found, more = self._bones(trial)
            better = _flat_sum(angles_between(found, wanted), flat) < _flat_sum(angles_between(bones, wanted), flat)
            q[better], bones[better], slopes[better] = trial[better], found[better], more[better]
            damping = np.where(better, damping / 3, 4 * damping)
        return angles_between(bones, wanted)

    def _bones(self, qpos: Floats) -> tuple[Floats, Floats]:
        """Return unit directions of the bones (N, B, 3), seen from the hip line, and their slopes (N, B, 3, D)."""
        places, moves = self._moves(qpos)
        ends, starts = self._pairs.T
        vectors, slopes = places[:, ends] - places[:, starts], moves[:, ends] - moves[:, starts]
        if self._hips is not None:
            left, right = self._hips
            line, turn = places[:, left] - places[:, right], moves[:, left] - moves[:, right]
            heading = bearing(-leftward(line))
            rate = line[:, 0, None] * turn[:, 1] - line[:, 1, None] * turn[:, 0]
            rate /= np.maximum((line[:, :2] ** 2).sum(axis=1), 1e-12)[:, None]
            slopes = slopes - np.cross([0.0, 0.0, 1.0], vectors)[..., None] * rate[:, None, None]
            back = _about_z(-heading)
            vectors = np.einsum("nij,nbj->nbi", back, vectors)
            slopes = np.einsum("nij,nbjd->nbid", back, slopes)
        length = np.maximum(np.linalg.norm(vectors, axis=2, keepdims=True), 1e-9)
        directions = vectors / length
        along = np.einsum("nbi,nbid->nbd", directions, slopes)
        return directions, (slopes - directions[..., None] * along[:, :, None]) / length[..., None]

    def _moves(self, qpos: Floats) -> tuple[Floats, Floats]:
        """Return places (N, K, 3) [m] of the points and their Jacobians (N, K, 3, D): a dof moves what it carries by v + ω × (x − c)."""
        model, data, points = self._robot.model, self._data, self._points
        places, screws = np.empty((len(qpos), len(points), 3)), np.empty((len(qpos), len(self._dofs), 6))
        centres = np.empty((len(qpos), len(self._dofs), 3))
        for n, q in enumerate(qpos):
            data.qpos[:] = q
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)
            turned = data.xmat[points.bodies].reshape(-1, 3, 3) @ points.offsets[..., None]
            places[n] = data.xpos[points.bodies] + turned[..., 0]
            screws[n], centres[n] = data.cdof[self._dofs], data.subtree_com[self._trees]
        arms = places[:, :, None] - centres[:, None]
        moves = self._carried * (screws[:, None, :, 3:] + cross(screws[:, None, :, :3], arms))
        return places, moves.swapaxes(2, 3)

    def _within(self, qpos: Floats) -> Floats:
        robot, found = self._robot, np.array(qpos)
        found[:, robot.qpos_index] = np.clip(found[:, robot.qpos_index], robot.lower, robot.upper)
        return found

    def _stuck(self, qpos: Floats, gradient: Floats) -> Bools:
        """(N, D) whether a hinge is at an end of its range that the descent would leave."""
        robot, hinges = self._robot, qpos[:, self._robot.qpos_index]
        found = np.zeros(gradient.shape, dtype=bool)
        slope = gradient[:, self._free :]
        found[:, self._free :] = ((hinges <= robot.lower) & (slope > 0)) | ((hinges >= robot.upper) & (slope < 0))
        return found

    def _moved(self, qpos: Floats, step: Floats) -> Floats:
        found, velocity = np.array(qpos), np.zeros((len(qpos), self._robot.model.nv))
        velocity[:, self._dofs] = np.clip(step, -0.5, 0.5)
        for q, v in zip(found, velocity, strict=True):
            mujoco.mj_integratePos(self._robot.model, q, v, 1.0)
        return self._within(found)


def _flat_sum(angles: Floats, flat: float) -> Floats:
    """Return (N,) sums of angles (N, B); small angles count by their squares [rad]."""
    return np.where(angles < flat, angles**2 / (2 * flat) + flat / 2, angles).sum(axis=1)


@dataclass(frozen=True)
class Body:
    """The keypoints of a robot; some are the mean of several points."""

    anatomy: Anatomy
    means: Mapping[str, Points]

    def places(self, robot: Robot, keypoints: tuple[str, ...], qpos: Floats) -> Floats:
        """(T, K, 3) of keypoints at qpos (T, nq) [m]."""
        places = world_points(robot, self.anatomy.points_of(keypoints), qpos)
        for k, keypoint in enumerate(keypoints):
            if keypoint in self.means:
                places[:, k] = world_points(robot, self.means[keypoint], qpos).mean(axis=1)
        return places


def body_of(robot: Robot, table: Mapping[str, Any]) -> Body:
    """The keypoints of a robot, given the table `[robot]` of a map file.

    A line may list several points, `pelvis = [["left_hip", 0, 0, 0], ["right_hip", 0, 0, 0]]`: their mean is the keypoint.

    Raises:
        MatchError: the robot is no humanoid, or a line names a body that does not exist.
    """
    several = {k: line for k, line in table.items() if isinstance(line, list) and line and isinstance(line[0], list)}
    anatomy = recognise_with(robot, {k: line[0] if k in several else line for k, line in table.items()})
    sites = {k: [override(anatomy, robot, {k: line}).sites[k] for line in lines] for k, lines in several.items()}
    means = {k: Points(np.array([s.body for s in own]), np.array([s.offset for s in own])) for k, own in sites.items()}
    return Body(anatomy, means)


def pair_of(trajectory: Trajectory, robot: Robot, motion: Motion, body: Body, lines: Mapping[str, Any]) -> Pair:
    """The keypoints that a motion and a robot share, without the neck: most capture skeletons place it anywhere between shoulders and head.

    Frame t answers to the human frame nearest to `trajectory.source_time[t]`; frames beyond the clip answer to its last. Bones are
    those of the compared frames.

    Args:
        lines: the table `[human]` of a map file.

    Raises:
        MatchError: the motion is not human, a line names a joint that does not exist, or the two share too few keypoints.
    """
    found = match_bodies(motion, robot, recognition_with(motion, lines), body.anatomy)
    keypoints = tuple(keypoint for keypoint in found.keypoints if keypoint != "neck")
    nearest = np.round((trajectory.source_time - motion.start_time) * motion.fps).astype(int)
    human = (
        found.recognition.weights(keypoints, len(motion.skeleton)) @ motion.positions[nearest.clip(0, len(motion) - 1)]
    )
    own = body.places(robot, keypoints, trajectory.qpos)
    described = motion.resample(trajectory.fps)
    at = np.round((trajectory.source_time - motion.start_time) * described.fps).astype(int).clip(0, len(described) - 1)
    contacts = features_of(described, found).contacts[at]
    return Pair(found.among(keypoints, human, own), human, own, contacts, trajectory.fps, robot, trajectory.qpos)
