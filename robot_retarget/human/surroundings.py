"""Bring a scene to the frames of a motion: carriers, rates and cuts, in this place alone."""

from dataclasses import replace

import numpy as np
from scipy.ndimage import median_filter
from scipy.spatial.transform import Rotation

from robot_retarget.base.arrays import Floats
from robot_retarget.base.errors import SceneError, known
from robot_retarget.human.motion import Motion
from robot_retarget.scene.geoms import SceneModel
from robot_retarget.scene.scene import RigidBody, Scene, composed, world_corners

FARTHEST = 30.0
"""A body farther from the human has another unit or another origin [m]."""
LONGEST = (0.005, 50.0)
"""Bounds of the longest edge of a body; outside them it has another unit [m]. Planes and height fields are not bounded."""
JUMP = (0.1, 0.8)
"""A body jumps where it moves [m] or turns [rad] in a frame by this more than in the median of two frames before and after."""
SUNK = 0.05
"""A moving body that reaches deeper under the floor has another place, unit or order of quaternions [m]."""
FLESH = 0.06
"""Flesh and errors of captures take this from a joint to the surface of a body [m]; a deeper joint is named ..."""
INSIDE = 0.12
"""... and one that is deeper than this at the first frame is refused [m]."""
MISSING = 0.1
"""Poses may begin later and end earlier than the motion by this time [s]; they are held there."""


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
    names = clip.skeleton.names
    if body.carrier not in names:
        raise SceneError(f"{body.title}: no joint {body.carrier!r}; {known(names, typed=body.carrier)}")
    if clip.rotations is None:
        raise SceneError(f"{body.title}: {clip.source or 'the motion'} has no rotations: a joint cannot carry it")
    joint = names.index(body.carrier)
    return np.concatenate([clip.positions[:, joint], clip.rotations[:, joint]], axis=1)


def _require_unit(body: RigidBody, poses: Floats, clip: Motion) -> None:
    """Refuse a body of another unit, by its size and by its distance from the human."""
    hint = 'state its unit (unit = "mm") or its place'
    away = np.abs(poses[:, :3] - clip.positions.mean(axis=1)).max(axis=1)
    extent, near = float(body.shape.size.max()), int(away.argmin())
    if body.shape.volume and not LONGEST[0] <= extent <= LONGEST[1]:
        raise SceneError(f"{body.title} is {extent:.4g} m long: {hint}")
    if body.shape.volume and away[near] - extent > FARTHEST:
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
    if height[frame] > -SUNK:
        return ""
    return (
        f"Body {body.name!r} reaches {-height[frame]:.2f} m under the floor at frame {frame}: "
        "check its place, its unit and the order of its quaternions."
    )


def _inside(scene: Scene, poses: Floats, clip: Motion) -> str:
    """Return a note about a body that holds a joint of the human at the first frame; refuse one that holds it deep."""
    distance, _ = SceneModel(scene).nearest(clip.positions[:1], poses[:1], reach=1.0)
    if not distance.size or distance.min() > -FLESH:
        return ""
    _, joint, body = np.unravel_index(int(distance.argmin()), distance.shape)
    what = (
        f"holds the human's joint {clip.skeleton.names[joint]!r} {-distance.min():.2f} m deep at the first frame: "
        "check its position, its unit and the order of its quaternions"
    )
    if distance.min() < -INSIDE:
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
