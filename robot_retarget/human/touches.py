"""Where parts of the human touch the bodies around: found by distance, held in the frame of the body.

A part touches a body while any of its joints is within a thickness of flesh of the surface: a joint lies under the skin, and captures err
by centimetres. The place of a touch is the point of the surface nearest to the part's keypoint. A part that stays on one
place keeps the median of it, so that the robot's hand does not slide where the human's does not.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.spatial.transform import Rotation

from robot_retarget.base.arrays import Bools, Floats, Ints, intervals, unit
from robot_retarget.contact.record import ContactRecord
from robot_retarget.contact.touch import body_touches
from robot_retarget.human.match import Match
from robot_retarget.human.motion import Motion
from robot_retarget.human.skeleton import Skeleton
from robot_retarget.scene.geoms import SceneModel
from robot_retarget.scene.scene import Scene
from robot_retarget.scene.shape import ShapeKind

FINGERS = 0.055
"""A hand with finger joints touches within this distance of one of them, over the leg [-] ..."""
FLESH = {"hand": 0.11, "elbow": 0.07, "knee": 0.09, "pelvis": 0.16, "toe": 0.07}
"""... and other parts within these distances of their joint: 9, 6, 7, 13 and 6 cm of flesh on an adult's leg of 0.83 m. A
hand without finger joints ends a palm's length from its wrist, or a finger's length from its knuckles [-]."""
SLIDES = 0.07
"""A touch whose place moves less than this over the leg stays on one place [-]: half and double give the same places on
the three sample scenes."""
SMOOTH_PLACE = 0.15
"""The place of a sliding touch is the mean over this time [s]: half and double move it by at most 4 and 11 mm on a box
and a chair."""
CAPTURE_SUNK = 0.12
"""Surfaces up to this height over a foot's joint are under it, over the leg [-]: captured feet sink in. Half and double
find the same ground on the three sample scenes."""
AWAY = 1.0
"""Bodies farther away are not looked at [m]."""

COLUMNS = ("held", "distance", "places", "offsets", "normals")
"""Arrays of touches."""


@dataclass(frozen=True, eq=False)
class Touches:
    """C pairs of a keypoint and a body over T frames."""

    pairs: tuple[tuple[str, int], ...]
    """(C,) keypoint, and index of the body in the scene."""
    held: Bools
    """(T, C) while the part touches the body."""
    distance: Floats
    """(T, C) distance of the keypoint from the surface [m]."""
    places: Floats
    """(T, C, 3) nearest point of the surface, in the frame of the body [m]."""
    offsets: Floats
    """(T, C, 3) from there to the keypoint, in the frame of the body [m]."""
    normals: Floats
    """(T, C, 3) outward normals of the surface there, in the frame of the body."""

    def at(self, frames: slice | np.ndarray) -> "Touches":
        """Return the touches at some frames."""
        return replace(self, **{name: getattr(self, name)[frames] for name in COLUMNS})

    def of(self, pairs: Sequence[int]) -> "Touches":
        """Return the touches of some pairs."""
        own = tuple(self.pairs[k] for k in pairs)
        return replace(self, pairs=own, **{name: getattr(self, name)[:, pairs] for name in COLUMNS})


@dataclass(frozen=True, eq=False)
class Ground:
    """The surface under the joints of the feet, K of them, over T frames."""

    keypoints: tuple[str, ...]
    """(K,) toes and ankles."""
    places: Floats
    """(T, K, 3) point of the surface under each [m]."""
    normals: Floats
    """(T, K, 3) pointing up."""
    bodies: Ints
    """(T, K) index of the body in the scene, −1 for the floor."""

    def at(self, frames: slice | np.ndarray) -> "Ground":
        """Return the ground at some frames."""
        return replace(self, places=self.places[frames], normals=self.normals[frames], bodies=self.bodies[frames])


@dataclass(frozen=True, eq=False)
class Surroundings:
    """The bodies around a human over T frames."""

    scene: Scene
    touches: Touches
    ground: Ground

    def at(self, frames: slice | np.ndarray) -> "Surroundings":
        """Return the surroundings at some frames."""
        return Surroundings(self.scene.at(frames), self.touches.at(frames), self.ground.at(frames))

    def without_stances(self, contacts: ContactRecord) -> "Surroundings":
        """Return the surroundings without touches of feet that stand, from their contact schedule: footholds hold those."""
        held = self.touches.held.copy()
        for pair, (part, _) in enumerate(self.touches.pairs):
            if part.endswith("_toe"):
                held[:, pair] &= ~contacts.of(part[0]).any(axis=1)
        return replace(self, touches=replace(self.touches, held=held))

    def levelled(self, x: Floats, match: Match) -> Floats:
        """Return keypoints (T, K, 3) with toes and ankles at their height over the ground under them [m]."""
        level = x.copy()
        level[:, [match.index(k) for k in self.ground.keypoints], 2] -= self.ground.places[..., 2]
        return level


class TouchProbe:
    """Where parts of a human are, measured from the bodies around it."""

    def __init__(self, match: Match, skeleton: Skeleton, scene: Scene):
        """Compile the bodies of a scene, and find the parts of a human that can touch them."""
        self.scene, self.match, self._model = scene, match, SceneModel(scene)
        self._parts = [k for k in match.keypoints if k.split("_")[-1] in FLESH]
        self._solid = [b for b, body in enumerate(scene.bodies) if body.shape.kind is not ShapeKind.HEIGHT_FIELD]
        self.pairs = tuple((part, b) for part in self._parts for b in self._solid)
        marks = {part: match.recognition.marks[part].joints for part in self._parts if part.endswith("_hand")}
        below = {part: [k for k in skeleton.below(*own) if k not in own] for part, own in marks.items()}
        self._fingers = {part: joints for part, joints in below.items() if joints}
        feet = tuple(f"{side}_{part}" for side in "lr" for part in ("toe", "ankle"))
        self._feet = tuple(keypoint for keypoint in feet if keypoint in match.keypoints)

    def nearness(self, keypoints: Floats, joints: Floats, poses: Floats) -> "Nearness":
        """Measure the pairs over T frames.

        Args:
            keypoints: (T, K, 3) in the order of the match [m].
            joints: (T, J, 3) [m].
            poses: (T, B, 7) of the bodies.
        """
        leg, frames = self.match.human_leg, len(keypoints)
        at = keypoints[:, [self.match.index(part) for part in self._parts]]
        distance, surface = (found[:, :, self._solid] for found in self._model.nearest(at, poses, AWAY))
        flesh = leg * np.array([FLESH[part.split("_")[-1]] for part in self._parts])
        away = distance - flesh[:, None]
        for part, fingers in self._fingers.items():
            least, k = self._model.nearest(joints[:, fingers], poses, AWAY)[0].min(axis=1), self._parts.index(part)
            knuckles = np.minimum(away[:, k], least[:, self._solid] - flesh[k])
            away[:, k] = least[:, self._solid] - FINGERS * leg if len(fingers) > 1 else knuckles
        turn = Rotation.from_quat(poses[:, self._solid, 3:].reshape(-1, 4), scalar_first=True).as_matrix()
        turn = turn.reshape(frames, 1, len(self._solid), 3, 3)
        places = np.einsum("tkbji,tkbj->tkbi", turn, surface - poses[:, None, self._solid, :3])
        offsets = np.einsum("tkbji,tkbj->tkbi", turn, at[:, :, None] - surface)
        scalars, points = (frames, len(self.pairs)), (frames, len(self.pairs), 3)
        return Nearness(
            away.reshape(scalars), distance.reshape(scalars), places.reshape(points), offsets.reshape(points)
        )

    def ground(self, keypoints: Floats, poses: Floats) -> Ground:
        """Return the surface under toes and ankles over T frames; arguments as of `nearness`."""
        points = keypoints[:, [self.match.index(k) for k in self._feet]]
        heights, normals, bodies = self._model.heights(points, poses, CAPTURE_SUNK * self.match.human_leg)
        places = np.concatenate([points[..., :2], heights[..., None]], axis=2)
        return Ground(self._feet, places, normals, bodies)


@dataclass(frozen=True, eq=False)
class Nearness:
    """How near C pairs of a part and a body are over T frames."""

    away: Floats
    """(T, C) distance beyond that of a touch [m]."""
    distance: Floats
    """(T, C) signed distance of the keypoint from the surface [m]."""
    places: Floats
    """(T, C, 3) nearest point of the surface, in the frame of the body [m]."""
    offsets: Floats
    """(T, C, 3) from there to the keypoint, in the frame of the body [m]."""

    @property
    def outward(self) -> Floats:
        """(T, C, 3) vectors along the outward normals of the surface."""
        return self.offsets * np.sign(self.distance)[..., None]


def surroundings_of(motion: Motion, match: Match, x: Floats) -> Surroundings:
    """Return the bodies around a human, where it touches them, and the ground under its feet.

    Args:
        motion: a motion with a scene.
        match: keypoints that human and robot share.
        x: (T, K, 3) keypoints in the frame of the scene [m].
    """
    assert motion.scene is not None
    probe, poses = TouchProbe(match, motion.skeleton, motion.scene), motion.scene.poses(len(motion))
    ground, near = probe.ground(x, poses), probe.nearness(x, motion.positions, poses)
    return Surroundings(motion.scene, _touches(probe.pairs, near, match.human_leg, motion.fps), ground)


def _touches(pairs: tuple[tuple[str, int], ...], near: Nearness, leg: float, fps: float) -> Touches:
    """Return the touches of a whole motion."""
    held = body_touches(near.away, leg, fps)
    places = _settled(near.places, held, SLIDES * leg, fps)
    normals = unit(_settled(near.outward, held, np.inf, fps))
    return Touches(pairs, held, near.distance, places, near.offsets, normals)


def _settled(places: Floats, held: Bools, slides: float, fps: float) -> Floats:
    """Return the places (T, C, 3), each touch that stays on one place at its median, the others smoothed."""
    settled = uniform_filter1d(places, max(1, round(SMOOTH_PLACE * fps)), axis=0, mode="nearest")
    for pair in range(places.shape[1]):
        for start, stop in intervals(held[:, pair]):
            own = places[start:stop, pair]
            median = np.median(own, axis=0)
            if np.linalg.norm(own - median, axis=1).max() < slides:
                settled[start:stop, pair] = median
    return settled
