"""Where the joints of the SMPL family are at rest, with no body model or with the user's."""

from pathlib import Path

import numpy as np

from robot_retarget.base.arrays import Floats
from robot_retarget.base.errors import MotionError
from robot_retarget.base.untrusted.arrays import load_arrays
from robot_retarget.human.readers.joint_sets import SMPL
from robot_retarget.human.skeleton import Skeleton

JOINTS = 22
"""Of the body, in the same order in SMPL, SMPL-H and SMPL-X."""
# Each joint's place in its parent in the mean body, x to the left, y up, z ahead [m]; the pelvis' in the body's frame.
# Figures: the bodies of `smpl_humanoid.xml`, the neutral SMPL body as an MJCF, in PHC and ProtoMotions.
_MEAN: dict[str, tuple[float, float, float]] = {
    "pelvis": (-0.0018, -0.2233, 0.0282),
    "left_hip": (0.0695, -0.0914, -0.0068), "right_hip": (-0.0677, -0.0905, -0.0043), "spine1": (-0.0025, 0.1090, -0.0267),
    "left_knee": (0.0343, -0.3752, -0.0045), "right_knee": (-0.0383, -0.3826, -0.0089), "spine2": (0.0055, 0.1352, 0.0011),
    "left_ankle": (-0.0136, -0.3980, -0.0437), "right_ankle": (0.0158, -0.3984, -0.0423),
    "spine3": (0.0015, 0.0529, 0.0254),
    "left_foot": (0.0264, -0.0558, 0.1193), "right_foot": (-0.0254, -0.0481, 0.1233),
    "neck": (-0.0028, 0.2139, -0.0429), "left_collar": (0.0788, 0.1217, -0.0341), "right_collar": (-0.0818, 0.1188, -0.0386),
    "head": (0.0052, 0.0650, 0.0513),
    "left_shoulder": (0.0910, 0.0305, -0.0089), "right_shoulder": (-0.0960, 0.0326, -0.0091),
    "left_elbow": (0.2596, -0.0128, -0.0275), "right_elbow": (-0.2537, -0.0133, -0.0214),
    "left_wrist": (0.2492, 0.0090, -0.0012), "right_wrist": (-0.2553, 0.0078, -0.0056),
    "left_hand": (0.0840, -0.0082, -0.0149), "right_hand": (-0.0846, -0.0061, -0.0103),
}  # fmt: skip
NAMES = tuple(SMPL)
PARENTS = np.array([-1 if (parent := SMPL[name]) is None else NAMES.index(parent) for name in NAMES])
_STATURE, _PER_BETA = 1.66, 0.1
"""Of the mean body, and how much the first shape parameter adds to it: the rule of GMR's loader of SMPL-X files [m]."""


def mean_skeleton(betas: Floats | None) -> tuple[Skeleton, str]:
    """The mean body, as tall as the first of the shape parameters says, and a sentence; limbs are right to centimetres."""
    first = float(betas[0]) if betas is not None and betas.size else 0.0
    tall = max(_STATURE + _PER_BETA * first, 0.5 * _STATURE)
    offsets = np.array([_MEAN[name] for name in NAMES]) * tall / _STATURE
    note = f"Without a body model the mean SMPL skeleton was taken, {tall:.2f} m tall; bones are right to centimetres."
    return Skeleton(NAMES, PARENTS, offsets), note


def model_skeleton(path: Path, betas: Floats | None) -> tuple[Skeleton, str]:
    """The joints of the user's body model: J (v + S β), with J `J_regressor`, v `v_template` and S `shapedirs`.

    Raises:
        MotionError: it is no `.npz` with these arrays, or they do not fit each other.
    """
    arrays = load_arrays(path)
    lacking = [key for key in ("J_regressor", "v_template") if key not in arrays]
    if lacking:
        raise MotionError(f"a body model needs the array {lacking[0]!r}; it has {', '.join(arrays)}", path)
    regressor, vertices = (np.asarray(arrays[key], dtype=float) for key in ("J_regressor", "v_template"))
    if "shapedirs" in arrays and betas is not None:
        count = min(betas.size, arrays["shapedirs"].shape[-1])
        vertices = vertices + arrays["shapedirs"][..., :count] @ betas[:count]
    if regressor.ndim != 2 or regressor.shape[0] < JOINTS or vertices.shape != (regressor.shape[1], 3):
        raise MotionError(f"J_regressor {regressor.shape} does not fit v_template {vertices.shape}", path)
    place = regressor[:JOINTS] @ vertices
    offsets = place - np.where(PARENTS[:JOINTS, None] < 0, 0.0, place[np.maximum(PARENTS[:JOINTS], 0)])
    hands = np.array([_MEAN["left_hand"], _MEAN["right_hand"]])
    return Skeleton(NAMES, PARENTS, np.concatenate([offsets, hands])), f"The skeleton is that of {path.name}."
