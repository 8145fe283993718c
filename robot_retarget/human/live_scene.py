"""The bodies of a scene in a stream: each has the pose of its latest packet, that of its carrier, or that of its file."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from robot_retarget.base.arrays import Floats, unit
from robot_retarget.base.errors import SceneError, known
from robot_retarget.human.motion import Motion
from robot_retarget.human.skeleton import Skeleton
from robot_retarget.human.surroundings import with_bodies
from robot_retarget.scene.scene import IDENTITY, RigidBody, Scene, composed
from robot_retarget.scene.shape import ShapeKind

IMMOVABLE = (ShapeKind.PLANE, ShapeKind.HEIGHT_FIELD)
"""Shapes that MuJoCo does not move."""
UNIT = (0.5, 2.0)
"""A quaternion of another norm is no rotation [-]."""


class LiveScene:
    """B bodies; every body but a plane or a height field may move."""

    def __init__(self, scene: Scene, skeleton: Skeleton, faults: Counter[str]):
        """Start with the first poses of a scene.

        Args:
            skeleton: of the performer; its joints carry bodies.
            faults: receives counts of poses that are not taken.

        Raises:
            SceneError: the skeleton has no such carrier.
        """
        for body in scene.bodies:
            if body.carrier and body.carrier not in skeleton.names:
                raise SceneError(
                    f"{body.title}: no joint {body.carrier!r}; {known(skeleton.names, typed=body.carrier)}"
                )
        self._scene, self._faults = scene, faults
        first = [IDENTITY if body.carrier else np.atleast_2d(body.poses)[0] for body in scene.bodies]
        self.poses: Floats = np.array(first, dtype=float).reshape(-1, 7)
        """(B, 7) latest poses."""
        self._carried = [
            (k, skeleton.names.index(body.carrier), body.poses) for k, body in enumerate(scene.bodies) if body.carrier
        ]
        self._sent: set[str] = set()

    def step(self, given: Mapping[str, Floats], positions: Floats, rotations: Floats | None) -> Floats:
        """Take the poses of a frame and return those of all bodies (B, 7).

        Args:
            given: (7,) by name: x y z [m], quaternion w x y z. A body that is not named keeps its pose.
            positions: (J, 3) of the joints [m].
            rotations: (J, 4) of the joints, w x y z; without them carried bodies keep their poses.
        """
        self.poses = self.poses.copy()
        if rotations is not None:
            for body, joint, own in self._carried:
                self.poses[body] = composed(np.concatenate([positions[joint], rotations[joint]]), own)
        for name, pose in given.items():
            fault = self._fault(name, pose)
            if fault:
                self._faults[fault] += 1
                continue
            self._sent.add(name)
            values = np.asarray(pose, dtype=float)
            self.poses[self._scene.names.index(name)] = np.concatenate([values[:3], unit(values[3:])])
        for name in self._sent - given.keys():
            self._faults[f"no pose of body {name!r}"] += 1
        return self.poses

    def _fault(self, name: str, pose: Floats) -> str:
        """Return why a pose is not taken; empty if it is."""
        if name not in self._scene.names:
            return f"no body {name!r}"
        if self._scene.bodies[self._scene.names.index(name)].shape.kind in IMMOVABLE:
            return f"body {name!r} cannot move"
        try:
            values = np.asarray(pose, dtype=float)
        except (TypeError, ValueError):
            values = np.zeros(0)
        norm = float(np.linalg.norm(values[3:])) if values.shape == (7,) and np.isfinite(values).all() else 0.0
        return "" if UNIT[0] < norm < UNIT[1] else f"no pose for body {name!r}"

    def scene(self, poses: Floats) -> Scene:
        """Return the bodies at poses (T, B, 7)."""
        return replace(self._scene, bodies=tuple(_at(body, poses[:, k]) for k, body in enumerate(self._scene.bodies)))

    def around(self, motion: Motion) -> Motion:
        """Return a motion with the bodies at its own poses, or else at their first ones.

        Raises:
            SceneError: a body has another unit, or holds the human at the first frame.
        """
        own = motion.clip.scene
        if own is None or own.names != self._scene.names:
            first = (
                body if body.carrier else replace(body, poses=p)
                for body, p in zip(self._scene.bodies, self.poses, strict=True)
            )
            own = motion.with_scene(replace(self._scene, bodies=tuple(first))).clip.scene
            assert own is not None
        return with_bodies(motion, self.scene(own.poses(len(motion.clip))))


def first_frame(scene: Scene) -> Scene:
    """Return a scene at its first poses, with those relative to the carriers of bodies that have one."""
    return replace(scene, bodies=tuple(_at(body, np.atleast_2d(body.poses)[:1]) for body in scene.bodies))


def _at(body: RigidBody, poses: Floats) -> RigidBody:
    own = poses[0] if body.shape.kind in IMMOVABLE else poses
    return replace(body, poses=own, carrier="", fps=None)
