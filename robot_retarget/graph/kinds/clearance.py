"""Clearance: links stay out of the bodies around the robot, by MuJoCo's distances; the pair that touches may touch.

The bodies are vertices with known coordinates: in addition to its pairs of a link and a body, the track has edges between
each body and the world, whose lower bounds are the pose of the body at each frame and which no row can miss.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from robot_retarget.base.arrays import Bools, Floats, Ints, lengths
from robot_retarget.graph.kind import (
    Form,
    FrameTargets,
    Kind,
    MeasureRows,
    RetargetContext,
    Role,
    RowState,
    StreamFrame,
    Track,
)
from robot_retarget.graph.placed_scene import PlacedScene
from robot_retarget.graph.weights import RAMP
from robot_retarget.human.touches import Surroundings
from robot_retarget.robot import Anatomy, Robot
from robot_retarget.robot.geoms import solid_geoms
from robot_retarget.scene.scene import Scene

POSE = ("x", "y", "z", "qw", "qx", "qy", "qz")
"""Coordinates of a body in the world."""


@dataclass(frozen=True)
class ClearanceKind(Kind):
    """Distance of a link from a body [m], at least the margin; 0 for pairs that touch."""

    name: str = "clearance"
    role = Role.INEQUALITY
    form = Form.NUMERIC
    margin: float = 0.006
    """Over the leg [-], as between links."""
    reach: float = 0.03
    """Bodies that are farther have no rows, over the leg [-]; more rows oppose each other where feet stand among blocks."""
    stream_reach: float = 0.06
    """In streams, whose one step moves a hand farther than a pass of a clip [-]."""
    scene: PlacedScene | None = None

    def targets(self, context: RetargetContext) -> Track | None:
        """Return [margin, ∞) for every link and body, [0, ∞) where they touch, and the poses of the bodies."""
        scene, around = context.scene, context.human.around
        if scene is None or around is None:
            return None
        touching = _widened(touching_links(context, around), round(RAMP * context.human.fps))
        lower = self._lower(context, scene, touching)
        links = [context.robot.model.body(link).name for link in solid_geoms(context.robot)]
        ends = [(link, body) for body in scene.names for link in links] + pose_ends(scene)
        axes = ("",) * (len(links) * len(scene)) + POSE * len(scene)
        kind, infinite = replace(self, scene=scene), np.full(lower.shape, np.inf)
        return Track(kind, tuple(ends), lower, infinite, infinite, np.ones(len(ends)), axes)

    def _lower(self, context: RetargetContext, scene: PlacedScene, touching: Bools) -> Floats:
        """Return (T, E) lower bounds: margins of links and bodies, 0 where they touch (T, B, links), and poses."""
        links, frames = list(solid_geoms(context.robot)), len(touching)
        margin = np.where(touching[:, :, links], 0.0, self.margin * context.leg).reshape(frames, -1)
        return np.hstack([margin, scene.poses(frames).reshape(frames, -1)])

    def step(self, context: StreamFrame, memory: dict[str, Any]) -> FrameTargets | None:
        """Return the same; what touched may stay at the surface for the fall time of a touch."""
        scene, around = context.scene, context.human.around
        if scene is None or around is None:
            return None
        left = memory.get("left", 0.0) - context.seconds
        memory["left"] = np.where(touching_links(context, around), RAMP, left)
        lower = self._lower(context, scene, memory["left"] > 0)[0]
        infinite = np.full(lower.shape, np.inf)
        return lower, infinite, infinite

    def bodies(self, track: Track) -> Scene | None:
        """Return the bodies with their poses at the frames of the track."""
        if self.scene is None:
            return None
        poses = track.lower[:, -len(POSE) * len(self.scene) :].reshape(len(track.lower), -1, len(POSE))
        every = enumerate(self.scene.scene.bodies)
        moved = (body if body.fixed else replace(body, poses=poses[:, k] / _norms(poses[:, k])) for k, body in every)
        return replace(self.scene.scene, bodies=tuple(moved))

    def for_stream(self) -> "ClearanceKind":
        """Return the kind with the reach of streams."""
        return replace(self, reach=self.stream_reach)

    def rows(self, track: Track, state: RowState) -> MeasureRows | None:
        """Return the distances of near links and bodies."""
        assert self.scene is not None and state.targets is not None
        among, poses = self.scene.among(state.robot), poses_of(state.targets[0], self.scene)
        found = among.near(state.qpos, poses, self.reach * state.match.robot_leg)
        if not len(found.distance):
            return None
        links = list(solid_geoms(state.robot)) if "links" not in state.memory else state.memory["links"]
        state.memory["links"] = links
        column = {link: k for k, link in enumerate(links)}
        edges = [b * len(links) + column[int(link)] for link, b in zip(found.links, found.bodies, strict=True)]
        return MeasureRows(found.distance, found.slope, np.array(edges))


def _norms(poses: Floats) -> Floats:
    """Return (T, 7) divisors that make the quaternions of poses unit quaternions."""
    norms = np.linalg.norm(poses[:, 3:], axis=1, keepdims=True)
    return np.concatenate([np.ones((len(poses), 3)), np.repeat(norms, 4, axis=1)], axis=1)


def pose_ends(scene: PlacedScene) -> list[tuple[str, str]]:
    """Return the ends of the edges that state the poses of B bodies, 7 a body."""
    return [(name, "world") for name in scene.names for _ in POSE]


def poses_of(values: Floats, scene: PlacedScene) -> Floats:
    """Return the poses (B, 7) among the values (E,) of a track's edges at one frame, where they come last."""
    poses = values[len(values) - 7 * len(scene) :].reshape(-1, 7).copy()
    poses[:, 3:] /= lengths(poses[:, 3:])[:, None]
    return poses


def touching_links(context: RetargetContext, around: Surroundings) -> Bools:
    """Return (T, B, links) which links of the robot may touch which bodies: those of parts that touch or stand there."""
    anatomy, weld = context.match.anatomy, np.asarray(context.robot.model.body_weldid)
    found = np.zeros((len(context.human), len(around.scene), context.robot.model.nbody), bool)
    for pair, (part, body) in enumerate(around.touches.pairs):
        found[:, body, links_of(part, context.robot, anatomy)] |= around.touches.held[:, pair, None]
    for foot, sole in anatomy.soles.items():
        on = around.ground.bodies[:, [k for k, name in enumerate(around.ground.keypoints) if name[0] == foot]]
        for body in range(len(around.scene)):
            found[:, body, weld[sole.bodies[0]]] |= (on == body).any(axis=1)
    return found


def links_of(part: str, robot: Robot, anatomy: Anatomy) -> Ints:
    """Return the links that touch for a part of the body: that of its keypoint, and for a pelvis the thighs that it sits on as well."""
    model, sites = robot.model, anatomy.sites
    links = [sites[part].body]
    for knee in ("l_knee", "r_knee") if part == "pelvis" else ():
        body = int(model.body_parentid[sites[knee].body]) if knee in sites else 0
        while body and body != links[0]:
            links.append(body)
            body = int(model.body_parentid[body])
    return np.unique(np.asarray(model.body_weldid)[links])


def _widened(flags: Bools, frames: int) -> Bools:
    """Return flags that hold for some frames before and after as well."""
    wide = flags.copy()
    for shift in range(1, frames + 1):
        wide[shift:] |= flags[:-shift]
        wide[:-shift] |= flags[shift:]
    return wide
