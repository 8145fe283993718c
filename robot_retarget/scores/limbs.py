"""Figures of limbs, waist and root against the human.

Each body is seen in the heading frame of its pelvis (the hip line). Unit and range stand at each figure.

limb_deg: angle between a bone of the human and the robot's, over upper and lower arms, thighs, shins and the trunk

    θ = arccos(û · v̂)        unit: degree, range: 0 to 180

Source: the direction error of motion retargeting, as in GMR's and this project's comparisons.

twist_deg: the same angle between the shoulder lines, a twisted waist. Source: waist jumps are the artefact that GMR's authors blame for
failures of trained policies.

root_path_err: distance of the robot's pelvis from the human's, scaled path

    mean_t ‖(p_t − p_0) − (ℓ'/ℓ) R (h_t − h_0)‖ / ℓ'        unit: leg lengths, range: 0 and more

p the robot's pelvis, h the human's, ℓ' and ℓ their legs, R the turn between their first headings. Source: this project.

body_pos_err_cm: distance between the robot's keypoints and the human's after the human has been given the robot's bone lengths

    mean over keypoints and frames of ‖y_k − ŷ_k‖,   ŷ_k = ŷ_parent + ℓ'_k û_k,   ŷ_pelvis = y_pelvis        unit: cm, range: 0 and more

û_k the direction of the human's bone, turned from the human's heading to the robot's, ℓ'_k the robot's bone. Source: SPARK's mean body
position error [arXiv 2603.11480, Table I]. SPARK calibrates a human URDF to the robot by hand and compares its bodies; here the bone
lengths of the keypoints are the calibration, so figures compare in kind, not to the digit.
"""

import numpy as np

from robot_retarget.base.arrays import Floats, unit
from robot_retarget.scores.figure import Figure, Value, measures
from robot_retarget.scores.pair import Pair, angles_between
from robot_retarget.scores.subject import Subject


@measures(
    Figure("limb_deg_mean", "deg", 2, "angle between a human bone and the robot's, mean", most=180.0),
    Figure("limb_deg_p95", "deg", 2, "the same, 95th percentile", most=180.0),
    human=True,
)
def limbs(subject: Subject) -> tuple[Value, ...]:
    """The mean and the 95th percentile over bones and frames."""
    angles = np.degrees(list(subject.pair.bone_angles().values()))
    return (angles.mean(), np.percentile(angles, 95)) if angles.size else (None, None)


@measures(
    Figure("twist_deg_mean", "deg", 2, "angle between the shoulder lines, seen from the hips, mean", most=180.0),
    Figure("twist_deg_max", "deg", 2, "the same, largest", most=180.0),
    human=True,
)
def twist(subject: Subject) -> tuple[Value, ...]:
    """The mean and the largest over the frames."""
    pair = subject.pair
    if not pair.has("l_shoulder", "r_shoulder"):
        return None, None
    left, right = pair.index("l_shoulder"), pair.index("r_shoulder")
    angles = np.degrees(angles_between(*(x[:, left] - x[:, right] for x in pair.seen)))
    return angles.mean(), angles.max()


@measures(Figure("root_path_err", "legs", 3, "distance of the pelvis from the human's scaled path, mean"), human=True)
def root_path(subject: Subject) -> tuple[Value, ...]:
    """The mean over the frames."""
    pair = subject.pair
    if not pair.has("pelvis"):
        return (None,)
    human, robot = (x[:, pair.index("pelvis")] for x in (pair.human, pair.robot))
    scaled = pair.match.leg_ratio * (human - human[0]) @ pair.turn[0].T
    return (np.linalg.norm(robot - robot[0] - scaled, axis=1).mean() / pair.match.robot_leg,)


@measures(
    Figure("body_pos_err_cm", "cm", 2, "distance of keypoints from the human of the robot's bone lengths (SPARK)"),
    human=True,
)
def body_position(subject: Subject) -> tuple[Value, ...]:
    """The mean distance over all keypoints but the pelvis."""
    pair = subject.pair
    off = np.linalg.norm(pair.robot - _calibrated(pair), axis=2)[:, pair.match.parents >= 0]
    return (100 * off.mean() if off.size else None,)


def _calibrated(pair: Pair) -> Floats:
    """(T, K, 3) the human with the robot's bones, hung from the robot's pelvis [m]."""
    placed, lengths = pair.robot.copy(), pair.match.robot_bones
    for k, parent in enumerate(pair.match.parents.tolist()):
        if parent >= 0:
            bone = np.einsum("tij,tj->ti", pair.turn, unit(pair.human[:, k] - pair.human[:, parent]))
            placed[:, k] = placed[:, parent] + lengths[k] * bone
    return placed
