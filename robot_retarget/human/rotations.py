"""Rotations of the source's joints, and the constant between a joint and its segment."""

import numpy as np

from robot_retarget.base.arrays import Floats
from robot_retarget.human.match import Match
from robot_retarget.human.motion import Motion

TURNED_BY = {"l_foot": "l_ankle", "r_foot": "r_ankle"}
"""Keypoints whose joints turn a segment with another name."""
UP = np.array([0.0, 0.0, 1.0])
ARBITRARY = 1.2
"""A rotation that differs by more from the one that the body shows carries no information [rad]: of a rest pose, of fingers,
of a foot against the axis of its knee."""


def own_rotation(motion: Motion, match: Match, segment: str) -> Floats | None:
    """Return the rotations (T, 3, 3) of the joint that turns a segment, or None for a source without rotations."""
    if motion.rotations is None:
        return None
    return matrices_of(motion.rotations[:, carrying_joint(motion, match, segment)])


def matrices_of(rotations: Floats) -> Floats:
    """Return the matrices (…, 3, 3) of quaternions (…, 4), w x y z of any length: R = (w² − u·u) I + 2 u uᵀ + 2 w [u]×."""
    size = np.vecdot(rotations, rotations)
    pairs = rotations[..., :, None] * (rotations / size[..., None])[..., None, :]
    return (pairs.reshape(*size.shape, 16) @ _PRODUCTS).reshape(*size.shape, 3, 3)


def _products() -> Floats:
    """Return (16, 9) shares of the products of a quaternion's components in its matrix."""
    shares = np.zeros((4, 4, 3, 3))
    shares[0, 0] = np.eye(3)
    for k in range(3):
        shares[k + 1, k + 1] = -np.eye(3)
        shares[0, k + 1] = 2 * np.cross(np.eye(3)[k], np.eye(3)).T
    for i, j in np.ndindex(3, 3):
        shares[i + 1, j + 1, i, j] += 2.0
    return shares.reshape(16, 9)


_PRODUCTS = _products()


def carrying_joint(motion: Motion, match: Match, segment: str) -> int:
    """Return the joint that turns a segment: its keypoint's, or the one that carries all joints of the keypoint."""
    joints = match.recognition.marks[TURNED_BY.get(segment, segment)].joints
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
