"""Contact: a part that touches a body of the scene touches it on the robot, at the same place of the body.

    d(link, face) = 0,    (I − n nᵀ)(x − p) = 0

with x the keypoint, p the place of the human's touch and n the normal of the surface there, fixed in the frame of the body
while the human's part stays on one place: the part does not slide. The face is the side of the body across n, or the plane
through p where another side is nearer, so that the part touches the side that the human touches. The distance is exact while the human touches; both fade in and out.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.ndimage import maximum_filter1d, uniform_filter1d

from robot_retarget.base.arrays import Floats, unit
from robot_retarget.graph.kind import (
    AXES,
    Form,
    FrameTargets,
    Kind,
    MeasureRows,
    RetargetContext,
    RowState,
    StreamFrame,
    Track,
)
from robot_retarget.graph.kinds.clearance import POSE, links_of, pose_ends, poses_of
from robot_retarget.graph.placed_scene import PlacedScene
from robot_retarget.graph.track import HARD
from robot_retarget.graph.weights import RAMP
from robot_retarget.human.touches import Touches

NORMAL = ("nx", "ny", "nz")
OWN = 1 + len(AXES) + len(NORMAL)
"""Edges of a pair: its distance, the coordinates of its place, and the normal there, which no row can miss."""


STEEP = 4
"""Power of the strength with which π rises to that of a hard edge: half the way a hand follows the human's approach first."""


@dataclass(frozen=True)
class ContactKind(Kind):
    """A part and a body: their distance, and where the part is along the surface [m]."""

    name: str = "contact"
    form = Form.NUMERIC
    whole = True
    along: float = 400.0
    """π along the surface, over the squared leg [-]: below that of the distance, because no arm reaches every place."""
    lead: float = 0.2
    """Rise and fall time of a touch in a stream [s], which an arm needs to the body: a touch is known when the human arrives."""
    every: bool = False
    """Whether pairs have edges that never touch in the motion as well: a stream does not know which will."""
    pairs: tuple[tuple[str, int], ...] = ()
    scene: PlacedScene | None = None

    def targets(self, context: RetargetContext) -> Track | None:
        """Return distance 0 and the place of every touch, with the poses of the bodies."""
        scene, around = context.scene, context.human.around
        if scene is None or around is None:
            return None
        pairs = [k for k in range(len(around.touches.pairs)) if self.every or around.touches.held[:, k].any()]
        if not pairs:
            return None
        strength = _gradual(around.touches.held[:, pairs], round(RAMP * context.human.fps))
        kind = replace(self, pairs=tuple(around.touches.pairs[k] for k in pairs), scene=scene)
        lower, priority = kind.sides(scene, around.touches.of(pairs), strength)
        ends = [(part, scene.names[body]) for part, body in kind.pairs for _ in range(OWN)] + pose_ends(scene)
        axes = ("", *AXES, *NORMAL) * len(pairs) + POSE * len(scene)
        return Track(kind, tuple(ends), lower, lower, priority, np.full(len(ends), context.leg), axes)

    def sides(self, scene: PlacedScene, touches: Touches, strength: Floats) -> tuple[Floats, Floats]:
        """Return the targets and π (T, E) of touches with a strength (T, C) from 0 to 1."""
        frames, pairs, poses = len(strength), touches.pairs, scene.poses(len(strength))
        bodies = np.array([body for _, body in pairs])
        places = scene.points(bodies, touches.places, poses)
        normals = scene.directions(bodies, touches.normals, poses)
        target = np.concatenate([np.zeros((frames, len(pairs), 1)), places, normals], axis=2).reshape(frames, -1)
        # a seat that is too high for the robot's hips would lift hard feet
        exact = [[self.along if part == "pelvis" else HARD] for part, _ in pairs]
        weights = np.hstack([exact, np.full((len(pairs), len(AXES)), self.along), np.zeros((len(pairs), len(NORMAL)))])
        priority = (strength[..., None] ** STEEP * weights).reshape(frames, -1)
        still = np.zeros((frames, len(POSE) * len(scene)))
        return np.hstack([target, poses.reshape(frames, -1)]), np.hstack([priority, still])

    def step(self, context: StreamFrame, memory: dict[str, Any]) -> FrameTargets | None:
        """Return the same; the strength changes no faster than over the rise time."""
        scene, around = context.scene, context.human.around
        if scene is None or around is None:
            return None
        reach, last = context.seconds / self.lead, memory.get("strength", 0.0)
        memory["strength"] = np.clip(around.touches.held.astype(float), last - reach, last + reach)
        lower, priority = self.sides(scene, around.touches, memory["strength"])
        return lower[0], lower[0], priority[0]

    def for_stream(self) -> "ContactKind":
        """Return the kind with edges of all pairs."""
        return replace(self, every=True)

    def rows(self, track: Track, state: RowState) -> MeasureRows | None:
        """Return distance and place of the parts that touch at the frame."""
        assert self.scene is not None and state.targets is not None
        lower, _, priority = state.targets
        active = [k for k in range(len(self.pairs)) if priority[OWN * k] > 0]
        if not active:
            return None
        poses = poses_of(lower, self.scene)
        found = [self._pair(k, poses, state, lower[OWN * k + 1 : OWN * (k + 1)]) for k in active]
        values, slopes, edges = zip(*found, strict=True)
        return MeasureRows(np.concatenate(values), np.concatenate(slopes), np.concatenate(edges))

    def _pair(self, pair: int, poses: Floats, state: RowState, target: Floats) -> tuple[Floats, Floats, np.ndarray]:
        """Return values (4,), slopes (4, nv) and edges of one pair."""
        assert self.scene is not None
        part, body = self.pairs[pair]
        site, among = state.match.anatomy.sites[part], self.scene.among(state.robot)
        geoms = state.memory.get(f"geoms of {part}")
        if geoms is None:
            geoms = among.geoms_of(links_of(part, state.robot, state.match.anatomy))
            state.memory[f"geoms of {part}"] = geoms
        place, normal = target[:3], unit(target[3:])
        distance, away = among.to_side(state.qpos, poses, geoms, body, (place, normal))
        x, slope = among.point(site.body, site.offset)
        along = np.eye(3) - np.outer(normal, normal)
        values = np.append(distance, place + along @ (x - place))
        return values, np.vstack([away, along @ slope]), OWN * pair + np.arange(1 + len(AXES))


def _gradual(held: np.ndarray, frames: int) -> Floats:
    """Return (T, C) strengths that rise to 1 before a touch and fall after it, within some frames."""
    width = 2 * frames + 1
    most = maximum_filter1d(held.astype(float), width, axis=0, mode="nearest")
    return np.clip(uniform_filter1d(most, width, axis=0, mode="nearest"), 0.0, 1.0)
