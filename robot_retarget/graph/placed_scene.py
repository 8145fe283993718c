"""The bodies of a scene in the robot's world: their size, their places, and the places of the human's touches on them.

The human's world becomes the robot's by  y = r (x − o)  with r the ratio of the legs (`path`). A body of the scale s has its
lengths multiplied by s; its point on the floor goes where the human's world puts it:

    c′ = r (c − o) + (s − r) h ẑ,    h the height of its centre over its lowest point.

A point of its surface, u in its frame, becomes s u in the same frame: places of touches are kept in the object's frame,
at any size.
"""

from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from robot_retarget.base.arrays import Floats, Ints
from robot_retarget.human.features import HumanFeatures, features_of
from robot_retarget.human.match import Match
from robot_retarget.human.motion import Motion
from robot_retarget.robot import Robot
from robot_retarget.robot.body_distances import RobotAmongBodies
from robot_retarget.scene.scene import RigidBody, Scene, world_corners

# The path of the pelvis, scaled by the length of the leg.


@dataclass(frozen=True, eq=False)
class RootScaling:
    """How places of the human become places of the robot:  y = r (x − o),  with the heights of the ankles made to fit."""

    ratio: float
    """r, robot leg over human leg [-]."""
    origin: Floats
    """(3,) o, the point that becomes the origin [m]: the human's first place, at the height that puts ankles at the
    robot's."""
    pelvis: int | None
    """Index of the pelvis among the keypoints; None uses the mean of all."""

    def path(self, human: HumanFeatures) -> Floats:
        """Return (T, 3) target positions of the pelvis [m]; in flight it falls freely, in the human's time."""
        x = human.positions
        where = x.mean(axis=1) if self.pelvis is None else x[:, self.pelvis]
        path = (where - self.origin) * self.ratio
        if human.falls is not None:
            path[:, 2] += human.falls[:, 1] - self.ratio * human.falls[:, 0]
        return path


def root_scaling_of(human: HumanFeatures, match: Match) -> RootScaling:
    """Return the scaling of the path of the root; the scaled path starts above the origin."""
    x, ratio = human.positions, match.leg_ratio
    pelvis = match.index("pelvis") if "pelvis" in match.keypoints else None
    first = x[0].mean(axis=0) if pelvis is None else x[0, pelvis]
    ankles = {"l_ankle", "r_ankle"} & set(match.keypoints)
    low = human.ankle_height - match.ankle_height / ratio if ankles else 0.0
    return RootScaling(ratio, np.array([*first[:2], low]), pelvis)


def pelvis_path(human: HumanFeatures, match: Match) -> Floats:
    """(T, 3) the human pelvis, scaled by the leg, starting above the origin, its ankles at the robot's height [m]."""
    return root_scaling_of(human, match).path(human)


@dataclass(frozen=True, eq=False)
class PlacedScene:
    """B bodies in the robot's world over T frames."""

    scene: Scene
    """The bodies with their size and poses around the robot."""
    size: float
    """s, robot's size of a body over its captured size [-]."""
    ratio: float
    """r, robot leg over human leg [-]."""
    origin: Floats
    """(2,) the point of the human's floor that becomes the origin [m]."""
    lifts: Floats
    """(B,) height of each centre over the lowest point of its body, in its lowest frame and the captured size [m]."""
    _models: dict[Path, RobotAmongBodies] = field(default_factory=dict, repr=False)

    def __len__(self) -> int:
        return len(self.scene)

    def poses(self, frames: int) -> Floats:
        """Return (T, B, 7) poses over T frames."""
        return self.scene.poses(frames)

    def points(self, bodies: Ints, local: Floats, poses: Floats) -> Floats:
        """Return points of bodies in the world [m].

        Args:
            bodies: (P,) indices of bodies.
            local: (T, P, 3) in the frames of the captured bodies [m].
            poses: (T, B, 7) of the bodies around the robot.
        """
        own = poses[:, bodies]
        turn = Rotation.from_quat(own[..., 3:].reshape(-1, 4), scalar_first=True)
        return own[..., :3] + turn.apply(self.size * local.reshape(-1, 3)).reshape(local.shape)

    def directions(self, bodies: Ints, local: Floats, poses: Floats) -> Floats:
        """Return directions (T, P, 3) of the bodies' frames in the world."""
        turn = Rotation.from_quat(poses[:, bodies, 3:].reshape(-1, 4), scalar_first=True)
        return turn.apply(local.reshape(-1, 3)).reshape(local.shape)

    def among(self, robot: Robot) -> RobotAmongBodies:
        """Return the robot's model among the bodies, compiled once."""
        if robot.path not in self._models:
            self._models[robot.path] = RobotAmongBodies(robot, self.scene)
        return self._models[robot.path]

    def at(self, frames: slice | np.ndarray) -> "PlacedScene":
        """Return the bodies at some frames."""
        return replace(self, scene=self.scene.at(frames))

    def moved(self, captured: Scene) -> "PlacedScene":
        """Return the bodies where other frames of the human's world have them."""
        pairs = zip(self.scene.bodies, captured.bodies, strict=True)
        bodies = tuple(replace(own, poses=self._beside(body.poses, k)) for k, (own, body) in enumerate(pairs))
        return replace(self, scene=replace(self.scene, bodies=bodies))

    def _beside(self, captured: Floats, body: int) -> Floats:
        """Return the poses (…, 7) of a body in the robot's world from those in the human's."""
        poses = captured.copy()
        poses[..., :3] = self.ratio * (poses[..., :3] - [*self.origin, 0.0])
        poses[..., 2] += (self.size - self.ratio) * self.lifts[body]
        return poses

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the bodies."""
        return self.scene.names


def placed_scene(human: HumanFeatures, match: Match) -> PlacedScene | None:
    """Return the bodies around a human in the robot's world; None without a scene."""
    if human.around is None:
        return None
    scene = human.around.scene
    ratio, *origin = world = scene.world or _world_of(human, match)
    size = ratio if scene.scale is None else scene.scale
    sized = tuple(replace(body, shape=body.shape.scaled(size)) for body in scene.bodies)
    lifts = np.array([_lift(body) for body in scene.bodies])
    return PlacedScene(replace(scene, bodies=sized, world=world), size, ratio, np.array(origin), lifts).moved(scene)


def captured_scene(placed: Scene, motion: Motion, match: Match) -> Scene:
    """Return the bodies of a trajectory in the world of its human: the inverse of `placed_scene`.

    Args:
        placed: bodies around the robot, fixed or with a pose at every frame of the motion.
        motion: the human at the frames of the trajectory; its first place is that of the robot where the scene does not
            have the map between their floors.
        match: keypoints of both.
    """
    world = placed.world or _world_of(features_of(replace(motion, scene=None), match), match)
    size = world[0] if placed.scale is None else placed.scale
    return replace(placed, bodies=tuple(_captured(body, world, size) for body in placed.bodies), world=world)


def _world_of(human: HumanFeatures, match: Match) -> tuple[float, float, float]:
    """Return r and o of the map from the human's floor to the robot's."""
    known = root_scaling_of(human, match)
    return known.ratio, float(known.origin[0]), float(known.origin[1])


def _captured(body: RigidBody, world: tuple[float, float, float], size: float) -> RigidBody:
    (ratio, *origin), poses = world, body.poses.copy()
    poses[..., 2] -= (size - ratio) * _lift(body) / size
    poses[..., :3] = poses[..., :3] / ratio + [*origin, 0.0]
    return replace(body, poses=poses, shape=body.shape.scaled(1 / size))


def _lift(body: RigidBody) -> float:
    poses = np.atleast_2d(body.poses)
    return float((poses[:, 2] - world_corners(body, poses)[..., 2].min(axis=1)).flat[poses[:, 2].argmin()])
