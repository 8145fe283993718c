"""The keypoints of a human and of a robot, frame by frame."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from robot_retarget.base.arrays import Floats, unit
from robot_retarget.human.match import Match, match_bodies, path_weights, recognition_with
from robot_retarget.human.motion import Motion
from robot_retarget.robot import Anatomy, Points, Robot, override, recognise_with, world_points
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
        ends, parents = {end for part in compared for end in PARTS[part]}, self.match.parents.tolist()
        return {
            keypoint: angles_between(*(x[:, k] - x[:, parent] for x in self.seen))
            for k, (keypoint, parent) in enumerate(zip(self.match.keypoints, parents, strict=True))
            if parent >= 0 and keypoint.split("_")[-1] in ends
        }

    def closeness(self, first: ArrayLike, second: ArrayLike) -> tuple[Floats, Floats]:
        """(T, P) distances between keypoints (P,) and (P,) over the paths between them, of the human and of the robot [-]."""
        ends, match = np.array([first, second]), self.match
        found = []
        for x, bones in ((self.human, match.human_bones), (self.robot, match.robot_bones)):
            distance = np.stack([np.linalg.norm(x[:, i] - x[:, j], axis=1) for i, j in ends.T], axis=1)
            found.append(distance / path_weights(match.parents, bones)[*ends])
        return found[0], found[1]


def angles_between(one: Floats, other: Floats) -> Floats:
    """(…) the angles arccos(û · v̂) between vectors (…, 3) [rad]."""
    return np.arccos(np.clip((unit(one) * unit(other)).sum(axis=-1), -1.0, 1.0))


def _about_z(angles: Floats) -> Floats:
    return Rotation.from_euler("z", angles[:, None]).as_matrix()


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
    return Pair(found.among(keypoints, human, own), human, own)
