"""Kinds of bodies around: the places of the human's touches, and the clearance of links."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.ndimage import maximum_filter1d

from robot_retarget.base.arrays import Bools, Floats, Ints, lengths, unit
from robot_retarget.contact.touch import gradual
from robot_retarget.graph.kind import (
    AXES,
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
from robot_retarget.graph.kinds.separation import SeparationKind
from robot_retarget.graph.placed_scene import PlacedScene
from robot_retarget.graph.track import HARD, exact, limit
from robot_retarget.graph.weights import RAMP
from robot_retarget.human.touches import Surroundings, Touches
from robot_retarget.robot import Anatomy, Robot
from robot_retarget.robot.geoms import solid_geoms
from robot_retarget.scene.scene import Scene

# Clearance: links stay out of the bodies around the robot, by MuJoCo's distances; the pair that touches may touch.
#
# The bodies are vertices with known coordinates: their poses at each frame are the data of the track.


@dataclass(frozen=True)
class ClearanceKind(Kind):
    """Distance of a link from a body [m], at least the margin; 0 for pairs that touch."""

    name: str = "clearance"
    role = Role.INEQUALITY
    form = Form.NUMERIC
    margin: float = SeparationKind.margin
    """Over the leg [-], as between links."""
    reach: float = 0.03
    """Bodies that are farther have no rows, over the leg [-]; more rows oppose each other where feet stand among
    blocks. With half and with double the jerk of the OP3 in the box sample is 25.6 and 21.2 in place of 19.9 rad/s³, at
    the same limbs (0.04°)."""
    scene: PlacedScene | None = None

    def targets(self, context: RetargetContext) -> Track | None:
        """Return [margin, ∞) for every link and body, [0, ∞) where they touch; its data are the poses of the bodies."""
        scene, around = context.scene, context.human.around
        if scene is None or around is None:
            return None
        width = 2 * round(RAMP * context.human.fps) + 1
        touching = maximum_filter1d(touching_links(context, around).view(np.uint8), width, axis=0).astype(bool)
        links = [context.robot.model.body(link).name for link in solid_geoms(context.robot)]
        ends = tuple((link, body) for body in scene.names for link in links)
        poses = scene.poses(len(touching)).reshape(len(touching), -1)
        track = limit(replace(self, scene=scene), ends, self._lower(context, touching), np.inf, len(touching))
        return replace(track, data=poses)

    def _lower(self, context: RetargetContext, touching: Bools) -> Floats:
        """Return (T, E) lower bounds: margins of links and bodies, 0 where they touch (T, B, links)."""
        margins = np.where(touching[:, :, list(solid_geoms(context.robot))], 0.0, self.margin * context.leg)
        return margins.reshape(len(touching), -1)

    def step(self, context: StreamFrame, memory: dict[str, Any]) -> FrameTargets | None:
        """Return the same; what touched may stay at the surface for the fall time of a touch."""
        scene, around = context.scene, context.human.around
        if scene is None or around is None:
            return None
        left = memory.get("left", 0.0) - context.seconds
        memory["left"] = np.where(touching_links(context, around), RAMP, left)
        return self._lower(context, memory["left"] > 0)[0], np.inf, np.inf, scene.poses(1).ravel()

    def bodies(self, track: Track) -> Scene | None:
        """Return the bodies with their poses at the frames of the track."""
        if self.scene is None:
            return None
        poses, every = poses_of(track.data, self.scene), enumerate(self.scene.scene.bodies)
        moved = (body if body.fixed else replace(body, poses=poses[:, k]) for k, body in every)
        return replace(self.scene.scene, bodies=tuple(moved))

    def rows(self, track: Track, state: RowState) -> MeasureRows | None:
        """Return the distances of near links and bodies."""
        assert self.scene is not None and state.targets is not None
        among, poses = self.scene.among(state.robot), poses_of(state.targets[3], self.scene)
        found = among.near(state.qpos, poses, self.reach * state.match.robot_leg)
        return MeasureRows(found.distance, found.slope, found.pairs) if len(found.distance) else None


def poses_of(data: Floats, scene: PlacedScene) -> Floats:
    """Return the poses (…, B, 7) at the start of a track's data (…, D)."""
    poses = data[..., : 7 * len(scene)].reshape(*data.shape[:-1], -1, 7).copy()
    poses[..., 3:] /= lengths(poses[..., 3:])[..., None]
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


# Contact: a part that touches a body of the scene touches it on the robot, at the same place of the body.
#
#     d(link, face) = 0,    (I − n nᵀ)(x − p) = 0
#
# with x the keypoint, p the place of the human's touch and n the normal of the surface there, fixed in the frame of the body
# while the human's part stays on one place: the part does not slide. The face is the side of the body across n, or the plane
# through p where another side is nearer, so that the part touches the side that the human touches. The distance is exact while the human touches; both fade in and out.

OWN = 1 + len(AXES)
"""Edges of a pair: its distance, and the coordinates of its place."""


STEEP = 4
"""Power of the strength with which π rises to that of a hard edge: half the way a hand follows the human's approach first. With 1 the jerk of the
box sample on the OP3 is 36.5 in place of 15.6 rad/s³."""


@dataclass(frozen=True)
class ContactKind(Kind):
    """A part and a body: their distance, and where the part is along the surface [m]."""

    name: str = "contact"
    form = Form.NUMERIC
    whole = True
    along: float = 400.0
    """π along the surface, over the squared leg [-]: below that of the distance, because no arm reaches every place.
    Half and double change the limbs of the OP3 in the box sample by 0.02° and keep all contacts."""
    lead: float = 0.2
    """Rise and fall time of a touch in a stream [s], which an arm needs to the body: a touch is known when the human
    arrives. In the box sample the jerk of the OP3 is 707 rad/s³ with half, 389 with double and 432 with it, and 98.7,
    96.4 and 98.0 % of the contacts are kept."""
    every: bool = False
    """Whether pairs have edges that never touch in the motion as well: a stream does not know which will."""
    pairs: tuple[tuple[str, int], ...] = ()
    scene: PlacedScene | None = None

    def targets(self, context: RetargetContext) -> Track | None:
        """Return distance 0 and the place of every touch; its data are the poses of the bodies and the normals at the places."""
        scene, around = context.scene, context.human.around
        if scene is None or around is None:
            return None
        pairs = [k for k in range(len(around.touches.pairs)) if self.every or around.touches.held[:, k].any()]
        if not pairs:
            return None
        strength = gradual(around.touches.held[:, pairs], round(RAMP * context.human.fps))
        kind = replace(self, pairs=tuple(around.touches.pairs[k] for k in pairs), scene=scene)
        target, _, priority, data = kind.sides(scene, around.touches.of(pairs), strength)
        ends = [(part, scene.names[body]) for part, body in kind.pairs for _ in range(OWN)]
        track = exact(kind, ends, target, priority, context.leg, axes=("", *AXES) * len(pairs))
        return replace(track, data=data)

    def sides(self, scene: PlacedScene, touches: Touches, strength: Floats) -> tuple[Floats, ...]:
        """Return intervals, π (T, E) and data (T, D) of touches with a strength (T, C) from 0 to 1."""
        frames, pairs, poses = len(strength), touches.pairs, scene.poses(len(strength))
        bodies = np.array([body for _, body in pairs])
        places = scene.points(bodies, touches.places, poses)
        normals = scene.directions(bodies, touches.normals, poses)
        target = np.concatenate([np.zeros((frames, len(pairs), 1)), places], axis=2).reshape(frames, -1)
        # a seat that is too high for the robot's hips would lift hard feet
        across = [[self.along if part == "pelvis" else HARD] for part, _ in pairs]
        weights = np.hstack([across, np.full((len(pairs), len(AXES)), self.along)])
        priority = (strength[..., None] ** STEEP * weights).reshape(frames, -1)
        return target, target, priority, np.hstack([poses.reshape(frames, -1), normals.reshape(frames, -1)])

    def step(self, context: StreamFrame, memory: dict[str, Any]) -> FrameTargets | None:
        """Return the same; the strength changes no faster than over the rise time."""
        scene, around = context.scene, context.human.around
        if scene is None or around is None:
            return None
        reach, last = context.seconds / self.lead, memory.get("strength", 0.0)
        memory["strength"] = np.clip(around.touches.held.astype(float), last - reach, last + reach)
        return tuple(side[0] for side in self.sides(scene, around.touches, memory["strength"]))

    def for_stream(self) -> "ContactKind":
        """Return the kind with edges of all pairs."""
        return replace(self, every=True)

    def rows(self, track: Track, state: RowState) -> MeasureRows | None:
        """Return distance and place of the parts that touch at the frame."""
        assert self.scene is not None and state.targets is not None
        lower, _, priority, data = state.targets
        active = [k for k in range(len(self.pairs)) if priority[OWN * k] > 0]
        if not active:
            return None
        poses, normals = poses_of(data, self.scene), data[7 * len(self.scene) :].reshape(-1, 3)
        found = [self._pair(k, poses, state, (lower[OWN * k + 1 : OWN * (k + 1)], unit(normals[k]))) for k in active]
        values, slopes, edges = zip(*found, strict=True)
        return MeasureRows(np.concatenate(values), np.concatenate(slopes), np.concatenate(edges))

    def _pair(
        self, pair: int, poses: Floats, state: RowState, face: tuple[Floats, Floats]
    ) -> tuple[Floats, Floats, np.ndarray]:
        """Return values (4,), slopes (4, nv) and edges of one pair."""
        assert self.scene is not None
        part, body = self.pairs[pair]
        site, among = state.match.anatomy.sites[part], self.scene.among(state.robot)
        geoms = state.memory.get(f"geoms of {part}")
        if geoms is None:
            geoms = among.geoms_of(links_of(part, state.robot, state.match.anatomy))
            state.memory[f"geoms of {part}"] = geoms
        place, normal = face
        distance, away = among.to_side(state.qpos, poses, geoms, body, face)
        x, slope = among.point(site.body, site.offset)
        along = np.eye(3) - np.outer(normal, normal)
        values = np.append(distance, place + along @ (x - place))
        return values, np.vstack([away, along @ slope]), OWN * pair + np.arange(OWN)
