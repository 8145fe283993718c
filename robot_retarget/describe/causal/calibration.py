"""What a stream knows of a performer beforehand: the graph of some of his frames, and the constants that they show."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from robot_retarget.arrays import Floats, Ints
from robot_retarget.describe.graph import Graph
from robot_retarget.describe.reading.feet import seen_foot
from robot_retarget.describe.reading.rotations import constant_between, own_joint
from robot_retarget.describe.reading.segments import trunk_frames
from robot_retarget.robot.kinematics import matrices

_CARRIERS = {"l_foot": "l_ankle", "r_foot": "r_ankle"}
"""The keypoint whose joint turns a segment, where it has another name."""


@dataclass(frozen=True, eq=False)
class Calibration:
    """Constants of one performer on one robot."""

    graph: Graph
    """Of the frames that tell them."""
    mean: Floats
    """(K, J) that makes keypoints of joints."""
    floor: float
    """Height of the floor in the source [m]."""
    joints: Ints
    """(S,) the joint that turns each segment; none where the source has no rotations."""
    constants: Floats
    """(S, 3, 3) between what is seen of a segment and its forward, left and up."""

    @property
    def turned(self) -> bool:
        """Whether the source has rotations."""
        return len(self.joints) > 0

    def keypoints(self, positions: Floats) -> Floats:
        """(K, 3) of joints (J, 3), the floor at z = 0 [m]."""
        return self.mean @ positions - [0.0, 0.0, self.floor]

    def segments(self, x: Floats, rotations: Floats | None) -> dict[str, Floats]:
        """Per segment (1, 3, 3), of keypoints (K, 3) or of the joints' rotations (J, 4)."""
        names = tuple(self.graph.human.segments)
        if self.turned and rotations is not None:
            seen = matrices(rotations[self.joints])
        else:
            shown = shown_segments({k: x[None, i] for i, k in enumerate(self.graph.match.keypoints)})
            seen = np.stack([shown[name][0] for name in names]) if names else np.zeros((0, 3, 3))
        return dict(zip(names, (seen @ self.constants)[:, None], strict=True))


def calibration_of(graph: Graph) -> Calibration:
    """What the frames of a graph tell."""
    match, motion, human = graph.match, graph.motion, graph.human
    raw = match.human_positions(motion)
    mean = np.zeros((len(match.keypoints), len(motion.skeleton)))
    for row, keypoint in zip(mean, match.keypoints, strict=True):
        marked = list(match.recognition.marks[keypoint].joints)
        row[marked] = 1 / len(marked)
    joints = np.zeros(0, dtype=np.int64)
    if motion.rotations is not None:
        joints = np.array(
            [own_joint(motion, match, _CARRIERS.get(name, name)) for name in human.segments], dtype=np.int64
        )
    seen = _seen(graph, joints)
    constants = [constant_between(seen[name], frames) for name, frames in human.segments.items()]
    floor = float(np.median((raw - human.positions)[:, :, 2]))
    return Calibration(graph, mean, floor, joints, np.array(constants).reshape(-1, 3, 3))


def _seen(graph: Graph, joints: Ints) -> Mapping[str, Floats]:
    """(T, 3, 3) what the frames show of every segment."""
    motion, human = graph.motion, graph.human
    if motion.rotations is None:
        return shown_segments({k: human.positions[:, i] for i, k in enumerate(graph.match.keypoints)})
    turns = [Rotation.from_quat(motion.rotations[:, j], scalar_first=True).as_matrix() for j in joints]
    return dict(zip(human.segments, turns, strict=True))


def shown_segments(x: dict[str, Floats]) -> dict[str, Floats]:
    """(T, 3, 3) what keypoints (T, 3) show of pelvis, chest, head and feet."""
    frames = trunk_frames(x)
    for side in "lr":
        knee, ankle, toe = (x.get(f"{side}_{k}") for k in ("knee", "ankle", "toe"))
        if knee is not None and ankle is not None and toe is not None:
            frames[f"{side}_foot"] = seen_foot(knee, ankle, toe)
    return frames
