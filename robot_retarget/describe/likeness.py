"""How like the human a robot moves: directions of limbs, contacts, pace, steps and path, at the human's own moments."""

from collections.abc import Collection
from dataclasses import dataclass
from typing import Any

import numpy as np

from robot_retarget.arrays import Floats, Ints, unit
from robot_retarget.describe.graph import Graph
from robot_retarget.describe.path import pelvis_path
from robot_retarget.robot import world_points

PARTS = {"arms": ("elbow", "hand"), "trunk": ("chest",), "legs": ("knee", "ankle")}
"""The keypoints at the ends of the bones of each part."""
KEPT = 0.04
"""A contact is kept where the robot's hand is no farther than this more than the human's, over the path between [-]."""


@dataclass(frozen=True, eq=False)
class Likeness:
    """Of a robot's motion to the human's it comes from."""

    angles: dict[str, Floats]
    """Per bone, named by the keypoint it ends in, (T,) the angle between the human's and the robot's, each seen from its own
    pelvis' heading [rad]."""
    contacts: float | None
    """Share of the human's contacts of hands that the robot makes too; None where there are none."""
    slowdown: float = 1.0
    """Time it takes, over the human's."""
    stride: float = 1.0
    """Length of its steps, over the scaled human's."""
    legs: str = "follow"
    """`follow` the human's, or `stand`: both feet in place, where legs, steps and path are not compared."""
    path: float | None = None
    """How far the pelvis is from the human's scaled path, on the mean, over that path's length or a leg [-]."""
    unfinished: float = 0.0
    """Share of the frames at which the solver was not done."""

    def part(self, name: str) -> float | None:
        """The mean angle of a part's bones [rad]; None where the robot lacks them."""
        bones = [angle for bone, angle in self.angles.items() if bone.split("_")[-1] in PARTS[name]]
        return float(np.mean(bones)) if bones else None

    def worst(self) -> tuple[str, float]:
        """The bone that is furthest off on the mean, and by how much [rad]."""
        means = {bone: float(angle.mean()) for bone, angle in self.angles.items()}
        return max(means.items(), key=lambda item: item[1]) if means else ("", 0.0)

    @property
    def sentence(self) -> str:
        """How like it is, in a line."""
        parts = ((name, self.part(name)) for name in PARTS)
        off = ", ".join(f"{name} {np.degrees(angle):.0f}°" for name, angle in parts if angle is not None)
        pace = f", {self.slowdown:.1f} times as slow" if self.slowdown > 1.05 else ""
        return f"{off} off the human's on the mean{pace}"

    def figures(self) -> dict[str, Any]:
        """As reports have them: angles [rad], shares, factors."""
        bone, off = self.worst()
        parts = {f"limb_rad_{name}": _rounded(self.part(name)) for name in PARTS}
        return {
            **parts,
            "limb_rad": _rounded(float(np.mean([angle.mean() for angle in self.angles.values()])))
            if self.angles
            else None,
            "limb_rad_worst": _rounded(off),
            "limb_worst": bone,
            "contacts_lost": None if self.contacts is None else round(1 - self.contacts, 3),
            "slowdown": round(self.slowdown, 3),
            "stride": round(self.stride, 3),
            "steps_shortened": None if self.legs == "stand" else round(1 - self.stride, 3),
            "path_off": None if self.legs == "stand" else _rounded(self.path),
            "unfinished_share": round(self.unfinished, 3),
            "legs": self.legs,
        }


def likeness_of(
    graph: Graph,
    qpos: Floats,
    *,
    slowdown: float = 1.0,
    stride: float = 1.0,
    legs: str = "follow",
    unfinished: float = 0.0,
) -> Likeness:
    """Compare configurations (T, nq) with the human of a graph, frame by frame; the rest is known to who asks."""
    match, human = graph.match, graph.human.positions
    robot = world_points(graph.robot, match.points, qpos)
    compared = PARTS.keys() - ({"legs"} if legs == "stand" else set())
    angles = bone_angles(human, robot, match.keypoints, match.parents, compared)
    path = _path_off(graph, robot)
    return Likeness(angles, _contacts_kept(graph, robot), slowdown, stride, legs, path, unfinished)


def bone_angles(
    human: Floats, robot: Floats, keypoints: tuple[str, ...], parents: Ints, compared: Collection[str] = tuple(PARTS)
) -> dict[str, Floats]:
    """Per bone of the compared `PARTS` the angle between the human's and the robot's: θ = arccos(û · v̂).

    Each bone is seen from the heading of its own pelvis, the hip line.

    Args:
        human: (T, K, 3) keypoints [m].
        robot: (T, K, 3) keypoints [m].
        parents: (K,) index of each keypoint's parent, −1 at the root.

    Returns:
        (T,) angles [rad] by the keypoint in which a bone ends.
    """
    ends, angles = {end for part in compared for end in PARTS[part]}, {}
    seen = [_from_pelvis(x, keypoints) for x in (human, robot)]
    for k, keypoint in enumerate(keypoints):
        parent = int(parents[k])
        if parent >= 0 and keypoint.split("_")[-1] in ends:
            one, other = (unit(x[:, k] - x[:, parent]) for x in seen)
            angles[keypoint] = np.arccos(np.clip((one * other).sum(axis=1), -1.0, 1.0))
    return angles


def _from_pelvis(x: Floats, keypoints: tuple[str, ...]) -> Floats:
    """Keypoints (T, K, 3) turned so that the hip line lies across."""
    if not {"l_hip", "r_hip"} <= set(keypoints):
        return x
    across = x[:, keypoints.index("l_hip"), :2] - x[:, keypoints.index("r_hip"), :2]
    c, s = unit(across).T
    turn = np.zeros((len(x), 3, 3))
    turn[:, 0, 0], turn[:, 0, 1], turn[:, 1, 0], turn[:, 1, 1], turn[:, 2, 2] = c, s, -s, c, 1.0
    return np.einsum("tij,tkj->tki", turn, x)


def _path_off(graph: Graph, robot: Floats) -> float:
    """The mean of ‖Δp − Δh‖ / max(L, ℓ): how far pelvis p and scaled human h, L its way, have come since the first frame."""
    match = graph.match
    wished = pelvis_path(graph.human, match)[:, :2]
    pelvis = robot[:, match.index("pelvis") if "pelvis" in match.keypoints else 0, :2]
    way = float(np.linalg.norm(np.diff(wished, axis=0), axis=1).sum())
    off = np.linalg.norm((pelvis - pelvis[0]) - (wished - wished[0]), axis=1)
    return float(off.mean()) / max(way, match.robot_leg)


def _contacts_kept(graph: Graph, robot: Floats) -> float | None:
    """Of what touches in the human's motion, the share that is as near on the robot."""
    track = graph.kinds.get("touch")
    if track is None:
        return None
    names = graph.match.keypoints
    i, j = ([names.index(ends[k]) for ends in track.ends] for k in (0, 1))
    touching = track.priority > track.priority.max(initial=0.0) / 2
    if not touching.any():
        return None
    near = np.linalg.norm(robot[:, i] - robot[:, j], axis=2) / track.scale
    return float((near <= track.lower / track.scale + KEPT)[touching].mean())


def _rounded(value: float | None) -> float | None:
    return None if value is None else round(value, 4)
