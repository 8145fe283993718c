"""Bring a scene to the frames of a motion: carriers, rates and cuts, in this place alone."""

from dataclasses import replace

import numpy as np

from robot_retarget.arrays import Floats
from robot_retarget.errors import SceneError, known
from robot_retarget.human.motion import Motion
from robot_retarget.scene.geoms import SceneModel
from robot_retarget.scene.scene import RigidBody, Scene, composed

FARTHEST = 30.0
"""A body farther from the human has another unit or another origin [m]."""
LARGEST = 50.0
"""A body with a longer edge has another unit [m]; planes and height fields excepted."""
FASTEST = 20.0
"""A body that moves faster between two frames jumps [m/s]."""
INSIDE = 0.12
"""No joint lies deeper in a body at the first frame [m]: flesh and errors of captures take 0.06."""
MISSING = 0.1
"""Poses may begin later and end earlier than the motion by this time [s]; they are held there."""


def with_scene(motion: Motion, scene: Scene) -> Motion:
    """Return the motion with the bodies around it, each fixed or with a pose at every frame.

    Args:
        motion: the human; a part of a clip stays a part.
        scene: bodies with a carrier, with poses in the time of the motion's source, or at rest.

    Raises:
        SceneError: an unknown carrier, poses that end before the motion, a body of another unit, or one that holds the
            human at the first frame.
    """
    clip = motion.clip
    placed = replace(scene, bodies=tuple(_placed(body, clip, motion) for body in scene.bodies))
    poses = placed.poses(len(clip))
    jumps = [note for k, body in enumerate(placed.bodies) if (note := _checked(body, poses[:, k], clip))]
    _require_outside(placed, poses, clip)
    around = replace(placed, notes=(*scene.notes, *jumps, *_mesh_notes(placed)))
    whole = replace(clip, scene=around, whole=None)
    return whole if motion.whole is None else whole.frames(motion.span.start, motion.span.stop)


def rescaled(motion: Motion, scale: float) -> Motion:
    """Return a motion with a scene of another size around the robot, over the captured size [-]."""
    clip = motion.clip
    assert clip.scene is not None
    whole = replace(clip, scene=replace(clip.scene, scale=scale), whole=None)
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
        raise SceneError(f"body {body.name!r} has no pose after {end:.2f} s; the motion ends at {needed:.2f} s")
    return replace(body.resampled(clip.source_time * fps), fps=None)


def _joint_poses(body: RigidBody, clip: Motion) -> Floats:
    """Return (T, 7) poses of the joint that carries a body."""
    names = clip.skeleton.names
    if body.carrier not in names:
        raise SceneError(f"body {body.name!r}: no joint {body.carrier!r}; {known(names, typed=body.carrier)}")
    if clip.rotations is None:
        raise SceneError(f"body {body.name!r}: {clip.source or 'the motion'} has no rotations: a joint cannot carry it")
    joint = names.index(body.carrier)
    return np.concatenate([clip.positions[:, joint], clip.rotations[:, joint]], axis=1)


def _checked(body: RigidBody, poses: Floats, clip: Motion) -> str:
    """Return a note about jumps of a body, empty without any; refuse a body of another unit."""
    hint = 'state its unit (unit = "mm") or its place'
    away = np.linalg.norm(poses[:, :3] - clip.positions.mean(axis=1), axis=1)
    extent = float(body.shape.size.max())
    if body.shape.volume and extent > LARGEST:
        raise SceneError(f"body {body.name!r} is {extent:.4g} m long: {hint}")
    near = int(away.argmin())
    if body.shape.volume and away[near] - extent > FARTHEST:
        raise SceneError(f"body {body.name!r} is {away[near]:.4g} m from the human or farther: {hint}")
    speed = np.linalg.norm(np.diff(poses[:, :3], axis=0), axis=1) * clip.fps
    if speed.max(initial=0.0) <= FASTEST:
        return ""
    frame = int(speed.argmax())
    return f"RigidBody {body.name!r} jumps {speed[frame] / clip.fps:.2f} m from frame {frame} to {frame + 1}."


def _require_outside(scene: Scene, poses: Floats, clip: Motion) -> None:
    """Refuse a body that holds the human at the first frame."""
    distance, _ = SceneModel(scene).nearest(clip.positions[:1], poses[:1], reach=1.0)
    if distance.size and distance.min() < -INSIDE:
        _, joint, body = np.unravel_index(int(distance.argmin()), distance.shape)
        raise SceneError(
            f"body {scene.names[body]!r} holds the human's joint {clip.skeleton.names[joint]!r} {-distance.min():.2f} m deep "
            "at the first frame: check its position, its unit and the order of its quaternions"
        )


def _mesh_notes(scene: Scene) -> list[str]:
    """Return notes about open meshes."""
    opened = {body.name: body.shape.open_edges for body in scene.bodies if len(body.shape.faces)}
    return [
        f"The mesh of body {name!r} is open at {count} edges; its convex hull is used."
        for name, count in opened.items()
        if count
    ]
