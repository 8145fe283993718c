"""The 263 features of HumanML3D: joints about a root whose place and heading are sums of its steps [Guo2022].

Columns of a frame: 0 the root's turn about y (half of it), 1–2 its step along x and z as seen from the heading, 3 its
height, 4–66 the places of the other 21 joints about it, 67–192 their turns in six numbers each, 193–258 velocities,
259–262 contacts of left ankle, left foot, right ankle and right foot.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from robot_retarget.base.arrays import Floats
from robot_retarget.base.errors import MotionError
from robot_retarget.base.untrusted.arrays import load_arrays
from robot_retarget.human.capture import Capture
from robot_retarget.human.readers.file_header import FileHeader
from robot_retarget.human.readers.joint_sets import HUMANML3D
from robot_retarget.human.readers.points import of_points
from robot_retarget.human.readers.positions import CONTACT
from robot_retarget.human.readers.request import Request

WIDTH = 263
FPS = 20.0
"""Of the data set [1/s]."""
_SIX = slice(67, 193)
_UNIT = 0.2
"""How far from 1 the length of the axes in columns 67–192 may be, on the mean; normalised features are further."""


def matches_format(header: FileHeader) -> bool:
    """Whether an array is as wide as the features."""
    return len(header.shape) == 2 and header.shape[1] == WIDTH


def read(path: Path, request: Request) -> Capture:
    """Read features and put the joints where they say.

    Raises:
        MotionError: not (T, 263) finite numbers, or features that are still normalised.
    """
    values = load_arrays(path)["positions"]
    if values.ndim != 2 or values.shape[1] != WIDTH or not len(values) or values.dtype.kind not in "fiu":
        raise MotionError(f"expected features (T, {WIDTH}), got {values.dtype} {values.shape}", path)
    features = values.astype(float)
    if not np.isfinite(features).all():
        frame, column = np.argwhere(~np.isfinite(features))[0]
        raise MotionError(f"frame {frame}, column {column} is not finite", path)
    axes = np.linalg.norm(features[:, _SIX].reshape(-1, 3), axis=1)
    if abs(float(axes.mean()) - 1) > _UNIT:
        raise MotionError("the features are normalised: multiply by the data set's Std.npy and add its Mean.npy", path)
    fps, rate_notes = request.rate(usual=FPS)
    joints = positions(features)
    names = tuple(HUMANML3D)
    body = {name: (HUMANML3D[name] or "", joints[:, k]) for k, name in enumerate(names)}
    notes = ("The file says when the feet stand: its contacts are taken.", *rate_notes)
    capture = of_points(body, fps, str(path), notes, up="+y")
    return replace(capture, contacts=features[:, 259:263] > CONTACT)


def positions(features: Floats) -> Floats:
    """(T, 22, 3) of the joints [m], y up.

    The heading before frame t is the sum of the turns before it, and the root's place that of the steps, each turned by the
    heading it was made in.
    """
    half = np.concatenate([[0.0], np.cumsum(features[:-1, 0])])
    heading = Rotation.from_euler("y", -2 * half[:, None])
    steps = np.zeros((len(features), 3))
    steps[1:, [0, 2]] = features[:-1, 1:3]
    root = np.cumsum(heading.apply(steps), axis=0)
    root[:, 1] = features[:, 3]
    about = features[:, 4:67].reshape(-1, 21, 3)
    turned = np.einsum("tij,tkj->tki", heading.as_matrix(), about)
    turned[:, :, [0, 2]] += root[:, None, [0, 2]]
    return np.concatenate([root[:, None], turned], axis=1)
