"""Layout of a picture: the robot on the right, the human at the same height on the left, and the camera."""

from dataclasses import dataclass

import mujoco
import numpy as np
from scipy.ndimage import uniform_filter1d

from robot_retarget.base.arrays import Floats, Ints, bearing
from robot_retarget.base.errors import MatchError, UsageError
from robot_retarget.robot.kinematics import body_frames
from robot_retarget.robot.model import Robot
from robot_retarget.robot.recognise import recognise
from robot_retarget.robot.timing import require_same_robot, sample
from robot_retarget.scene.scene import Scene, world_corners
from robot_retarget.trajectory import Trajectory

THREE_QUARTERS = 30.0
"""The camera stands this far to the robot's left of straight ahead [degrees]."""
ELEVATION = -10.0
"""The camera looks up by this [degrees]."""
FIELD_OF_VIEW = 26.0
"""From the lower to the upper edge [degrees]; narrow, so that bodies are not distorted."""
FOLLOW = 1.0
"""The camera follows the mean of a path over this time [s]."""
FRAME_MARGIN = 1.1
"""A picture is this much larger than what moves in it."""
ROOMINESS = (0.6, 1.8)
"""Bounds of a picture's width over its height."""
PROBES = 40
"""Number of moments from which extents are taken."""
SKIN = 0.03
"""Joints stand this far under the skin, as a part of the height."""
LINK = 0.02
"""Radius of a link that no geom shows, as a part of the height ..."""
METAL = (0.45, 0.5, 0.56, 1.0)
"""... and its colour: red, green, blue, alpha."""
Colour = tuple[float, float, float, float]
VISIBLE_GROUPS = 3
"""MuJoCo shows the geoms of groups 0, 1 and 2."""

_CUBE = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])


@dataclass(frozen=True, eq=False)
class Staging:
    """F moments of a robot and a human of J points and B bones, both 0 without a human."""

    robot: Robot
    times: Floats
    """(F,) [s]."""
    qpos: Floats
    """(F, nq)"""
    human: Floats
    """(F, J, 3) [m]."""
    bones: Ints
    """(B, 2) indices of points."""
    aside: float
    """Distance from the robot rightward to the human [m]."""
    targets: Floats
    """(F, 3) where the camera looks [m]."""
    azimuth: float
    """Azimuth of the camera, from x towards y [degrees]."""
    distance: float
    """From the camera to its target [m]."""
    height: float
    """Of the standing robot [m]."""
    aspect: float
    """Width over height of a picture that holds both."""
    floor: float
    """Its height [m]."""
    links: Floats
    """(F, L, 2, 3) ends of the robot's links, if no geom shows them [m]; else L = 0."""
    scene: Scene | None = None
    """The bodies around the robot, with a pose at every moment."""

    @property
    def right(self) -> Floats:
        """(3,) the picture's horizontal axis in the world."""
        return _right(self.azimuth)


def arrange(robot: Robot, trajectory: Trajectory, human: Floats | None, bones: Ints | None, times: Floats) -> Staging:
    """Set the figures side by side for the given times (F,) [s].

    The human (T', J, 3), spread evenly over the trajectory's duration, is scaled to the robot's height, set on the
    floor and kept at the robot's side however far either travels. The camera is far enough away for both.

    Raises:
        TrajectoryError: it belongs to another robot.
        UsageError: a human that is not (T', J, 3), or bones between points it has not.
    """
    require_same_robot(trajectory, robot)
    points, pairs = _checked(human, bones)
    clock = np.linspace(0, trajectory.duration, PROBES)
    azimuth = _heading(robot, trajectory.qpos[0]) + 180 - THREE_QUARTERS
    path = _path(body_frames(robot, trajectory.qpos)[0][:, robot.root_body], trajectory.fps)
    corners = body_points(robot, sample(trajectory, robot, clock))
    height = height_of(robot)
    floor = 0.0 if robot.root_joints.size else float(corners[..., 2].min())
    figure = _in_place(points, height, (len(points) - 1) / max(trajectory.duration, 1e-9))

    right = _right(azimuth)
    moved = corners - _at(path, clock, trajectory.duration)[:, None]
    moved = _with_bodies(moved, trajectory, clock, corners - moved, height)
    camera, human_at, width = _side_by_side(moved @ right, figure @ right, SKIN * height)
    tall = max(corners[..., 2].max() - floor, figure[..., 2].max(initial=0.0) + 2 * SKIN * height, height)
    way = _at(path, times, trajectory.duration) + np.array([0, 0, floor])
    aspect = float(np.clip(width / tall, *ROOMINESS))
    seen = np.concatenate([moved.reshape(-1, 3), (figure + human_at * right).reshape(-1, 3)])
    middle = camera * right + [0, 0, tall / 2]
    return Staging(
        robot=robot,
        times=times,
        qpos=sample(trajectory, robot, times),
        human=_at(figure, times, trajectory.duration) + (way + human_at * right)[:, None],
        bones=pairs,
        aside=human_at,
        targets=way + middle,
        azimuth=azimuth,
        distance=_distance(seen - [0, 0, floor] - middle, azimuth, aspect),
        height=height,
        aspect=aspect,
        floor=floor,
        links=links_of(robot, sample(trajectory, robot, times)),
        scene=None if trajectory.scene is None else trajectory.scene.resampled(times * trajectory.fps),
    )


def _with_bodies(moved: Floats, trajectory: Trajectory, clock: Floats, way: Floats, height: float) -> Floats:
    """Return points (F, P, 3) of a robot relative to its way, with the corners of bodies while these are within a height of it.

    Args:
        way: (F, P, 3) or broadcast to it, of the robot [m].
        height: of the robot [m].
    """
    scene = trajectory.scene
    found, bodies = [moved], () if scene is None else scene.resampled(clock * trajectory.fps).bodies
    for body in bodies:
        poses = np.broadcast_to(body.poses, (len(clock), 7))
        corners = world_corners(body, poses) - way[:, :1]
        near = np.linalg.norm(corners[..., :2], axis=2).max(axis=1) < height
        found.append(np.where(near[:, None, None], corners, moved[:, :1]))
    return np.concatenate(found, axis=1)


def visible(model: mujoco.MjModel) -> Ints:
    """Return the visible geoms of the robot: those of the groups that MuJoCo shows, or all geoms of a body without such."""
    own = model.geom_bodyid > 0
    shown = own & (model.geom_group < VISIBLE_GROUPS) & ((model.geom_rgba[:, 3] > 0) | (model.geom_matid >= 0))
    bare = np.bincount(model.geom_bodyid[shown], minlength=model.nbody) == 0
    return np.flatnonzero(shown | (own & bare[model.geom_bodyid]))


def geom_corners(robot: Robot, qpos: Floats) -> Floats:
    """Corners (F, G, 8, 3) of the boxes around the visible geoms [m]."""
    model, data = robot.model, mujoco.MjData(robot.model)
    geoms = visible(model)
    local = model.geom_aabb[geoms, None, :3] + model.geom_aabb[geoms, None, 3:] * _CUBE
    corners = np.empty((len(qpos), len(geoms), 8, 3))
    for frame, q in enumerate(qpos):
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        turned = np.einsum("gij,gcj->gci", data.geom_xmat[geoms].reshape(-1, 3, 3), local)
        corners[frame] = data.geom_xpos[geoms, None] + turned
    return corners


def camera_axes(azimuth: float) -> Floats:
    """Return (3, 3) rows: rightward, upward and away from a camera that looks to an azimuth [degrees]."""
    turn, tilt = np.radians(azimuth), np.radians(ELEVATION)
    ahead = np.array([np.cos(tilt) * np.cos(turn), np.cos(tilt) * np.sin(turn), np.sin(tilt)])
    right = _right(azimuth)
    return np.stack([right, np.cross(right, ahead), ahead])


def _distance(points: Floats, azimuth: float, aspect: float) -> float:
    """How far the camera is from its target for points (P, 3) about it to be in the picture [m].

    d = max(|u| / tan φ, |r| / (a tan φ)) − w for right r, up u, away w, half the field of view φ, aspect a.
    """
    right, up, away = (points @ camera_axes(azimuth).T).T
    half = np.tan(np.radians(FIELD_OF_VIEW / 2))
    return float(FRAME_MARGIN * (np.maximum(np.abs(up), np.abs(right) / aspect) / half - away).max())


def linked(model: mujoco.MjModel) -> Ints:
    """Return the bodies that are joined to their parents by a line: all of a robot most of whose moving bodies have no visible geom."""
    moving, seen = model.body_jntnum > 0, np.isin(np.arange(model.nbody), model.geom_bodyid[visible(model)])
    bodies = np.arange(2, model.nbody) if 2 * (moving & seen).sum() < moving.sum() else np.zeros(0, int)
    return bodies[model.body_parentid[bodies] > 0]


def links_of(robot: Robot, qpos: Floats) -> Floats:
    """Return (F, L, 2, 3) the lines from the origin of each linked body's parent to its own [m]."""
    bodies, places = linked(robot.model), body_frames(robot, qpos)[0]
    return np.stack([places[:, robot.model.body_parentid[bodies]], places[:, bodies]], axis=2)


def height_of(robot: Robot) -> float:
    """Return the height of the standing robot [m]."""
    return float(np.ptp(body_points(robot, robot.standing()[None])[..., 2]))


def body_points(robot: Robot, qpos: Floats) -> Floats:
    """Return (F, P, 3) the points that the robot reaches: corners of its visible geoms, and origins of linked bodies [m]."""
    places = body_frames(robot, qpos)[0][:, 1 if linked(robot.model).size else robot.model.nbody :]
    return np.concatenate([geom_corners(robot, qpos).reshape(len(qpos), -1, 3), places], axis=1)


def _checked(human: Floats | None, bones: Ints | None) -> tuple[Floats, Ints]:
    points = np.zeros((1, 0, 3)) if human is None else np.asarray(human, float)
    pairs = np.zeros((0, 2), int) if bones is None else np.asarray(bones, int).reshape(-1, 2)
    if points.ndim != 3 or points.shape[2] != 3 or not len(points):
        raise UsageError(f"the human's points must be (T, J, 3), got {points.shape}")
    if pairs.size and (pairs.min() < 0 or pairs.max() >= points.shape[1]):
        raise UsageError(f"bones join points 0 … {points.shape[1] - 1}, got {pairs.min()} … {pairs.max()}")
    return points, pairs


def _heading(robot: Robot, qpos: Floats) -> float:
    """Heading of the robot, from x towards y [degrees]."""
    try:
        forward = recognise(robot).forward
    except MatchError:
        forward = np.array([1.0, 0.0, 0.0])
    turns = body_frames(robot, np.stack([robot.model.qpos0, qpos]))[1][:, robot.root_body]
    return float(np.degrees(bearing(turns[1] @ turns[0].T @ forward)))


def _right(azimuth: float) -> Floats:
    angle = np.radians(azimuth)
    return np.array([np.sin(angle), -np.cos(angle), 0.0])


def _side_by_side(robot: Floats, human: Floats, flesh: float) -> tuple[float, float, float]:
    """Where the camera looks and the human stands, rightward of the robot's way [m], and the picture's width [m].

    Both reach as far to either side of their way as their points do, the human's `flesh` further.
    """
    if not human.size:
        return 0.0, 0.0, float(2 * np.abs(robot).max())
    stands = float(robot.min() - flesh - human.max() - flesh)
    left, right = stands + human.min() - flesh, robot.max()
    return float(left + right) / 2, stands, float(right - left)


def _path(positions: Floats, fps: float) -> Floats:
    """The way over ground (T, 3) along positions (T, 3), height 0, without its quick movements."""
    window = max(round(FOLLOW * fps), 1)
    return uniform_filter1d(positions, window, axis=0, mode="nearest") * [1.0, 1.0, 0.0]


def _in_place(points: Floats, height: float, fps: float) -> Floats:
    """The human (T', J, 3) at a given height, on the floor z = 0, about its own way over ground."""
    if not points.size:
        return points
    scaled = points * height * (1 - 2 * SKIN) / np.percentile(_sizes(points), 90)
    lift = np.array([0, 0, SKIN * height - scaled[..., 2].min()])
    return scaled + lift - _path(scaled.mean(1), fps)[:, None]


def _sizes(points: Floats) -> Floats:
    """(T',) the greatest distance between two points of a body, which is its stature whether it stands, crawls or lies [m]."""
    return np.array([np.linalg.norm(x[:, None] - x, axis=-1).max() for x in points])


def _at(values: Floats, times: Floats, duration: float) -> Floats:
    """Values (T, …), spread evenly over a duration, at times (F,): straight between."""
    place = np.clip(times / max(duration, 1e-9), 0, 1) * (len(values) - 1)
    left = np.minimum(place.astype(int), max(len(values) - 2, 0))
    share = (place - left).reshape(-1, *[1] * (values.ndim - 1))
    return values[left] * (1 - share) + values[np.minimum(left + 1, len(values) - 1)] * share


# The human as a figure of capsules: thick where bones are long, with a head.

FIGURE = (0.95, 0.55, 0.25, 1.0)
"""Colour of the human: red, green, blue, alpha."""
THICKNESS = 0.22
"""A capsule's radius as a part of its bone's length,"""
BOUNDS = (0.018, 0.029)
"""within these parts of the height."""
HEAD = 0.055
"""Radius of the head as a part of the height."""

NO_TWIN = 0.8
"""A limb this much shorter than all others has no twin on the other side [-]."""


@dataclass(frozen=True, eq=False)
class StickFigure:
    """Limbs from point to point; a limb whose points are equal is a sphere."""

    limbs: Ints
    """(L, 2) indices of points."""
    radii: Floats
    """(L,) [m]."""


def stick_figure(staging: Staging) -> StickFigure:
    """Bones as capsules and the head as a sphere."""
    if not staging.human.size:
        return StickFigure(staging.bones, np.zeros(0))
    lengths = np.linalg.norm(np.diff(staging.human[:, staging.bones], axis=2)[:, :, 0], axis=-1).mean(0)
    least, most = BOUNDS
    flesh = np.clip(THICKNESS * lengths, least * staging.height, most * staging.height)
    head = _head(staging, lengths)
    return StickFigure(np.append(staging.bones, [[head, head]], axis=0), np.append(flesh, HEAD * staging.height))


def _head(staging: Staging, lengths: Floats) -> int:
    """The end of the one limb that is shorter than all others; where those are two, the point that stands highest most of
    the time: a raised hand does not, but who lies down has no head that does.
    """
    limbs = sorted((_to_the_branch(staging.bones, lengths, int(end)), int(end)) for end in _ends(staging.bones))
    if len(limbs) > 1 and limbs[0][0] < NO_TWIN * limbs[1][0]:
        return limbs[0][1]
    return int(np.median(staging.human[..., 2], axis=0).argmax())


def _ends(bones: Ints) -> Ints:
    """The points that one bone ends in."""
    return np.flatnonzero(np.bincount(bones.ravel()) == 1)


def _to_the_branch(bones: Ints, lengths: Floats, end: int) -> float:
    """How long the limb is from its end to where it branches off [m]."""
    here, length, way = end, 0.0, np.flatnonzero((bones == end).any(axis=1)).tolist()
    while len(way) == 1:
        bone = way[0]
        here, length = int(bones[bone].sum() - here), length + float(lengths[bone])
        way = [k for k in np.flatnonzero((bones == here).any(axis=1)).tolist() if k != bone]
    return length
