"""Rotations of the source's joints, and the constant between a joint and its segment."""

import numpy as np
from scipy.spatial.transform import Rotation

from robot_retarget.arrays import Floats
from robot_retarget.human.match import Match
from robot_retarget.human.skeleton import Motion

TURNED_BY = {"l_foot": "l_ankle", "r_foot": "r_ankle"}
"""Keypoints whose joints turn a segment with another name."""
UP = np.array([0.0, 0.0, 1.0])
ARBITRARY = 1.2
"""A rotation that differs by more from the one that the body shows carries no information [rad]: of a rest pose, of fingers,
of a foot against the axis of its knee."""


def own_rotation(motion: Motion, match: Match, keypoint: str) -> Floats | None:
    """Return the rotations (T, 3, 3) of the joint of a keypoint, or None for a source without rotations.

    Args:
        motion: the human.
        match: keypoints that human and robot share.
        keypoint: name of the keypoint.
    """
    if motion.rotations is None:
        return None
    joint = own_joint(motion, match, keypoint)
    return Rotation.from_quat(motion.rotations[:, joint], scalar_first=True).as_matrix()


def own_joint(motion: Motion, match: Match, keypoint: str) -> int:
    """Return the joint of a keypoint, or the joint that carries all its joints.

    Args:
        motion: the human.
        match: keypoints that human and robot share.
        keypoint: name of the keypoint.
    """
    joints = match.recognition.marks[keypoint].joints
    carriers = [set(motion.skeleton.above(joint)[1:]) for joint in joints]
    return joints[0] if len(joints) == 1 else max(set.intersection(*carriers), default=0)


def constant_between(own: Floats, wanted: Floats) -> Floats:
    """Return the rotation C (3, 3) that minimises Σ ‖own C − wanted‖² over the frames (orthogonal Procrustes).

    Args:
        own: (T, 3, 3) rotations of the joint.
        wanted: (T, 3, 3) rotations of the segment.
    """
    u, _, vt = np.linalg.svd(np.einsum("tji,tjk->ik", own, wanted))
    return u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))]) @ vt
