"""Bring a scene to the frames of a motion: carriers, rates and cuts, in this place alone."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from scipy.ndimage import median_filter
from scipy.spatial.transform import Rotation

from robot_retarget.base.arrays import Floats, unit
from robot_retarget.base.errors import SceneError, known
from robot_retarget.base.untrusted.rotations import LENGTHS
from robot_retarget.human.motion import Motion
from robot_retarget.human.skeleton import Skeleton
from robot_retarget.scene.geoms import SceneModel
from robot_retarget.scene.scene import IDENTITY, RigidBody, Scene, composed, world_corners
from robot_retarget.scene.shape import ShapeKind

FARTHEST_BODY = 30.0
"""A body farther from the human has another unit or another origin [m]."""
LONGEST = (0.005, 50.0)
"""Bounds of the longest edge of a body; outside them it has another unit [m]. Planes and height fields are not bounded."""
JUMP = (0.1, 0.8)
"""A body jumps where it moves [m] or turns [rad] in a frame by this more than in the median of two frames before and after."""
BELOW_FLOOR = 0.05
"""A moving body that reaches deeper under the floor has another place, unit or order of quaternions [m]."""
FLESH_AT_BODY = 0.06
"""Flesh and errors of captures take this from a joint to the surface of a body [m]; a deeper joint is named ..."""
WITHIN_HUMAN = 0.12
"""... and one that is deeper than this at the first frame is refused [m]."""
MISSING = 0.1
"""Poses may begin later and end earlier than the motion by this time [s]; they are held there, and a longer lack is refused: three frames at 30
frames a second."""


def with_scene(motion: Motion, scene: Scene) -> Motion:
    """Return the motion with the bodies around it, each fixed or with a pose at every frame.

    Args:
        motion: the human; a part of a clip stays a part.
        scene: bodies with a carrier, with poses in the time of the motion's source, or at rest.

    Raises:
        SceneError: an unknown carrier, poses that end before the motion, a body of another unit, or one that holds the
            human deep at the first frame.
    """
    clip = motion.clip
    placed = replace(scene, bodies=tuple(_placed(body, clip, motion) for body in scene.bodies))
    poses = placed.poses(len(clip))
    for k, body in enumerate(placed.bodies):
        _require_unit(body, poses[:, k], clip)
    moving = [(body, poses[:, k]) for k, body in enumerate(placed.bodies) if not body.fixed]
    found = [*map(_jump, scene.bodies), *(_sunk(*each) for each in moving), _inside(placed, poses, clip)]
    return with_bodies(motion, replace(placed, notes=(*scene.notes, *filter(None, found), *_mesh_notes(placed))))


def rescaled(motion: Motion, scale: float) -> Motion:
    """Return a motion with a scene of another size around the robot, over the captured size [-]."""
    assert motion.clip.scene is not None
    return with_bodies(motion, replace(motion.clip.scene, scale=scale))


def with_bodies(motion: Motion, scene: Scene) -> Motion:
    """Return a motion with bodies that are fixed or have a pose at every frame of its clip."""
    whole = replace(motion.clip, scene=scene, whole=None)
    return whole if motion.whole is None else whole.frames(motion.span.start, motion.span.stop)


def _placed(body: RigidBody, clip: Motion, part: Motion) -> RigidBody:
    """Return a body with a pose at every frame of a clip, or a fixed one; poses last as long as the part."""
    if body.carrier:
        return replace(body, poses=composed(_joint_poses(body, clip), body.poses), carrier="")
    if body.poses.ndim == 1:
        return body
    fps = body.fps or clip.fps
    end, needed = (len(body.poses) - 1) / fps, float(part.source_time[-1])
    if needed > end + MISSING:
        raise SceneError(f"{body.title} has no pose after {end:.2f} s; the motion ends at {needed:.2f} s")
    return replace(body.resampled(clip.source_time * fps), fps=None)


def _joint_poses(body: RigidBody, clip: Motion) -> Floats:
    """Return (T, 7) poses of the joint that carries a body."""
    joint = _carrier(body, clip.skeleton)
    if clip.rotations is None:
        raise SceneError(f"{body.title}: {clip.source or 'the motion'} has no rotations: a joint cannot carry it")
    return np.concatenate([clip.positions[:, joint], clip.rotations[:, joint]], axis=1)


def _carrier(body: RigidBody, skeleton: Skeleton) -> int:
    """Return the joint that carries a body."""
    if body.carrier not in skeleton.names:
        raise SceneError(f"{body.title}: no joint {body.carrier!r}; {known(skeleton.names, typed=body.carrier)}")
    return skeleton.names.index(body.carrier)


def _require_unit(body: RigidBody, poses: Floats, clip: Motion) -> None:
    """Refuse a body of another unit, by its size and by its distance from the human."""
    hint = 'state its unit (unit = "mm") or its place'
    away = np.abs(poses[:, :3] - clip.positions.mean(axis=1)).max(axis=1)
    extent, near = float(body.shape.size.max()), int(away.argmin())
    if body.shape.volume and not LONGEST[0] <= extent <= LONGEST[1]:
        raise SceneError(f"{body.title} is {extent:.4g} m long: {hint}")
    if body.shape.volume and away[near] - extent > FARTHEST_BODY:
        raise SceneError(f"{body.title} is {away[near]:.4g} m from the human or farther: {hint}")


def _jump(body: RigidBody) -> str:
    """Return a note about the largest jump in the poses of a body; empty without any."""
    if body.poses.ndim == 1 or len(body.poses) < 3:
        return ""
    turn = Rotation.from_quat(body.poses[:, 3:], scalar_first=True)
    steps = np.stack(
        [np.linalg.norm(np.diff(body.poses[:, :3], axis=0), axis=1), (turn[1:] * turn[:-1].inv()).magnitude()]
    )
    excess = (steps - median_filter(steps, (1, 5), mode="nearest")) / np.array(JUMP)[:, None]
    frame = int(excess.max(axis=0).argmax())
    if excess[:, frame].max() <= 1:
        return ""
    way, angle = steps[:, frame]
    return f"Body {body.name!r} jumps by {way:.2f} m and {np.degrees(angle):.0f}° from frame {frame} to {frame + 1} of its poses."


def _sunk(body: RigidBody, poses: Floats) -> str:
    """Return a note about a body that reaches under the floor; empty for one that does not."""
    height = world_corners(body, poses)[:, :, 2].min(axis=1)
    frame = int(height.argmin())
    if height[frame] > -BELOW_FLOOR:
        return ""
    return (
        f"Body {body.name!r} reaches {-height[frame]:.2f} m under the floor at frame {frame}: "
        "check its place, its unit and the order of its quaternions."
    )


SCAN = (
    "a mesh acts as its convex hull, and the scan of a room is not convex: give walls, steps and furniture as bodies of their own, "
    "or the ground as a height field. Else "
)


def _inside(scene: Scene, poses: Floats, clip: Motion) -> str:
    """Return a note about a body that holds a joint of the human at the first frame; refuse one that holds it deep."""
    distance, _ = SceneModel(scene).nearest(clip.positions[:1], poses[:1], reach=1.0)
    if not distance.size or distance.min() > -FLESH_AT_BODY:
        return ""
    _, joint, body = np.unravel_index(int(distance.argmin()), distance.shape)
    mesh = scene.bodies[body].shape.kind is ShapeKind.MESH
    what = (
        f"holds the human's joint {clip.skeleton.names[joint]!r} {-distance.min():.2f} m deep at the first frame: "
        f"{SCAN if mesh else ''}check its position, its unit and the order of its quaternions"
    )
    if distance.min() < -WITHIN_HUMAN:
        raise SceneError(f"{scene.bodies[body].title} {what}")
    return f"Body {scene.names[body]!r} {what}."


def _mesh_notes(scene: Scene) -> list[str]:
    """Return notes about open meshes."""
    opened = {body.name: body.shape.open_edges for body in scene.bodies if len(body.shape.faces)}
    return [
        f"The mesh of body {name!r} is open at {count} edges; its convex hull is used."
        for name, count in opened.items()
        if count
    ]


# The bodies of a scene in a stream: each has the pose of its latest packet, that of its carrier, or that of its file.

IMMOVABLE = (ShapeKind.PLANE, ShapeKind.HEIGHT_FIELD)
"""Shapes that MuJoCo does not move."""


class LiveScene:
    """B bodies; every body but a plane or a height field may move."""

    def __init__(self, scene: Scene, skeleton: Skeleton, faults: Counter[str]):
        """Start with the first poses of a scene.

        Args:
            skeleton: of the performer; its joints carry bodies.
            faults: receives counts of poses that are not taken.

        Raises:
            SceneError: the skeleton lacks the carrier.
        """
        self._scene, self._faults = scene, faults
        first = [IDENTITY if body.carrier else np.atleast_2d(body.poses)[0] for body in scene.bodies]
        self.poses: Floats = np.array(first, dtype=float).reshape(-1, 7)
        """(B, 7) latest poses."""
        self._carried = [
            (k, _carrier(body, skeleton), body.poses) for k, body in enumerate(scene.bodies) if body.carrier
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
        return "" if LENGTHS[0] < norm < LENGTHS[1] else f"no pose for body {name!r}"

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
            own = with_scene(motion, replace(self._scene, bodies=tuple(first))).clip.scene
            assert own is not None
        return with_bodies(motion, self.scene(own.poses(len(motion.clip))))


def first_frame(scene: Scene) -> Scene:
    """Return a scene at its first poses, with those relative to the carriers of bodies that have one."""
    return replace(scene, bodies=tuple(_at(body, np.atleast_2d(body.poses)[:1]) for body in scene.bodies))


def _at(body: RigidBody, poses: Floats) -> RigidBody:
    own = poses[0] if body.shape.kind in IMMOVABLE else poses
    return replace(body, poses=own, carrier="", fps=None)
