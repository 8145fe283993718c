"""The human motion as edges: what every pair, bone, segment and the path of the pelvis should be on the robot.

All wishes are distances, or their limit: a compass edge joins a keypoint to a beacon at distance R along a fixed
direction; as R grows, the difference of two such distances becomes the coordinate of their difference vector.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.ndimage import maximum_filter1d, uniform_filter1d

from robot_retarget.arrays import Floats, Ints, leftward, unit
from robot_retarget.describe.contacts import stances
from robot_retarget.describe.ground import grounded
from robot_retarget.describe.match import Match
from robot_retarget.describe.segments import facing, heading, human_frames
from robot_retarget.dgp.adapt import normalised_distances, path_weights
from robot_retarget.keypoints import ARM
from robot_retarget.motion import Motion

NEAR_REACH = 0.35
"""A pair whose normalised distance is of this size begins to count as near [-]."""
NEAR_GAIN = 1.6
"""How much a near pair outweighs a far one."""
TOUCH_REACH = {"head": 0.22, "hand": 0.14, "knee": 0.14}
"""A hand this near to another part, over the path between them, touches it [-]; to any other part 0.1."""

FEET_REACH = 0.045
"""The same for two feet: nearer than they pass each other in a walk [-]."""
FAINT = 0.02
"""What touches by no more does not touch [-]: a hand that swings past a hip."""
TOUCH_LEAD = 0.1
"""A touch begins to count this long before it is there, and ends this long after [s]."""


@dataclass(frozen=True)
class Weights:
    """How much each kind of edge counts; one set for all clips and robots. Every error is relative to a body length."""

    posture: float = 20.0
    """Pairwise distances over their path length."""
    touch: float = 2000.0
    """A hand and what it touches, a foot and the other, on top of their posture edge."""
    compass: float = 8.0
    """Bone directions, those of the legs most."""
    give: float = 0.028
    """Relative errors of posture edges well over this count linearly, those under it by their square [-]."""
    girdle: float = 20.0
    """Direction of the hip line, which way the body faces; that of the shoulder line a fourteenth of it."""
    marker: float = 0.3
    """Directions of the segments' forward and up; feet a third of it."""
    path: float = 4.0
    """The pelvis on its path, over the leg length."""
    rest: float = 0.0004
    """Joints as the robot stands [1/rad²]."""
    wrist: float = 0.1
    """The same of wrists, where nothing shows how a hand is turned."""


# Arms and trunks of robots have fewer hinges than a human's to follow with, so that their directions yield to distances.
# Necks follow weakly; so do toes, whose foot is a segment of its own. Clavicles and hip bones only mirror how a body is
# built and are left to the girdles.
_BONES = {"chest": 0.4, "elbow": 0.25, "hand": 0.25, "toe": 0.08, "neck": 0.03, "head": 0.03, "shoulder": 0, "hip": 0}
_GIRDLES = (("l_hip", "r_hip", 1.0), ("l_shoulder", "r_shoulder", 0.07))


@dataclass(frozen=True)
class Edges:
    """The edge table of a clip, frame by frame: who is joined never changes, what is wished does."""

    keypoints: tuple[str, ...]
    pairs: Ints
    """(E, 2) posture edges between keypoints."""
    distance: Floats
    """(T, E) δ, the wished distance [m]."""
    priority: Floats
    """(T, E) π, weight included, per squared error over the path length."""
    touching: Ints
    """Rows of the posture edges whose parts can touch, (C,)."""
    touch: Floats
    """(T, C) what they count on top when they do."""
    path_length: Floats
    """(E,) τ on the robot [m]."""
    lines: Ints
    """(C, 2) compass edges: from the second keypoint to the first."""
    direction: Floats
    """(T, C, 3) wished unit vectors."""
    line_weight: Floats
    """(C,)."""
    segments: tuple[str, ...]
    """Segments with markers."""
    frames: Floats
    """(T, S, 3, 3) wished forward, left, up as columns."""
    root: Floats
    """(T, 3) wished pelvis position [m]."""
    facing: Floats
    """(T, 3, 3) how the whole body is turned; starts are made from it."""
    stances: dict[str, np.ndarray]
    """Per foot (T, 2) whether toe and heel stand: foothold edges of length 0 from frame to frame."""
    tracks: dict[str, Floats]
    """Per foot (T, 2) its ankle along the floor, as the root is carried over and nearer the other by the hips' width [m]."""

    def __len__(self) -> int:
        return len(self.root)

    def window(self, span: slice) -> "Edges":
        """The edges of some frames."""
        timed = ("distance", "priority", "touch", "direction", "frames", "root", "facing")
        cut = {name: getattr(self, name)[span] for name in timed}
        feet = {name: {foot: of[span] for foot, of in getattr(self, name).items()} for name in ("stances", "tracks")}
        return replace(self, **cut, **feet)

    def over(self, paths: Floats) -> "Edges":
        """The edges with their distances wished over paths τ (K, K) of another length [m]."""
        share = paths[self.pairs[:, 0], self.pairs[:, 1]] / self.path_length
        return replace(self, distance=self.distance * share)

    @cached_property
    def labels(self) -> list[str]:
        """Names of the posture edges, `a – b`."""
        return [f"{self.keypoints[i]} – {self.keypoints[j]}" for i, j in self.pairs]


def build_edges(motion: Motion, match: Match, weights: Weights | None = None) -> Edges:
    """Describe a motion by edges for the matched robot.

    Posture: δ = τ_B ‖x_u − x_v‖ / τ_A of [Mucherino2017]; π is the same for all pairs, raised where one is near (that of
    the paper, which falls with the length of the path, turns limbs further for the same distances). Compass: the human's
    bone directions. Path: the pelvis, scaled by leg length, ankles on the robot's ankle height.
    """
    w = weights or Weights()
    x = grounded(match.human_positions(motion), match, motion.fps)
    pairs, distance, priority, tau, touching, touch = _posture(x, match, w, motion.fps)
    lines, line_weight = _lines(match, w)
    direction = unit(x[:, lines[:, 0]] - x[:, lines[:, 1]])
    frames = human_frames(motion, match)
    body = np.broadcast_to(facing(frames), (len(x), 3, 3))
    segments = tuple(frames)
    stacked = np.stack([frames[s] for s in segments], 1) if segments else np.zeros((len(x), 0, 3, 3))
    return Edges(
        match.keypoints,
        pairs,
        distance,
        priority,
        touching,
        touch,
        tau,
        lines,
        direction,
        line_weight,
        segments,
        stacked,
        root_path(x, match),
        body,
        stances(x, match, motion.fps, motion.contacts),
        _tracks(x, match, body),
    )


def _posture(x: Floats, match: Match, w: Weights, fps: float) -> tuple[Ints, Floats, Floats, Floats, Ints, Floats]:
    i, j = np.triu_indices(len(match.keypoints), 1)
    near_or_far = normalised_distances(x, match.parents, match.human_bones)[:, i, j]
    tau = path_weights(match.parents, match.robot_bones)[i, j]
    bone = (match.parents[j] == i) | (match.parents[i] == j)
    keep = (tau > 1e-6) & ~bone  # bones keep their length by construction
    near = np.exp(-((near_or_far / NEAR_REACH) ** 2))
    pi = 1 + NEAR_GAIN * near
    reach = np.array([_touch_reach(match.keypoints[a], match.keypoints[b]) for a, b in zip(i, j, strict=True)])
    touching = np.exp(-((near_or_far / np.maximum(reach, 1e-9)) ** 8)) * (reach > 0)
    touching = np.maximum(touching - FAINT, 0.0)
    mean = len(match.keypoints) / max(int(keep.sum()), 1)
    pi = w.posture * mean * pi
    can = np.flatnonzero(reach[keep] > 0)
    return (
        np.stack([i, j], 1)[keep],
        (tau * near_or_far)[:, keep],
        pi[:, keep],
        tau[keep],
        can,
        w.touch * _foreseen(touching[:, keep][:, can], round(TOUCH_LEAD * fps)),
    )


def _foreseen(touching: Floats, frames: int) -> Floats:
    """How much pairs touch (T, C), reached and left gently: the most of the frames around, then their mean."""
    width = 2 * frames + 1
    most = maximum_filter1d(touching, width, axis=0, mode="nearest")
    return np.maximum(uniform_filter1d(most, width, axis=0, mode="nearest"), 0.0)  # its running sum may end at −1e-17


def _touch_reach(a: str, b: str) -> float:
    """How near two keypoints are when their parts touch, over the path between them; 0 where they cannot."""
    if {a[2:], b[2:]} <= {"ankle", "toe"} and a[0] != b[0]:
        return FEET_REACH
    for hand, other in ((a, b), (b, a)):
        own_arm = other[:2] == hand[:2] and other[2:] in ARM
        if hand.endswith("_hand") and not own_arm:
            return TOUCH_REACH.get(other.split("_")[-1], 0.1)
    return 0.0


def _lines(match: Match, w: Weights) -> tuple[Ints, Floats]:
    """Bones and girdles, and what their directions count."""
    lines: list[tuple[int, int, float]] = []
    for k, keypoint in enumerate(match.keypoints):
        share = _BONES.get(keypoint.split("_")[-1], 1.0)
        if match.parents[k] >= 0 and share and match.robot_bones[k] > 1e-6:
            lines.append((k, int(match.parents[k]), w.compass * share))
    for left, right, share in _GIRDLES:
        if left in match.keypoints and right in match.keypoints:
            lines.append((match.index(left), match.index(right), w.girdle * share))
    return np.array([line[:2] for line in lines], np.int64).reshape(-1, 2), np.array([line[2] for line in lines])


def _tracks(x: Floats, match: Match, body: Floats) -> dict[str, Floats]:
    """Where the scaled ankles would be, were both hips in the middle: a robot puts them as far apart as its own are."""
    ankles = {foot: f"{foot}_ankle" for foot in "lr" if f"{foot}_ankle" in match.keypoints}
    if not {"pelvis", "l_hip", "r_hip"} <= set(match.keypoints):
        return {}
    pelvis, left, right = (match.index(k) for k in ("pelvis", "l_hip", "r_hip"))
    apart = float(np.median(np.linalg.norm(x[:, left] - x[:, right], axis=1)))
    aside = leftward(heading(body)) * apart / 2
    inward = {"l": -aside, "r": aside}
    start = x[0, pelvis, :2]
    return {foot: (x[:, match.index(k), :2] - start + inward[foot]) * match.leg_ratio for foot, k in ankles.items()}


def root_path(x: Floats, match: Match) -> Floats:
    """(T, 3) the human pelvis, scaled by leg length, starting above the origin, its ankles at the robot's height [m]."""
    pelvis = x[:, match.index("pelvis")] if "pelvis" in match.keypoints else x.mean(axis=1)
    path = (pelvis - [*pelvis[0, :2], 0.0]) * match.leg_ratio
    ankles = [match.index(k) for k in ("l_ankle", "r_ankle") if k in match.keypoints]
    if ankles:
        lowest = np.quantile(x[:, ankles, 2].min(axis=1), 0.05)
        path[:, 2] += match.ankle_height - lowest * match.leg_ratio
    return path
