"""Distance between the robot's keypoints and the human's after the human has been given the robot's bone lengths.

    e = mean over keypoints and frames of ‖y_k − ŷ_k‖,   ŷ_k = ŷ_parent + ℓ'_k û_k,   ŷ_pelvis = y_pelvis

û_k the direction of the human's bone, turned from the human's heading to the robot's, ℓ'_k the robot's bone. Unit: cm. Range: 0 and more.
Source: SPARK's mean body position error [arXiv 2603.11480, Table I]. SPARK calibrates a human URDF to the robot by hand and
compares its bodies; here the bone lengths of the keypoints are the calibration, so figures compare in kind, not to the digit.
"""

import numpy as np

from robot_retarget.arrays import Floats, unit
from robot_retarget.score.figure import Figure, Measure, Value
from robot_retarget.score.pair import Pair
from robot_retarget.score.subject import Subject


def measure(subject: Subject) -> tuple[Value, ...]:
    """The mean distance over all keypoints but the pelvis."""
    pair = subject.pair
    assert pair is not None
    off = np.linalg.norm(pair.robot - _calibrated(pair), axis=2)[:, pair.parents >= 0]
    return (100 * off.mean() if off.size else None,)


def _calibrated(pair: Pair) -> Floats:
    """(T, K, 3) the human with the robot's bones, hung from the robot's pelvis [m]."""
    turn = np.swapaxes(pair.headings[1], 1, 2) @ pair.headings[0]
    placed, lengths = pair.robot.copy(), pair.bones[1]
    for k, parent in enumerate(pair.parents.tolist()):
        if parent >= 0:
            bone = np.einsum("tij,tj->ti", turn, unit(pair.human[:, k] - pair.human[:, parent]))
            placed[:, k] = placed[:, parent] + lengths[k] * bone
    return placed


MEASURE = Measure(
    (Figure("body_pos_err_cm", "cm", 2, "distance of keypoints from the human of the robot's bone lengths (SPARK)"),),
    measure,
    human=True,
)
