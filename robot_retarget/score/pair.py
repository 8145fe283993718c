"""The keypoints of the human and of the robot, frame by frame."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from robot_retarget.arrays import Floats, Ints
from robot_retarget.human.match import bone_lengths, recognition_with
from robot_retarget.keypoints import KEYPOINTS, parents_within
from robot_retarget.motion import Motion
from robot_retarget.robot import Anatomy, KeypointSite, Points, Robot, override, recognise_with, world_points
from robot_retarget.trajectory import Trajectory

COMPARED = tuple(keypoint for keypoint in KEYPOINTS if keypoint != "neck")
"""Most capture skeletons place the neck anywhere between the shoulders and the head: it is left out."""


@dataclass(frozen=True, eq=False)
class Pair:
    """K keypoints that human and robot share, over the T frames of a trajectory."""

    keypoints: tuple[str, ...]
    """Parents first."""
    human: Floats
    """(T, K, 3) at the human frame nearest in time [m]."""
    robot: Floats
    """(T, K, 3) [m]."""

    @cached_property
    def parents(self) -> Ints:
        """(K,) index of each keypoint's parent, −1 at the root."""
        tree = parents_within(self.keypoints)
        return np.array([self.keypoints.index(tree[k]) if k in tree else -1 for k in self.keypoints], dtype=np.int64)

    @cached_property
    def bones(self) -> tuple[Floats, Floats]:
        """(K,) median length of the bone to the parent, of the human and of the robot [m]."""
        return bone_lengths(self.human, self.parents), bone_lengths(self.robot, self.parents)

    @cached_property
    def legs(self) -> tuple[float, float]:
        """Thigh and shin of the human and of the robot, the mean of both sides [m]."""
        own = [k for k, name in enumerate(self.keypoints) if name.split("_")[-1] in ("knee", "ankle")]
        sides = len({self.keypoints[k][0] for k in own}) or 1
        human, robot = (float(bones[own].sum()) / sides for bones in self.bones)
        return human, robot

    @cached_property
    def headings(self) -> tuple[Floats, Floats]:
        """(T, 3, 3) of human and robot: turns about z that bring the hip line to +y."""
        return _heading(self.human, self.keypoints), _heading(self.robot, self.keypoints)

    def has(self, *keypoints: str) -> bool:
        """Whether human and robot both have the keypoints."""
        return set(keypoints) <= set(self.keypoints)

    def index(self, keypoint: str) -> int:
        """The column of a keypoint."""
        return self.keypoints.index(keypoint)


def _heading(x: Floats, keypoints: tuple[str, ...]) -> Floats:
    turns = np.tile(np.eye(3), (len(x), 1, 1))
    if {"l_hip", "r_hip"} <= set(keypoints):
        left = x[:, keypoints.index("l_hip")] - x[:, keypoints.index("r_hip")]
        yaw = np.arctan2(-left[:, 0], left[:, 1])
        c, s = np.cos(yaw), np.sin(yaw)
        turns[:, 0, 0], turns[:, 0, 1], turns[:, 1, 0], turns[:, 1, 1] = c, s, -s, c
    return turns


@dataclass(frozen=True)
class Body:
    """The keypoints of a robot; each is the mean of one or more points."""

    anatomy: Anatomy
    sites: Mapping[str, tuple[KeypointSite, ...]]

    def places(self, robot: Robot, keypoints: tuple[str, ...], qpos: Floats) -> Floats:
        """(T, K, 3) of keypoints at qpos (T, nq) [m]."""
        sites = [self.sites[keypoint] for keypoint in keypoints]
        every = [site for several in sites for site in several]
        points = Points(np.array([site.body for site in every]), np.array([site.offset for site in every]))
        counts = np.array([len(several) for several in sites])
        first = np.cumsum(counts) - counts
        return np.add.reduceat(world_points(robot, points, qpos), first, axis=1) / counts[:, None]


def body_of(robot: Robot, table: Mapping[str, Any]) -> Body:
    """The keypoints of a robot, given the table `[robot]` of a map file.

    A line may list several points, `pelvis = [["left_hip", 0, 0, 0], ["right_hip", 0, 0, 0]]`: their mean is the keypoint.

    Raises:
        MatchError: the robot is no humanoid, or a line names a body that does not exist.
    """
    means = {k: line for k, line in table.items() if isinstance(line, list) and line and isinstance(line[0], list)}
    anatomy = recognise_with(robot, {k: line for k, line in table.items() if k not in means})
    sites: dict[str, tuple[KeypointSite, ...]] = {keypoint: (site,) for keypoint, site in anatomy.sites.items()}
    for keypoint, lines in means.items():
        sites[keypoint] = tuple(override(anatomy, robot, {keypoint: line}).sites[keypoint] for line in lines)
    return Body(anatomy, sites)


def pair_of(trajectory: Trajectory, robot: Robot, motion: Motion, body: Body, lines: Mapping[str, Any]) -> Pair:
    """The keypoints that a motion and a robot share.

    Frame t answers to the human frame nearest to `trajectory.source_time[t]`; frames beyond the clip answer to its last.

    Args:
        lines: the table `[human]` of a map file.

    Raises:
        MatchError: the motion is not human, or a line names a joint that does not exist.
    """
    found = recognition_with(motion, lines)
    shared = tuple(k for k in COMPARED if k in found.marks and k in body.sites)
    nearest = np.clip(
        np.round((trajectory.source_time - motion.start_time) * motion.fps).astype(int), 0, len(motion) - 1
    )
    human = found.place(motion.positions[nearest])[:, [found.keypoints.index(k) for k in shared]]
    return Pair(shared, human, body.places(robot, shared, trajectory.qpos))
