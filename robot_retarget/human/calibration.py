"""Constants of one performer, which a stream needs beforehand: they are read off calibration frames."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from robot_retarget.arrays import Floats, Ints
from robot_retarget.human.features import HumanFeatures
from robot_retarget.human.feet import foot_axes
from robot_retarget.human.match import Match
from robot_retarget.human.rotations import TURNED_BY, constant_between, own_joint
from robot_retarget.human.segments import trunk_frames
from robot_retarget.human.skeleton import Motion
from robot_retarget.robot.kinematics import matrices


@dataclass(frozen=True, eq=False)
class Calibration:
    """Constants of one performer, matched with one robot."""

    match: Match
    features: HumanFeatures
    """Of the calibration frames."""
    mean: Floats
    """(K, J) matrix that maps joints to keypoints."""
    floor: float
    """Height of the floor in the source [m]."""
    joints: Ints
    """(S,) joint that turns each segment; empty where the source has no rotations."""
    constants: Floats
    """(S, 3, 3) from the measured axes of a segment to its forward, left and up."""

    @property
    def turned(self) -> bool:
        """Whether the source has rotations."""
        return len(self.joints) > 0

    def keypoints(self, positions: Floats) -> Floats:
        """Return keypoints (K, 3) with the floor at z = 0, from joints (J, 3) [m]."""
        return self.mean @ positions - [0.0, 0.0, self.floor]

    def segments(self, x: Floats, rotations: Floats | None) -> dict[str, Floats]:
        """Return the axes (1, 3, 3) of every segment.

        Args:
            x: (K, 3) keypoints [m].
            rotations: (J, 4) of the joints, w x y z, or None.
        """
        names = tuple(self.features.segments)
        if self.turned and rotations is not None:
            measured = matrices(rotations[self.joints])
        else:
            visible = visible_segments({k: x[None, i] for i, k in enumerate(self.match.keypoints)})
            measured = np.stack([visible[name][0] for name in names]) if names else np.zeros((0, 3, 3))
        return dict(zip(names, (measured @ self.constants)[:, None], strict=True))


def calibrate(motion: Motion, match: Match, features: HumanFeatures) -> Calibration:
    """Fit the constants of a performer to calibration frames.

    Args:
        motion: the calibration frames.
        features: of the same frames.
    """
    joints = _carrying_joints(motion, match, features)
    measured = _measured_axes(motion, match, features, joints)
    constants = [constant_between(measured[name], axes) for name, axes in features.segments.items()]
    floor = float(np.median((match.human_positions(motion) - features.positions)[:, :, 2]))
    mean = _keypoint_matrix(match, len(motion.skeleton))
    return Calibration(match, features, mean, floor, joints, np.array(constants).reshape(-1, 3, 3))


def _keypoint_matrix(match: Match, joints: int) -> Floats:
    """Return the matrix (K, J) that maps joints to keypoints: the mean of the joints that mark each."""
    mean = np.zeros((len(match.keypoints), joints))
    for row, keypoint in zip(mean, match.keypoints, strict=True):
        marked = list(match.recognition.marks[keypoint].joints)
        row[marked] = 1 / len(marked)
    return mean


def _carrying_joints(motion: Motion, match: Match, features: HumanFeatures) -> Ints:
    """Return the joint (S,) that turns each segment; empty for a motion without rotations."""
    if motion.rotations is None:
        return np.zeros(0, dtype=np.int64)
    joints = [own_joint(motion, match, TURNED_BY.get(name, name)) for name in features.segments]
    return np.array(joints, dtype=np.int64)


def _measured_axes(motion: Motion, match: Match, features: HumanFeatures, joints: Ints) -> dict[str, Floats]:
    """Return the axes (T, 3, 3) that the frames show of every segment: of its joint, else of its keypoints."""
    if motion.rotations is None:
        return visible_segments({k: features.positions[:, i] for i, k in enumerate(match.keypoints)})
    turns = [Rotation.from_quat(motion.rotations[:, j], scalar_first=True).as_matrix() for j in joints]
    return dict(zip(features.segments, turns, strict=True))


def visible_segments(x: dict[str, Floats]) -> dict[str, Floats]:
    """Return the axes (T, 3, 3) of pelvis, chest, head and feet that keypoints (T, 3) show."""
    frames = trunk_frames(x)
    for side in "lr":
        knee, ankle, toe = (x.get(f"{side}_{k}") for k in ("knee", "ankle", "toe"))
        if knee is not None and ankle is not None and toe is not None:
            frames[f"{side}_foot"] = foot_axes(knee, ankle, toe)
    return frames
